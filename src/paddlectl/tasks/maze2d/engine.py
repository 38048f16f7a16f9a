"""The maze tasks in batches: B lanes of raw MuJoCo, stepped together.

`env.PaddleMazeEnv` is the same definition on gymnasium-robotics' PointMaze; a test holds both to it.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from paddlectl.tasks.base import Actions, Bools, Floats, Ints, Split, Step, Task, Vocabulary
from paddlectl.tasks.maze2d import symbols
from paddlectl.tasks.maze2d.layouts import (
    HORIZON,
    PLACES,
    RADIUS,
    SPECS,
    STEPS,
    Points,
    Spec,
    distances,
    draw_starts,
    position_of,
    start_of,
)
from paddlectl.tasks.maze2d.observe import FLAT_SIZE, OBSERVATION_SIZE, flat_state, observe
from paddlectl.tasks.maze2d.physics import PointMasses

ERRAND_REWARD = 10.0
"""For getting a thing, and again for delivering it."""

_BALL = symbols.SUBGOALS.index(symbols.GT_BALL)


def final_rewards() -> Floats:
    """The reward of solving a task in step t, 100 (1 - 0.9 t / T). [T + 1]"""
    return (100 * (1 - 0.9 * np.arange(HORIZON + 1) / HORIZON)).astype(np.float32)


class Engine:
    """B lanes of one task (`tasks.base.Environment`).

    Args:
        spec: The task.
        num_envs: How many are stepped together.
        seed: Of the starts: equal seeds give the same starts in the same order.
        action_repeat: Steps that one action lasts, unless the episode ends before.
        split: Of which the starts are.
    """

    observation_size = OBSERVATION_SIZE
    flat_size = FLAT_SIZE
    actions = Actions(2, continuous=True)

    def __init__(
        self, spec: Spec, num_envs: int, seed: int, action_repeat: int = 1, split: Split = "training"
    ) -> None:
        self.spec = spec
        self.num_envs = num_envs
        self.action_repeat = action_repeat
        self.split: Split = split
        self._rng = np.random.default_rng(seed)
        self._valuations = symbols.valuation_table(spec.atoms)
        self._available = symbols.available_table(spec.subgoals)
        self._after_touch = symbols.touch_table(spec.subgoals)
        self._final_rewards = final_rewards()

        self.t: Ints = np.zeros(num_envs, dtype=np.intp)
        self.facts: Ints = np.zeros(num_envs, dtype=np.intp)
        self.touched: Bools = np.zeros((num_envs, len(PLACES)), dtype=np.bool_)
        self._finished: Bools = np.zeros(num_envs, dtype=np.bool_)
        self._began: Points = np.zeros((num_envs, 2))
        self.masses = PointMasses(num_envs)
        self.reset()

    def reset(self, lanes: Bools | None = None) -> None:
        """Draws new starts for the masked lanes; for all if None. [B]"""
        waiting = np.arange(self.num_envs) if lanes is None else np.flatnonzero(lanes)
        self._start(waiting, draw_starts(self._rng, len(waiting), self.split))

    def set_starts(self, starts: Points) -> None:
        """Starts all lanes from given positions, one a lane. [B, 2]"""
        self._start(np.arange(self.num_envs), starts)

    def start(self, lane: int) -> dict[str, Any]:
        """How the lane's episode began."""
        return start_of(self._began[lane])

    def begin(self, start: Mapping[str, Any]) -> None:
        """Begins all lanes by what `start` told.

        Raises:
            KeyError, TypeError or ValueError: If it can't have told that.
        """
        self.set_starts(np.tile(position_of(start), (self.num_envs, 1)))

    def set_state(self, positions: Points, velocities: Points, facts: Ints, t: Ints) -> None:
        """Puts all lanes into the midst of episodes; called after each step, it keeps what was touched.

        Args:
            positions: In metres. [B, 2]
            velocities: In m/s. [B, 2]
            facts: Bits of `symbols.Fact`. [B]
            t: Steps since each lane's start; an action begins with each multiple of `action_repeat`. [B]
        """
        self.masses.put(np.arange(self.num_envs), positions, velocities)
        self.facts, self.t = facts, t
        self._finished[:] = False
        begins = (t == 0) | ((t - 1) % self.action_repeat == 0)
        self.touched = _touched(positions) | (self.touched & ~begins[:, None])

    def _start(self, lanes: Ints, starts: Points) -> None:
        self.masses.put(lanes, starts)
        self._began[lanes] = starts
        self.t[lanes] = 0
        self.facts[lanes] = 0
        self._finished[lanes] = False
        self.touched[lanes] = _touched(starts)

    def step(self, actions: Floats) -> Step:
        """Applies one force a lane, each component in [-1, 1], for `action_repeat` steps. [B, 2]

        Raises:
            ValueError: If `actions.checked` refuses them.
        """
        actions = self.actions.checked(actions, (self.num_envs,))
        reward, score = np.zeros((2, self.num_envs), dtype=np.float32)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=np.bool_)
        running = np.flatnonzero(~self._finished)
        self.touched[running] = False
        self.masses.push(running, actions[running].astype(np.float64))
        for _ in range(self.action_repeat):
            if not len(running):
                break
            self.masses.step(running)
            self.t[running] += 1
            at = _touched(self.masses.position[running])
            self.touched[running] |= at
            reward[running] += ERRAND_REWARD * self._run_errands(running, at)
            solved = at[:, _BALL] & (self.facts[running] == self.spec.delivered)
            score[running] = solved * self._final_rewards[self.t[running]]
            terminated[running] = solved
            truncated[running] = ~solved & (self.t[running] >= HORIZON)
            running = running[~(terminated | truncated)[running]]
        self._finished |= terminated | truncated
        return Step(reward + score, score, terminated, truncated)

    def _run_errands(self, lanes: Ints, at: Bools) -> Bools:
        """Takes and delivers what lies where these lanes are; whether anything was. [n], [n, 5] -> [n]"""
        before = self.facts[lanes]
        place = at.argmax(-1)  # places are further apart than two radii
        self.facts[lanes] = np.where(at.any(-1), self._after_touch[place, before], before)
        changed: Bools = self.facts[lanes] != before
        return changed

    def valuation(self) -> Bools:
        """E(s): the truth of every atom of the vocabulary, in its order. [B, P]"""
        return self._valuations.take(self.facts, axis=0)

    def observe(self, subgoals: Ints) -> Floats:
        """What the low level sees (`tasks.maze2d.observe`). [B, 6]"""
        return observe(self.masses.position, self.masses.velocity, subgoals)

    def flat_state(self) -> Floats:
        """The whole state as one vector (`tasks.maze2d.observe`). [B, 9]"""
        return flat_state(self.masses.position, self.masses.velocity, self.facts, self.t)

    def distance(self, subgoals: Ints) -> Floats:
        """Steps to each subgoal's place, about, through the maze. [B]"""
        return (STEPS * distances(self.masses.position, subgoals)).astype(np.float32)

    def in_world(self, subgoals: Ints, actions: Floats) -> Floats:
        """The actions themselves: `observe` shows the world as it is. [B, 2]"""
        return actions

    def reached(self, subgoals: Ints) -> Bools:
        """Whether each lane touched its subgoal's place during the latest action. [B]"""
        reached: Bools = self.touched[np.arange(self.num_envs), subgoals]
        return reached

    def available(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal has something to act on and isn't reached already. [B]"""
        return self._available[subgoals, self.facts] & ~self.reached(subgoals)


def _touched(positions: Points) -> Bools:
    """Which places are touched from these positions. [n, 2] -> [n, 5]"""
    offsets = positions[:, None] - PLACES
    touched: Bools = np.einsum("npd,npd->np", offsets, offsets) <= RADIUS**2
    return touched


def make_task(name: str) -> Task:
    """The task of that name."""
    return task_of(SPECS[name])


def task_of(spec: Spec) -> Task:
    """A task of that kind."""
    return Task(
        name=spec.name,
        domain="maze2d",
        summary=spec.summary,
        horizon=HORIZON,
        vocabulary=Vocabulary(spec.atoms, symbols.exclusions(spec.atoms)),
        subgoals=spec.subgoals,
        domain_subgoals=symbols.SUBGOALS,
        make=partial(Engine, spec),
        learner="td3",
        frames=spec.frames,
    )
