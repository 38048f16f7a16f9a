"""What the low level sees: the state mapped by a subgoal, 81 numbers, the same for all tasks.

An object that doesn't matter to the subgoal shows as an obstacle and in no other way, so that a skill works
among objects that it has never met. In order:

- 49: the 7 x 7 cells around the agent, row by row; 1 where it can't walk, also outside the grid
- 8: the target: present, dx / 14, dy / 7, sign of dx, sign of dy, dx = 0, dy = 0, in the near room
- 7: the passage: dx / 14, dy / 7, sign of dx, sign of dy, dy = 0; the agent is in the near room; it is open
- 3: the target is in front; the cell in front is empty; something is held
- 14: facing and subgoal, one-hot

The target is what the subgoal acts on: a thing, the passage, a tile to place on. Without one (to put
something down, or as long as a thing isn't on the grid) its numbers are 0.

All of it is seen in a frame mirrored such that the target (the passage, without one) never lies left of the
agent or above it. The rules are the same in a mirror, so what is learned once holds in four directions.
"""

import numpy as np

from paddlectl.tasks.base import Bools, Floats, Ints
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import (
    ABSENT,
    ACTIONS,
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
OBSERVATION_SIZE = _WINDOW + 8 + 7 + 3 + 4 + len(s.SUBGOALS)

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
TARGET: Ints = np.array([_TARGETS.get(subgoal, Thing.NOTHING) for subgoal in s.SUBGOALS])


def _frame_table() -> Ints:
    """The frame in which a cell lies neither left nor above, over agent x cell. [120 * 120]"""
    y, x = np.divmod(np.arange(CELLS), WIDTH)
    frames: Ints = (x[None, :] < x[:, None]) + 2 * (y[None, :] < y[:, None])
    return frames.reshape(-1)


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
    """Rows of the passage's 7 numbers over agent x its row x open x frame. [120 * 8 * 2 * 4, 7]"""
    relative = _relative_table().reshape(CELLS, CELLS + 1, 8)
    table = np.zeros((CELLS, HEIGHT, 2, 7), dtype=np.float32)
    table[..., :4] = relative[:, MIDDLE:ABSENT:WIDTH, None, 1:5]
    table[..., 4] = relative[:, MIDDLE:ABSENT:WIDTH, None, 6]
    table[..., 5] = (np.arange(CELLS) % WIDTH < MIDDLE)[:, None, None]
    table[..., 1, 6] = 1
    return _in_frames(table, [0, 2], [1, 3]).reshape(-1, 7)


def _in_frames(table: Floats, horizontal: list[int], vertical: list[int]) -> Floats:
    """A row for each of the 4 frames, the columns named changing their sign in a mirror. [..., 4, D]"""
    framed = np.repeat(table[..., None, :], 4, axis=-2)
    framed[..., 1::2, horizontal] *= -1
    framed[..., 2:, vertical] *= -1
    return framed


def _one_hot_table() -> Floats:
    """Rows of facing and subgoal over facing x subgoal. [4 * 10, 14]"""
    subgoals = len(s.SUBGOALS)
    table = np.zeros((4, subgoals, 4 + subgoals), dtype=np.float32)
    table[..., :4] = np.eye(4)[:, None]
    table[..., 4:] = np.eye(subgoals)
    return table.reshape(-1, 4 + subgoals)


def _distance_table() -> Floats:
    """Steps over agent x target x the passage's row, the last target being none. [120 * 121 * 8]"""
    y, x = np.divmod(np.arange(CELLS), WIDTH)
    passage = np.arange(HEIGHT)
    to_passage = abs(x - MIDDLE)[:, None] + abs(y[:, None] - passage)
    straight = abs(x[None, :] - x[:, None]) + abs(y[None, :] - y[:, None])
    near = x < MIDDLE
    table = np.zeros((CELLS, CELLS + 1, HEIGHT), np.float32)
    table[:, :ABSENT] = np.where(
        (near[:, None] == near[None, :])[..., None],
        straight[..., None],
        to_passage[:, None] + to_passage[None, :],
    )
    return table.reshape(-1)


_FRAME = _frame_table()
_DISTANCE = _distance_table()
RELATIVE_IN_WORLD = _relative_table().reshape(CELLS, CELLS + 1, 8)
"""A target's 8 numbers without a mirror, over agent x target. [120, 121, 8]"""
_RELATIVE = np.abs(_relative_table())  # in its own frame a target's offsets aren't negative
_PASSAGE = _passage_table()
PASSAGE_IN_WORLD = _PASSAGE.reshape(CELLS, HEIGHT, 2, 4, 7)[..., 0, :]
"""The passage's 7 numbers without a mirror, over agent x its row x open. [120, 8, 2, 7]"""
_ONE_HOT = _one_hot_table()
_FACING: Ints = np.array([[0, 1, 2, 3], [2, 1, 0, 3], [0, 3, 2, 1], [2, 3, 0, 1]])  # by frame
_MOVES: Ints = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [0, 1, 3, 2], [1, 0, 3, 2]])
_IN_WORLD = np.hstack([_MOVES, np.tile(np.arange(4, ACTIONS), (4, 1))])
_BITS = ((np.arange(2**_SIDE)[:, None] >> np.arange(_SIDE)) & 1).astype(np.float32)  # lowest bit first
_BITS = np.concatenate([_BITS, _BITS[:, ::-1]])  # as seen, then mirrored
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


