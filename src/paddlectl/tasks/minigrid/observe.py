"""What the low level sees: the state mapped by a subgoal, 81 numbers, the same for all tasks.

An object that doesn't matter to the subgoal shows as an obstacle and in no other way, so that a skill works
among objects that it has never met. In order:

- 49: the 7 x 7 cells around the agent, row by row; 1 where it can't walk, also outside the grid
- 8: the target: present, dx / 14, dy / 7, sign of dx, sign of dy, dx = 0, dy = 0, in the near room
- 7: the passage: dx / 14, dy / 7, sign of dx, sign of dy, dy = 0; the agent is in the near room; it is open
- 3: the target is in front; the cell in front is empty; something is held
- 14: facing and head, one-hot

The target is what the subgoal acts on: a thing, the passage, a tile to place on. Without one (to put
something down, or as long as a thing isn't on the grid) its numbers are 0.
"""

import numpy as np

from paddlectl.tasks.base import Bools, Floats, Ints
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import (
    ABSENT,
    CELLS,
    DELTA,
    HEIGHT,
    MIDDLE,
    WALKABLE,
    WIDTH,
    Code,
    Codes,
    Thing,
)

REACH = 3  # cells seen to each side
_SIDE = 2 * REACH + 1
_WINDOW = _SIDE * _SIDE
ROWS = HEIGHT + 2 * REACH
OBSERVATION_SIZE = _WINDOW + 8 + 7 + 3 + 4 + len(s.HEADS)

_TARGETS = {
    s.GT_BLOCKAGE: Thing.BLOCKAGE,
    s.GT_BOX: Thing.BOX,
    s.GT_KEY: Thing.KEY,
    s.GT_DOOR: Thing.PASSAGE,
    s.GT_BALL: Thing.BALL,
    s.GT_GOAL: Thing.GOAL,
    s.PLACE_BLOCKAGE: Thing.YELLOW_TILE,
    s.PLACE_BALL: Thing.RED_TILE,
}
TARGET: Ints = np.array([_TARGETS.get(head, Thing.NOTHING) for head in s.HEADS])


def _relative_table() -> Floats:
    """Rows of the target's 8 numbers over agent x target, the last target being none. [120 * 121, 8]"""
    y, x = np.divmod(np.arange(CELLS), WIDTH)
    dx, dy = x[None, :] - x[:, None], y[None, :] - y[:, None]
    near = np.broadcast_to(x < MIDDLE, dx.shape)
    rows = [np.ones_like(dx), dx / 14, dy / 7, np.sign(dx), np.sign(dy), dx == 0, dy == 0, near]
    table = np.zeros((CELLS, CELLS + 1, len(rows)), dtype=np.float32)
    table[:, :ABSENT] = np.stack(rows, axis=2)
    return table.reshape(-1, len(rows))


def _passage_table() -> Floats:
    """Rows of the passage's 7 numbers over agent x row of the passage x open. [120 * 8 * 2, 7]"""
    relative = _relative_table().reshape(CELLS, CELLS + 1, 8)
    table = np.zeros((CELLS, HEIGHT, 2, 7), dtype=np.float32)
    table[..., :4] = relative[:, MIDDLE:ABSENT:WIDTH, None, 1:5]
    table[..., 4] = relative[:, MIDDLE:ABSENT:WIDTH, None, 6]
    table[..., 5] = (np.arange(CELLS) % WIDTH < MIDDLE)[:, None, None]
    table[..., 1, 6] = 1
    return table.reshape(-1, 7)


def _one_hot_table() -> Floats:
    """Rows of facing and head over facing x head. [4 * 10, 14]"""
    heads = len(s.HEADS)
    table = np.zeros((4, heads, 4 + heads), dtype=np.float32)
    table[..., :4] = np.eye(4)[:, None]
    table[..., 4:] = np.eye(heads)
    return table.reshape(-1, 4 + heads)


