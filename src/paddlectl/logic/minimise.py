"""A program in few, short clauses: each head's prime implicants, of which the fewest are sought greedily.

The prime implicants of a scene are the minimal sets of its literals that tell it from every scene where the
head must not fire: minimal hitting sets, found one difference at a time (Berge, 1989).
"""

from collections import Counter
from collections.abc import Iterable

from paddlectl.logic.atoms import Atom, Literal
from paddlectl.logic.clauses import Body, Clause, Program, body_text

MOST_ATOMS = 12

_Cube = tuple[int, int]
"""Which atoms count, and the truth that these must have, as bits."""


def minimise(program: Program, impossible: Iterable[Body], threshold: float = 0.1) -> tuple[Clause, ...]:
    """Finds short clauses that fire the same heads in every possible scene.

    A head's clauses with a probability of at least `threshold` are its ones, impossible scenes are
    don't-cares, all other scenes are zeros. An empty body in the result means: always. A program over more
    than twelve atoms keeps its clauses as they are.

    Args:
        program: Clauses whose bodies are all over the same atoms.
        impossible: Bodies over those atoms that never occur.
        threshold: Execution probability from which a clause belongs to the program.

    Returns:
        Clauses by head in order of first appearance, then the shortest first.

    Raises:
        ValueError: If two bodies are over different atoms.
    """
    ones: dict[Atom, list[Body]] = {}
    for clause, probability in zip(program.clauses, program.probabilities, strict=True):
        bodies = ones.setdefault(clause.head, [])
        if probability >= threshold:
            bodies.append(clause.body)
    ignored = frozenset(impossible)
    atoms = _shared_atoms([*(clause.body for clause in program.clauses), *ignored])
    return tuple(
        Clause(head, body)
        for head, bodies in ones.items()
        for body in sorted(_fewest(bodies, ignored, atoms), key=lambda body: (len(body), body_text(body)))
    )


def _shared_atoms(bodies: list[Body]) -> tuple[Atom, ...]:
    vocabularies = {frozenset(literal.atom for literal in body) for body in bodies}
    if len(vocabularies) > 1:
        raise ValueError("all bodies must be over the same atoms")
    atoms = tuple(sorted(next(iter(vocabularies), frozenset())))
    if any(len(body) != len(atoms) for body in bodies):
        raise ValueError("a body contradicts itself")
    return atoms


def _fewest(bodies: list[Body], ignored: frozenset[Body], atoms: tuple[Atom, ...]) -> list[Body]:
    """Few bodies that hold in `bodies` and in no other scene outside `ignored`."""
    if len(atoms) > MOST_ATOMS:
        return bodies
    skipped = {_row(body, atoms) for body in ignored}
    ones = {_row(body, atoms) for body in bodies} - skipped
    zeros = set(range(2 ** len(atoms))) - ones - skipped
    return [
        frozenset(Literal(atom, bool(truth >> bit & 1)) for bit, atom in enumerate(atoms) if mask >> bit & 1)
        for mask, truth in _cover({one: _primes(one, zeros) for one in ones})
    ]


def _row(body: Body, atoms: tuple[Atom, ...]) -> int:
    return sum(1 << bit for bit, atom in enumerate(atoms) if Literal(atom) in body)


def _primes(one: int, zeros: set[int]) -> set[_Cube]:
    """The largest cubes around `one` without any of `zeros`."""
    masks = [0]
    for difference in _least(one ^ zero for zero in zeros):
        bits = [1 << bit for bit in range(difference.bit_length()) if difference >> bit & 1]
        hit = [mask for mask in masks if mask & difference]
        masks = _least([*hit, *(mask | bit for mask in masks if not mask & difference for bit in bits)])
    return {(mask, one & mask) for mask in masks}


def _least(masks: Iterable[int]) -> list[int]:
    """Those that contain no other one."""
    least: list[int] = []
    for mask in sorted(set(masks), key=lambda mask: (mask.bit_count(), mask)):
        if not any(mask & other == other for other in least):
            least.append(mask)
    return least


def _cover(primes: dict[int, set[_Cube]]) -> list[_Cube]:
    """Cubes that cover every key, of those around each: the only ones first, then by their gain."""
    chosen = {cube for cubes in primes.values() if len(cubes) == 1 for cube in cubes}
    while left := [cubes for cubes in primes.values() if not cubes & chosen]:
        gain = Counter(cube for cubes in left for cube in cubes)
        chosen.add(min(gain, key=lambda cube: (-gain[cube], cube[0].bit_count(), cube)))
    for cube in sorted(chosen):
        if all(cubes & chosen - {cube} for cubes in primes.values()):
            chosen.remove(cube)
    return sorted(chosen)
