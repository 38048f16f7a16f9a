"""Two episodes of a run that can be played again: how each began, and all that was done in it."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl.agents.base import Episode
from paddlectl.tasks.base import Environment, Ints

EARLY = 100
"""Episodes of the early phase."""

LARGEST = 4 << 20
"""Bytes that the actions of the episodes that go on may take; of longer ones none is kept."""


class Choice:
    """Which two episodes are kept, of those that it is told of in the order in which they end.

    `early` is the first solved of the first `EARLY` that began, `late` the latest solved of those after.
    Where none is solved, `early` is the first of all, `late` the latest. In a run that has none after,
    `late` is the latest of the first.
    """

    def __init__(self) -> None:
        self._early: bool | None = None  # whether the one that is kept was solved
        self._late = (False, False)

    def phase(self, episode: Episode) -> str | None:
        """`early` or `late` if the episode is now kept, in the place of what was; None if it isn't."""
        begins, solved = episode.order < EARLY, episode.score > 0
        if begins and (self._early is None or (solved and not self._early)):
            self._early = solved
            return "early"
        rank = (not begins, solved)
        if rank < self._late:
            return None
        self._late = rank
        return "late"


class Recorded(NamedTuple):
    """An episode that can be played again.

    Attributes:
        episode: How it ended.
        start: As `Environment.start` tells it.
        actions: As `Environment.step` took them. [n, ...]
        subgoals: What each action went for, by its place in the domain's subgoals; None without subgoals. [n]
    """

    episode: Episode
    start: Any
    actions: NDArray[Any]
    subgoals: Ints | None


class Recorder:
    """Keeps two of the episodes that are played.

    Args:
        environment: Where; it has `start`.
        horizon: Steps of an episode, at most.

    Attributes:
        kept: `early` and `late`, as far as there are such.
    """

    def __init__(self, environment: Environment, horizon: int) -> None:
        actions, lanes = environment.actions, environment.num_envs
        dtype = actions.dtype if actions.continuous else np.min_scalar_type(actions.size - 1)
        step = np.zeros((lanes, *actions.shape), dtype)
        most = min(-(-horizon // environment.action_repeat), LARGEST // step.nbytes)
        self.kept: dict[str, Recorded] = {}
        self._choice = Choice()
        self._actions = np.repeat(step[None], most, axis=0)  # the latest steps, as a ring
        self._subgoals = np.full((most, lanes), -1, np.int16)
        self._taken = 0

    def add(self, actions: NDArray[Any], subgoals: Ints | None) -> None:
        """Takes in what is done in the next step, and what for. [B, ...], [B]"""
        place = self._taken % len(self._actions)
        self._actions[place] = actions
        if subgoals is not None:
            self._subgoals[place] = subgoals
        self._taken += 1

    def end(self, environment: Any, episode: Episode, lane: int) -> None:
        """Takes in that a lane's episode has ended, before the lane is reset."""
        phase = self._choice.phase(episode)
        length = -(-episode.length // environment.action_repeat)
        if phase is None:
            return
        self.kept.pop(phase, None)
        if length > len(self._actions):
            return
        steps = np.arange(self._taken - length, self._taken) % len(self._actions)
        subgoals = self._subgoals[steps, lane].astype(np.intp)
        self.kept[phase] = Recorded(
            episode,
            environment.start(lane),
            self._actions[steps, lane],
            None if (subgoals < 0).any() else subgoals,
        )