def window_in_world(rows: Ints, agent: Ints) -> Floats:
    """The cells around each agent without a mirror; 1 where it can't walk. [n, 14], [n] -> [n, 49]"""
    y, x = np.divmod(agent, WIDTH)
    seen = np.take_along_axis(rows, y[:, None] + np.arange(_SIDE), axis=1) >> x[:, None]
    window: Floats = _BITS[seen & ((1 << _SIDE) - 1)].reshape(len(agent), _WINDOW)
    return window


def update_rows(rows: Ints, lanes: Ints, cells: Ints, codes: Codes) -> None:
    """Brings `obstacle_rows` in line with the new code of one cell in each of the lanes. [n]"""
    places = lanes * ROWS + (_ROW_OF.take(cells) + REACH)
    bits = _COLUMN_BIT.take(cells)
    flat = rows.reshape(-1)
    flat[places] = flat.take(places) & ~bits | bits * ~WALKABLE.take(codes)


class Observer:
    """Writes observations of B lanes, with its tables and buffers at hand."""

    def __init__(self, num_envs: int) -> None:
        self._cells: Ints = np.arange(num_envs) * CELLS
        self._rows: Ints = np.arange(num_envs) * ROWS
        self._things: Ints = np.arange(num_envs) * len(Thing)
        self._offsets: Ints = np.arange(_SIDE)[:, None]
        self._down_up: Ints = np.array([1, 1, -1, -1])  # by frame
        self._top: Ints = np.array([0, 0, _SIDE - 1, _SIDE - 1])
        self._window = np.empty((num_envs, _SIDE, _SIDE), dtype=np.float32)

    def __call__(
        self, grid: Codes, rows: Ints, agent: Ints, facing: Ints, held: Ints, where: Ints, subgoals: Ints
    ) -> Floats:
        """The observations.

        Args:
            grid: Codes of the cells. [B, 120]
            rows: The grid's `obstacle_rows`. [B, 14]
            agent: The agent's cell. [B]
            facing: Its direction. [B]
            held: What is in hand. [B]
            where: Cell of each thing, or ABSENT. [B, 9]
            subgoals: Each lane's subgoal. [B]

        Returns:
            A new array. [B, 81]
        """
        target = where.take(self._things + TARGET.take(subgoals))
        passage = where[:, Thing.PASSAGE]
        frame = _frames(agent, target, passage)
        out = np.empty((len(agent), OBSERVATION_SIZE), dtype=np.float32)
        top = self._rows + _ROW_OF.take(agent) + self._top.take(frame)
        seen = rows.take(top + self._offsets * self._down_up.take(frame))  # [7, B]: inner loops over lanes
        seen >>= _COLUMN_OF.take(agent)
        seen &= (1 << _SIDE) - 1
        seen |= (frame & 1) << _SIDE
        _BITS.take(seen.T, axis=0, out=self._window, mode="clip")
        out[:, :49] = self._window.reshape(-1, _WINDOW)

        out[:, 49:57] = _RELATIVE.take(agent * (CELLS + 1) + target, axis=0)

        opened = grid.take(self._cells + passage) == Code.OPEN
        index = ((agent * HEIGHT + _ROW_OF.take(passage)) * 2 + opened) * 4 + frame
        out[:, 57:64] = _PASSAGE.take(index, axis=0)

        front = agent + DELTA.take(facing)
        out[:, 64] = front == target
        out[:, 65] = grid.take(self._cells + front) == Code.EMPTY
        out[:, 66] = held != 0
        seen_facing = _FACING.take(frame * 4 + facing)
        out[:, 67:] = _ONE_HOT.take(seen_facing * len(s.SUBGOALS) + subgoals, axis=0)
        return out

    def distance(self, agent: Ints, where: Ints, subgoals: Ints) -> Floats:
        """Steps to each target as if nothing stood in the way, through the passage to the other room. [B]"""
        target = where.take(self._things + TARGET.take(subgoals))
        row = _ROW_OF.take(where[:, Thing.PASSAGE])
        return _DISTANCE.take((agent * (CELLS + 1) + target) * HEIGHT + row)

    def in_world(self, agent: Ints, where: Ints, subgoals: Ints, actions: Ints) -> Ints:
        """Actions chosen in the frames of these states, as the world takes them. [B]"""
        target = where.take(self._things + TARGET.take(subgoals))
        frame = _frames(agent, target, where[:, Thing.PASSAGE])
        return _IN_WORLD.take(frame * ACTIONS + actions)


def _frames(agent: Ints, target: Ints, passage: Ints) -> Ints:
    """The frame of each state: 1 mirrors left and right, 2 up and down. [B]"""
    return _FRAME.take(agent * CELLS + np.where(target == ABSENT, passage, target))
