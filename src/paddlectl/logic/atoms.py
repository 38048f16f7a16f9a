"""Predicates, atoms and literals: frozen values that print as logic, `has_key(agent)`, `!is_open(door)`."""

import re
from dataclasses import dataclass
from functools import cached_property

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, order=True)
class Predicate:
    """A relation's name and arity. Calling it with terms gives an atom: `has_key("agent")`.

    Raises:
        ValueError: If the name is no lower-case identifier.
    """

    name: str
    arity: int

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"not a predicate name: {self.name!r}")

    def __call__(self, *terms: str) -> "Atom":
        return Atom(self, terms)


@dataclass(frozen=True, order=True)
class Atom:
    """A ground atom: a predicate over constants, `has_key(agent)`, or a subgoal without any, `gt_key()`.

    Raises:
        ValueError: If the number of terms isn't the predicate's arity, or a term is no identifier.
    """

    predicate: Predicate
    terms: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.terms) != self.predicate.arity:
            raise ValueError(f"{self.predicate.name} takes {self.predicate.arity} terms")
        for term in self.terms:
            if not _NAME.fullmatch(term):
                raise ValueError(f"not a constant: {term!r}")

    @cached_property
    def text(self) -> str:
        return f"{self.predicate.name}({', '.join(self.terms)})"

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, order=True)
class Literal:
    """An atom or its negation."""

    atom: Atom
    positive: bool = True

    def __invert__(self) -> "Literal":
        return Literal(self.atom, not self.positive)

    def __str__(self) -> str:
        return str(self.atom) if self.positive else f"!{self.atom}"
