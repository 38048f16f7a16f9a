"""The grid of all MiniGrid tasks: its cells, what can stand on them, and what an action does there.

Two rooms share the wall in column 7. A cell is its flat index `y * WIDTH + x`.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl.tasks.base import Bools, Ints

Codes = NDArray[np.uint8]

WIDTH, HEIGHT = 15, 8
CELLS = WIDTH * HEIGHT
MIDDLE = 7  # the column of the wall between the rooms
ABSENT = CELLS  # where a thing is that isn't on the grid


class Thing(IntEnum):
    """Columns of `where`: at most one of each stands on the grid. NOTHING is always absent."""

    KEY = 0
    BOX = 1
    BLOCKAGE = 2  # the yellow ball
    BALL = 3  # the green ball
    GOAL = 4
    YELLOW_TILE = 5
    RED_TILE = 6
    PASSAGE = 7
    NOTHING = 8


class Code(IntEnum):
    """What a cell of the grid holds."""

    EMPTY = 0
    WALL = 1
    KEY = 2
    BOX = 3
    BLOCKAGE = 4
    BALL = 5
    GOAL = 6
    YELLOW_TILE = 7
    RED_TILE = 8
    BLOCKAGE_PLACED = 9  # on its tile, for good
    BALL_PLACED = 10
    LOCKED = 11  # the passage, from here on
    CLOSED = 12
    GAP = 13
    OPEN = 14


class Held(IntEnum):
    """What is in the agent's hand."""

    NOTHING = 0
    KEY = 1
    BLOCKAGE = 2
    BALL = 3


class Action(IntEnum):
    """What the agent can do. The first four face that way, and step if the cell in front is free."""

    LEFT = 0
    RIGHT = 1
    UP = 2
    DOWN = 3
    PICK_UP = 4
    DROP = 5
    TOGGLE = 6
    STAY = 7  # not the agent's to choose: keeps finished lanes as they are


class Facing(IntEnum):
    """MiniGrid's directions."""

    RIGHT = 0
    DOWN = 1
    LEFT = 2
    UP = 3


ACTIONS = len(Action) - 1
DELTA: Ints = np.array([1, WIDTH, -1, -WIDTH])  # by facing
CODE_OF_THING: Ints = np.arange(len(Thing)) + Code.KEY  # for the things before PASSAGE
_CODES = 16  # row length of tables over codes


def codes(*members: Code) -> Bools:
    """A table over codes that is true at the given ones. [16]"""
    return np.isin(np.arange(_CODES), members)


WALKABLE = codes(Code.EMPTY, Code.GOAL, Code.OPEN)
OBJECTS = codes(Code.KEY, Code.BOX, Code.BLOCKAGE, Code.BALL, Code.BLOCKAGE_PLACED, Code.BALL_PLACED)


class Effect(NamedTuple):
    """A change to the cell in front. `enters` comes to stand there; then `leaves` is gone from the grid."""

    code: Code
    held: Held | None  # None: as before
    enters: Thing
    leaves: Thing = Thing.NOTHING


NO_EFFECT, MOVE = 0, 1  # outcomes; the effects follow
EFFECTS: list[Effect] = []


def _outcomes() -> Ints:
    """The outcome of each (action, held, code of the cell in front), flat."""
    table = np.zeros((len(Action), len(Held), _CODES), dtype=np.intp)
    table[: Action.PICK_UP, :, WALKABLE] = MOVE

    def add(action: Action, held: Held | slice, front: Code, effect: Effect) -> None:
        table[action, held, front] = len(EFFECTS) + 2
        EFFECTS.append(effect)

    for held, thing, tile in (
        (Held.KEY, Thing.KEY, None),
        (Held.BLOCKAGE, Thing.BLOCKAGE, Code.YELLOW_TILE),
        (Held.BALL, Thing.BALL, Code.RED_TILE),
    ):
        code = Code[thing.name]
        add(Action.PICK_UP, Held.NOTHING, code, Effect(Code.EMPTY, held, thing, thing))
        add(Action.DROP, held, Code.EMPTY, Effect(code, Held.NOTHING, thing))
        if tile is not None:
            add(Action.DROP, held, tile, Effect(Code[f"{thing.name}_PLACED"], Held.NOTHING, thing))
    anything = slice(None)
    add(Action.TOGGLE, anything, Code.BOX, Effect(Code.KEY, None, Thing.KEY, Thing.BOX))
    add(Action.TOGGLE, Held.KEY, Code.LOCKED, Effect(Code.OPEN, None, Thing.PASSAGE))
    add(Action.TOGGLE, anything, Code.CLOSED, Effect(Code.OPEN, None, Thing.PASSAGE))
    return table.ravel()


OUTCOME = _outcomes()
EFFECT_CODE = np.array([0, 0, *(e.code for e in EFFECTS)], dtype=np.uint8)
EFFECT_HELD: Ints = np.array([-1, -1, *(-1 if e.held is None else e.held for e in EFFECTS)])
EFFECT_ENTERS: Ints = np.array([0, 0, *(e.enters for e in EFFECTS)])
EFFECT_LEAVES: Ints = np.array([0, 0, *(e.leaves for e in EFFECTS)])


def outcome_index(actions: Ints, held: Ints, front: Codes) -> Ints:
    """The place in OUTCOME of each lane's action. [B]"""
    index: Ints = (actions * len(Held) + held) * _CODES + front
    return index


def _turns() -> Ints:
    table = np.tile(np.arange(4), (len(Action), 1))
    for action in (Action.LEFT, Action.RIGHT, Action.UP, Action.DOWN):
        table[action] = Facing[action.name]
    return table.ravel()


TURN = _turns()  # the facing after (action, facing), flat
