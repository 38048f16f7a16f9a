"""Walks the maze by its map: each lane to one place after another, by the shortest way; nothing learns."""

from collections import deque

import numpy as np

from paddlectl.tasks.maze2d.engine import Engine
from paddlectl.tasks.maze2d.layouts import COLUMNS, MAP, PLACES, ROWS, centre

_MOST = 23.9  # m/s² that a force of 1 gives


def cell_of(position: np.ndarray) -> tuple[int, int]:
    return int(np.floor(ROWS / 2 - position[1])), int(np.floor(position[0] + COLUMNS / 2))


def _next_cells(goal: tuple[int, int]) -> dict[tuple[int, int], tuple[int, int]]:
    """From each free cell the next one on a shortest way to the goal."""
    after, queue = {goal: goal}, deque([goal])
    while queue:
        row, column = cell = queue.popleft()
        for other in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
            if MAP[other[0]][other[1]] != "#" and other not in after:
                after[other] = cell
                queue.append(other)
    return after


NEXT = [_next_cells(cell_of(place)) for place in PLACES]


def force(position: np.ndarray, velocity: np.ndarray, subgoal: int, seconds: float) -> np.ndarray:
    """The force, held so many seconds, that brings one ball on its way to a subgoal's place."""
    cell = cell_of(position)
    ahead = NEXT[subgoal][cell]
    while (after := NEXT[subgoal][ahead]) != ahead and (after[0] == cell[0] or after[1] == cell[1]):
        ahead = after
    goal = PLACES[subgoal] if NEXT[subgoal][ahead] == ahead else np.array(centre(*ahead))
    wanted = ((goal - position) * min(5.0, 0.7 / seconds)).clip(-5.0, 5.0)
    return np.clip((wanted - velocity) / (seconds * _MOST), -1.0, 1.0)


class Walker:
    """Takes each lane of an engine to these subgoals in turn, or to random ones for ever."""

    def __init__(self, *subgoals: int, rng: np.random.Generator | None = None) -> None:
        self._subgoals = subgoals
        self._rng = rng
        self._wanted: np.ndarray = np.zeros(0, np.intp)

    def act(self, env: Engine) -> np.ndarray:
        if not len(self._wanted):
            self._turn, self._wanted = np.zeros((2, env.num_envs), np.intp)
            self._choose(np.arange(env.num_envs))
        there = np.flatnonzero(env.reached(self._wanted))
        self._turn[there] += 1
        self._choose(there)
        masses = env.masses
        seconds = 0.01 * env.action_repeat
        return np.array(
            [
                force(*state, seconds)
                for state in zip(masses.position, masses.velocity, self._wanted, strict=True)
            ],
            np.float32,
        )

    def _choose(self, lanes: np.ndarray) -> None:
        if self._rng:
            self._wanted[lanes] = self._rng.integers(len(PLACES), size=len(lanes))
        else:
            last = len(self._subgoals) - 1
            self._wanted[lanes] = [self._subgoals[min(turn, last)] for turn in self._turn[lanes]]
