"""The symbols of the MiniGrid tasks: body atoms, subgoals, and when each holds.

All of them follow from ten facts about a state. A lane's facts are kept as one number, its bits `Fact`;
what a task asks of them is looked up in tables over all 1,024 combinations.
"""

from collections.abc import Collection
from enum import IntFlag

import numpy as np

from paddlectl.logic.atoms import Atom, Literal, Predicate
from paddlectl.tasks.base import Bools, Ints
from paddlectl.tasks.minigrid.grid import ABSENT, CELLS, OBJECTS, Code, Codes, Thing, codes

_HAS_KEY, _HAS_BLOCKAGE, _HAS_BALL, _IS_OPEN, _IS_BLOCKED, _IS_PLACED = (
    Predicate(name, 1)
    for name in ("has_key", "has_blockage", "has_ball", "is_open", "is_blocked", "is_placed")
)
KEY_IN_HAND = _HAS_KEY("agent")
KEY_IN_SIGHT = _HAS_KEY("env")
BLOCKAGE_IN_HAND = _HAS_BLOCKAGE("agent")
BALL_IN_HAND = _HAS_BALL("agent")
OPEN = _IS_OPEN("door")
BLOCKED = _IS_BLOCKED("door")
BLOCKAGE_PLACED = _IS_PLACED("blockage")

ATOMS = (KEY_IN_HAND, KEY_IN_SIGHT, BLOCKAGE_IN_HAND, BALL_IN_HAND, OPEN, BLOCKED, BLOCKAGE_PLACED)
_PAIRS = (
    (KEY_IN_HAND, BLOCKAGE_IN_HAND),
    (KEY_IN_HAND, BALL_IN_HAND),
    (BLOCKAGE_IN_HAND, BALL_IN_HAND),
    (KEY_IN_HAND, KEY_IN_SIGHT),
    (BLOCKAGE_IN_HAND, BLOCKAGE_PLACED),
)

SUBGOALS = tuple(
    Predicate(name, 0)()
    for name in (
        "gt_blockage",
        "put_blockage",
        "gt_box",
        "gt_key",
        "gt_door",
        "put_key",
        "gt_ball",
        "gt_goal",
        "place_blockage",
        "place_ball",
    )
)
(
    GT_BLOCKAGE,
    PUT_BLOCKAGE,
    GT_BOX,
    GT_KEY,
    GT_DOOR,
    PUT_KEY,
    GT_BALL,
    GT_GOAL,
    PLACE_BLOCKAGE,
    PLACE_BALL,
) = SUBGOALS


class Fact(IntFlag):
    """What a lane's facts are made of."""

    KEY_HELD = 1
    BLOCKAGE_HELD = 2
    BALL_HELD = 4
    KEY_SEEN = 8  # on the floor, out of its box
    OPEN = 16
    BLOCKED = 32  # an object on either side of the passage
    BLOCKAGE_PLACED = 64
    BALL_PLACED = 128
    BOX_CLOSED = 256
    ON_GOAL = 512


FACTS = 1024
_HELD: Ints = np.array([0, Fact.KEY_HELD, Fact.BLOCKAGE_HELD, Fact.BALL_HELD])
_SEEN: Ints = np.zeros(len(Thing), dtype=np.intp)
_SEEN[[Thing.KEY, Thing.BOX]] = Fact.KEY_SEEN, Fact.BOX_CLOSED
_PLACED: Ints = np.array([Fact.BLOCKAGE_PLACED, Fact.BALL_PLACED])
_SIDE: Ints = OBJECTS * int(Fact.BLOCKED)  # by the code of a cell beside the passage
_PASSAGE: Ints = codes(Code.OPEN) * int(Fact.OPEN)  # by the code of the passage
_GOAL = int(Fact.ON_GOAL)


def exclusions(atoms: Collection[Atom]) -> tuple[frozenset[Literal], ...]:
    """The pairs of these atoms that never hold together: two things in hand, one thing in two places."""
    return tuple(frozenset(map(Literal, pair)) for pair in _PAIRS if set(pair) <= set(atoms))


