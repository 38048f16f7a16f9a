"""Exploration by goals: some of the time a lane goes to a place seen before, instead of to its goal."""

import numpy as np
from numpy.typing import NDArray

from paddlectl.learners.replay import Replay

Floats = NDArray[np.float32]


class GoalExploration:
    """Which lanes explore, and where they go to.

    A goal that nobody ever came upon can't be learned, and from the same few places nobody comes upon it.
    From a random one of all places seen, a lane that then turns to its goal again looks around elsewhere
    (as in Go-Explore; Ecoffet et al., 2021).

    Args:
        goal_size: Numbers at the end of an observation that say where the lane wants to.
        steps: Actions that a lane keeps such a goal, on average.
    """

    def __init__(self, goal_size: int, steps: float) -> None:
        self._steps = steps
        self._goals: Floats = np.zeros((0, goal_size), np.float32)

    def send(self, observations: Floats, replay: Replay, share: float, rng: np.random.Generator) -> Floats:
        """Gives and takes such goals by chance.

        Args:
            observations: [B, D]
            replay: Knows the places.
            share: Of the time that is spent on such goals.
            rng: Of the draws.

        Returns:
            The observations, of lanes that explore with that goal. [B, D]
        """
        count, size = len(observations), self._goals.shape[1]
        if len(self._goals) != count:
            self._goals = np.full((count, size), np.nan, np.float32)
        anew = np.flatnonzero(rng.random(count) < 1.0 / self._steps)
        if len(anew):
            places = replay.places(len(anew), rng)
            self._goals[anew] = np.where(rng.random((len(anew), 1)) < share, places, np.nan)
        own = observations[:, -size:]
        goals = np.where(np.isnan(self._goals), own, self._goals)
        return np.hstack([observations[:, :-size], goals])
