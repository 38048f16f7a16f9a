"""The complete set of clauses that a vocabulary allows (the paper's template `H :- B1 ∧ … ∧ Bn`)."""

from collections.abc import Iterable, Sequence
from itertools import product

from paddlectl.logic.atoms import Atom, Literal
from paddlectl.logic.clauses import Body, Clause


def scenes(atoms: Sequence[Atom], exclusions: Iterable[Body] = ()) -> tuple[Body, ...]:
    """All consistent truth assignments, counted in binary: the first atom is the most significant bit.

    Args:
        atoms: The vocabulary; each body has one literal for each.
        exclusions: Sets of literals that never hold together; a body that contains one is left out.

    Raises:
        ValueError: If an atom stands twice, or an exclusion is empty or names an atom outside the vocabulary.
    """
    forbidden = tuple(exclusions)
    _check(atoms, forbidden)
    choices = product(*((Literal(atom, False), Literal(atom)) for atom in atoms))
    bodies = (frozenset(choice) for choice in choices)
    return tuple(body for body in bodies if not any(exclusion <= body for exclusion in forbidden))


def all_clauses(
    atoms: Sequence[Atom], exclusions: Iterable[Body], heads: Sequence[Atom]
) -> tuple[Clause, ...]:
    """Every consistent scene × every head, scene by scene.

    Raises:
        ValueError: As `scenes` does, or if a head stands twice.
    """
    if len(set(heads)) != len(heads):
        raise ValueError("a head stands twice")
    return tuple(Clause(head, body) for body in scenes(atoms, exclusions) for head in heads)


def _check(atoms: Sequence[Atom], exclusions: Iterable[Body]) -> None:
    known = set(atoms)
    if len(known) != len(atoms):
        raise ValueError("an atom stands twice")
    for exclusion in exclusions:
        if not exclusion:
            raise ValueError("an empty exclusion would forbid every scene")
        if strangers := {literal.atom for literal in exclusion} - known:
            raise ValueError(f"an exclusion names {min(strangers)}, which the vocabulary lacks")
