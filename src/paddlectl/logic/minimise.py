"""A program in its fewest, shortest clauses, by sympy's Quine-McCluskey (`SOPform`)."""

from collections.abc import Iterable
from itertools import product

from paddlectl.logic.atoms import Atom, Literal
from paddlectl.logic.clauses import Body, Clause, Program, body_text

# SOPform with mostly don't-cares, seconds a head: 0.08 for 7 atoms, 0.9 for 8, 9 for 9.
_QUICK_ATOMS = 7
_MOST_NEEDED = 8
MOST_ATOMS = 12

_Row = tuple[bool, ...]


def minimise(program: Program, impossible: Iterable[Body], threshold: float = 0.1) -> tuple[Clause, ...]:
    """Finds short clauses that fire the same heads in every possible scene.

    A head's clauses with a probability of at least `threshold` are its ones, impossible scenes are
    don't-cares, all other scenes are zeros. An empty body in the result means: always. Above seven atoms,
    those that the head can do without are dropped first, which is quick but may miss the very shortest
    form. A head that needs more than eight, or a program over more than twelve, keeps its clauses as they
    are.

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
    """The fewest bodies that hold in `bodies` and in no other scene outside `ignored`."""
    if len(atoms) > MOST_ATOMS:
        return bodies
    skipped = {_row(body, atoms) for body in ignored}
    ones = {_row(body, atoms) for body in bodies} - skipped
    zeros = set(product((False, True), repeat=len(atoms))) - ones - skipped
    needed = atoms
    while len(needed) > _QUICK_ATOMS and (column := _spare_column(ones, zeros)) is not None:
        needed = needed[:column] + needed[column + 1 :]
        ones, zeros = _without(ones, column), _without(zeros, column)
    return bodies if len(needed) > _MOST_NEEDED else _sum_of_products(ones, zeros, needed)


def _row(body: Body, atoms: tuple[Atom, ...]) -> _Row:
    return tuple(Literal(atom) in body for atom in atoms)


def _without(rows: set[_Row], column: int) -> set[_Row]:
    return {row[:column] + row[column + 1 :] for row in rows}


def _spare_column(ones: set[_Row], zeros: set[_Row]) -> int | None:
    """The column without which ones and zeros still differ, and the fewest distinct rows are left."""
    width = len(next(iter(ones | zeros), ()))
    left = {column: (_without(ones, column), _without(zeros, column)) for column in range(width)}
    sizes = {c: len(one) + len(zero) for c, (one, zero) in left.items() if one.isdisjoint(zero)}
    return min(sizes, key=lambda column: sizes[column], default=None)


def _sum_of_products(ones: set[_Row], zeros: set[_Row], atoms: tuple[Atom, ...]) -> list[Body]:
    # Imported here: it takes longer to load than all the rest of the logic room to run.
    from sympy import And, Dummy, Not, Or, true
    from sympy.logic import SOPform

    if not ones or not zeros:
        return [frozenset()] if ones else []
    free = [row for row in product((False, True), repeat=len(atoms)) if row not in ones and row not in zeros]
    literals = {Dummy(f"x{index:02}"): Literal(atom) for index, atom in enumerate(atoms)}
    literals |= {Not(symbol): ~literal for symbol, literal in literals.items()}
    form = SOPform(list(literals)[: len(atoms)], _integers(ones), _integers(free))
    return [
        frozenset(literals[factor] for factor in And.make_args(term) if factor is not true)
        for term in Or.make_args(form)
    ]


def _integers(rows: Iterable[_Row]) -> list[list[int]]:
    return [[int(value) for value in row] for row in sorted(rows)]
