"""The symbols of the maze tasks: body atoms, subgoals, and when each holds.

All of them follow from four facts about a state, kept as one number, its bits `Fact`, and from the places
that the ball touches. What a task asks of the facts is looked up in tables over all 16 combinations.
"""

from collections.abc import Collection
from enum import IntFlag

import numpy as np

from paddlectl.logic.atoms import Atom, Literal, Predicate
from paddlectl.tasks.base import Bools, Ints

COFFEE_IN_HAND = Predicate("has_coffee", 1)("agent")
COFFEE_DELIVERED = Predicate("coffee_delivered", 0)()
MAIL_IN_HAND = Predicate("has_mail", 1)("agent")
MAIL_DELIVERED = Predicate("mail_delivered", 0)()

ATOMS = (COFFEE_IN_HAND, COFFEE_DELIVERED, MAIL_IN_HAND, MAIL_DELIVERED)
_PAIRS = ((COFFEE_IN_HAND, COFFEE_DELIVERED), (MAIL_IN_HAND, MAIL_DELIVERED))

SUBGOALS = tuple(
    Predicate(name, 0)() for name in ("gt_coffee", "gt_coffee_office", "gt_mail", "gt_mail_office", "gt_ball")
)
GT_COFFEE, GT_COFFEE_OFFICE, GT_MAIL, GT_MAIL_OFFICE, GT_BALL = SUBGOALS


class Fact(IntFlag):
    """What a lane's facts are made of."""

    COFFEE_HELD = 1
    COFFEE_DELIVERED = 2
    MAIL_HELD = 4
    MAIL_DELIVERED = 8


FACTS = 16
_ALL: Ints = np.arange(FACTS)


def exclusions(atoms: Collection[Atom]) -> tuple[frozenset[Literal], ...]:
    """The pairs of these atoms that never hold together: nothing is in hand once it is delivered."""
    return tuple(frozenset(map(Literal, pair)) for pair in _PAIRS if set(pair) <= set(atoms))


def _holds(fact: Fact) -> Bools:
    truth: Bools = (_ALL & int(fact)) != 0
    return truth


def valuation_table(atoms: Collection[Atom]) -> Bools:
    """The truth of each atom by facts. [16, P]"""
    truth = dict(zip(ATOMS, Fact, strict=True))
    return np.stack([_holds(truth[atom]) for atom in atoms], axis=1)


def available_table(subgoals: Collection[Atom]) -> Bools:
    """Whether what a subgoal acts on is there, by facts, in a task with these subgoals. [5, 16]"""
    available = {
        GT_COFFEE: ~_holds(Fact.COFFEE_HELD | Fact.COFFEE_DELIVERED),
        GT_COFFEE_OFFICE: _holds(Fact.COFFEE_HELD),
        GT_MAIL: ~_holds(Fact.MAIL_HELD | Fact.MAIL_DELIVERED),
        GT_MAIL_OFFICE: _holds(Fact.MAIL_HELD),
        GT_BALL: np.ones(FACTS, np.bool_),
    }
    return np.stack([available[subgoal] & (subgoal in subgoals) for subgoal in SUBGOALS])


def touch_table(subgoals: Collection[Atom]) -> Ints:
    """The facts after a place is touched, by facts, in a task with these subgoals. [5, 16]

    A row for each subgoal's place: things are taken and delivered by touch; the ball changes nothing.
    """
    after = np.tile(_ALL, (len(SUBGOALS), 1))
    available = available_table(subgoals)
    for subgoal, given, taken in (
        (GT_COFFEE, Fact.COFFEE_HELD, Fact(0)),
        (GT_COFFEE_OFFICE, Fact.COFFEE_DELIVERED, Fact.COFFEE_HELD),
        (GT_MAIL, Fact.MAIL_HELD, Fact(0)),
        (GT_MAIL_OFFICE, Fact.MAIL_DELIVERED, Fact.MAIL_HELD),
    ):
        row = SUBGOALS.index(subgoal)
        after[row] = np.where(available[row], _ALL & ~int(taken) | int(given), _ALL)
    return after
