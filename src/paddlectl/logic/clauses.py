"""Clauses, scenes and programs (the paper's section 2 and Algorithm 1, lines 1-7)."""

from collections.abc import Iterable
from dataclasses import dataclass

from paddlectl.logic.atoms import Atom, Literal

Body = frozenset[Literal]


def body_text(body: Body) -> str:
    """The literals in alphabetical order of their atoms, `!has_key(agent), is_open(door)`."""
    return ", ".join(str(literal) for literal in sorted(body))


@dataclass(frozen=True)
class Clause:
    """`head :- body`: one subgoal for one scene."""

    head: Atom
    body: Body

    def __str__(self) -> str:
        return f"{self.head} :- {body_text(self.body)}" if self.body else f"{self.head}"


@dataclass(frozen=True)
class Scene:
    """All clauses of a program that share one body (the paper's c)."""

    body: Body
    heads: frozenset[Atom]

    def __str__(self) -> str:
        heads = ", ".join(str(head) for head in sorted(self.heads))
        return f"[{heads}] :- {body_text(self.body)}"


@dataclass(frozen=True)
class Program:
    """Clauses with the probability that each is executed when its scene is active.

    Raises:
        ValueError: If the two tuples differ in length, a probability is outside [0, 1],
            or a clause stands twice.
    """

    clauses: tuple[Clause, ...]
    probabilities: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.clauses) != len(self.probabilities):
            raise ValueError("a program needs one probability for each clause")
        if not all(0.0 <= p <= 1.0 for p in self.probabilities):
            raise ValueError("a probability lies in [0, 1]")
        if len(set(self.clauses)) != len(self.clauses):
            raise ValueError("a clause stands twice")

    def policy(self, body: Body) -> dict[Atom, float]:
        """The heads of one scene with their execution probabilities; empty if the scene is unknown."""
        return {
            clause.head: p
            for clause, p in zip(self.clauses, self.probabilities, strict=True)
            if clause.body == body
        }


def scenes_of(clauses: Iterable[Clause]) -> tuple[Scene, ...]:
    """Groups clauses by body, in order of first appearance (Algorithm 1, lines 1-7)."""
    heads: dict[Body, set[Atom]] = {}
    for clause in clauses:
        heads.setdefault(clause.body, set()).add(clause.head)
    return tuple(Scene(body, frozenset(found)) for body, found in heads.items())