_RELATIVE = _relative_table()
_PASSAGE = _passage_table()
_ONE_HOT = _one_hot_table()
_BITS = ((np.arange(2**_SIDE)[:, None] >> np.arange(_SIDE)) & 1).astype(np.float32)  # lowest bit first
_ROW_OF, _COLUMN_OF = np.divmod(np.arange(CELLS), WIDTH)
_COLUMN_BIT: Ints = 1 << (_COLUMN_OF + REACH)


def obstacle_rows(grid: Codes) -> Ints:
    """Each row of the grid as one number: bit `x + REACH` is set if column x can't be walked on. [n, 14]

    Rows and bits beyond the grid are set.
    """
    rows: Ints = np.full((len(grid), ROWS), -1)
    blocked: Bools = ~WALKABLE.take(grid)
    packed = np.packbits(blocked.reshape(len(grid), HEIGHT, WIDTH), axis=2, bitorder="little")
    inner = (packed[..., 0].astype(np.intp) | packed[..., 1].astype(np.intp) << 8) << REACH
    rows[:, REACH:-REACH] = inner | (~((1 << WIDTH) - 1) << REACH) | ((1 << REACH) - 1)
    return rows


def update_rows(rows: Ints, lanes: Ints, cells: Ints, codes: Codes) -> None:
    """Brings `obstacle_rows` in line with the new code of one cell in each of the lanes. [n]"""
    places = lanes * ROWS + (_ROW_OF.take(cells) + REACH)
    bits = _COLUMN_BIT.take(cells)
    flat = rows.reshape(-1)
    flat[places] = flat.take(places) & ~bits | bits * ~WALKABLE.take(codes)


class Observer:
    """Writes observations of B lanes, with its tables and buffers at hand."""

    def __init__(self, lanes: int) -> None:
        self._cells: Ints = np.arange(lanes) * CELLS
        self._rows: Ints = np.arange(lanes) * ROWS
        self._things: Ints = np.arange(lanes) * len(Thing)
        self._offsets: Ints = np.arange(_SIDE)[:, None]
        self._window = np.empty((lanes, _SIDE, _SIDE), dtype=np.float32)

    def __call__(
        self, grid: Codes, rows: Ints, agent: Ints, facing: Ints, held: Ints, where: Ints, heads: Ints
    ) -> Floats:
        """The observations.

        Args:
            grid: Codes of the cells. [B, 120]
            rows: The grid's `obstacle_rows`. [B, 14]
            agent: The agent's cell. [B]
            facing: Its direction. [B]
            held: What is in hand. [B]
            where: Cell of each thing, or ABSENT. [B, 9]
            heads: Each lane's subgoal. [B]

        Returns:
            A new array. [B, 81]
        """
        out = np.empty((len(agent), OBSERVATION_SIZE), dtype=np.float32)
        seen = rows.take(self._rows + _ROW_OF.take(agent) + self._offsets)  # [7, B]: inner loops over lanes
        seen >>= _COLUMN_OF.take(agent)
        seen &= (1 << _SIDE) - 1
        _BITS.take(seen.T, axis=0, out=self._window, mode="clip")
        out[:, :49] = self._window.reshape(-1, _WINDOW)

        target = where.take(self._things + TARGET.take(heads))
        out[:, 49:57] = _RELATIVE.take(agent * (CELLS + 1) + target, axis=0)

        passage = where[:, Thing.PASSAGE]
        opened = grid.take(self._cells + passage) == Code.OPEN
        index = (agent * HEIGHT + _ROW_OF.take(passage)) * 2 + opened
        out[:, 57:64] = _PASSAGE.take(index, axis=0)

        front = agent + DELTA.take(facing)
        out[:, 64] = front == target
        out[:, 65] = grid.take(self._cells + front) == Code.EMPTY
        out[:, 66] = held != 0
        out[:, 67:] = _ONE_HOT.take(facing * len(s.HEADS) + heads, axis=0)
        return out