def encode(grid: Codes, where: Ints, held: Ints, agent: Ints) -> Ints:
    """The facts of each state.

    Args:
        grid: Codes of the cells. [n, 120]
        where: Cell of each thing, or ABSENT. [n, 9]
        held: What is in hand. [n]
        agent: The agent's cell. [n]

    Returns:
        One number a state, its bits `Fact`. [n]
    """
    cells = grid.reshape(-1)
    passage = where[:, Thing.PASSAGE] + np.arange(len(grid)) * CELLS
    beside = _SIDE.take(cells.take(passage - 1)) | _SIDE.take(cells.take(passage + 1))
    seen = where != ABSENT
    on_tile = where[:, Thing.BLOCKAGE : Thing.GOAL] == where[:, Thing.YELLOW_TILE : Thing.PASSAGE]
    placed = on_tile & seen[:, Thing.BLOCKAGE : Thing.GOAL]
    facts: Ints = _HELD.take(held) | beside | _PASSAGE.take(cells.take(passage))
    facts |= seen @ _SEEN
    facts |= placed @ _PLACED
    facts |= (agent == where[:, Thing.GOAL]) * _GOAL
    return facts


_ALL: Ints = np.arange(FACTS)


def _holds(fact: Fact) -> Bools:
    truth: Bools = (_ALL & int(fact)) != 0
    return truth


def valuation_table(atoms: Collection[Atom]) -> Bools:
    """The truth of each atom by facts. [1024, P]"""
    truth = {
        KEY_IN_HAND: Fact.KEY_HELD,
        KEY_IN_SIGHT: Fact.KEY_SEEN,
        BLOCKAGE_IN_HAND: Fact.BLOCKAGE_HELD,
        BALL_IN_HAND: Fact.BALL_HELD,
        OPEN: Fact.OPEN,
        BLOCKED: Fact.BLOCKED,
        BLOCKAGE_PLACED: Fact.BLOCKAGE_PLACED,
    }
    return np.stack([_holds(truth[atom]) for atom in atoms], axis=1)


def reached_table(things: Collection[Thing]) -> Bools:
    """Whether each subgoal holds, by facts, in a task with these things. [10, 1024]"""
    clear = ~_holds(Fact.BLOCKED)
    reached = {
        GT_BLOCKAGE: _holds(Fact.BLOCKAGE_HELD),
        PUT_BLOCKAGE: (Thing.BLOCKAGE in things) & ~_holds(Fact.BLOCKAGE_HELD) & clear,
        GT_BOX: (Thing.BOX in things) & ~_holds(Fact.BOX_CLOSED),
        GT_KEY: _holds(Fact.KEY_HELD),
        GT_DOOR: _holds(Fact.OPEN),
        PUT_KEY: _holds(Fact.KEY_SEEN) & clear,
        GT_BALL: _holds(Fact.BALL_HELD),
        GT_GOAL: _holds(Fact.ON_GOAL),
        PLACE_BLOCKAGE: _holds(Fact.BLOCKAGE_PLACED),
        PLACE_BALL: _holds(Fact.BALL_PLACED),
    }
    return np.stack([reached[subgoal] for subgoal in SUBGOALS])


def available_table(things: Collection[Thing]) -> Bools:
    """Whether what a subgoal acts on is there and the subgoal doesn't hold, by facts. [10, 1024]"""
    loose_blockage = (Thing.BLOCKAGE in things) & ~_holds(Fact.BLOCKAGE_HELD | Fact.BLOCKAGE_PLACED)
    loose_ball = (Thing.BALL in things) & ~_holds(Fact.BALL_HELD | Fact.BALL_PLACED)
    available = {
        GT_BLOCKAGE: loose_blockage,
        PUT_BLOCKAGE: _holds(Fact.BLOCKAGE_HELD),
        GT_BOX: _holds(Fact.BOX_CLOSED),
        GT_KEY: _holds(Fact.KEY_SEEN),
        GT_DOOR: ~_holds(Fact.OPEN),
        PUT_KEY: _holds(Fact.KEY_HELD),
        GT_BALL: loose_ball,
        GT_GOAL: (Thing.GOAL in things) & ~_holds(Fact.ON_GOAL),
        PLACE_BLOCKAGE: (Thing.YELLOW_TILE in things) & _holds(Fact.BLOCKAGE_HELD),
        PLACE_BALL: (Thing.RED_TILE in things) & _holds(Fact.BALL_HELD),
    }
    return np.stack([available[subgoal] for subgoal in SUBGOALS])
