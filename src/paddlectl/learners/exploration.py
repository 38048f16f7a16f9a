"""How a learner explores: where it goes, how it acts there, and what it is paid for."""

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


class HeldActions:
    """Random actions that last, and are strong: each of their numbers is half of the largest at least.

    Who draws anew each time hardly gets away from where it is: one action undoes another.

    Args:
        actions: A, numbers in an action.
        steps: Actions that one is held, on average.
    """

    def __init__(self, actions: int, steps: float) -> None:
        self._steps = steps
        self._held: Floats = np.zeros((0, actions), np.float32)

    def replace(self, actions: Floats, share: Floats, rng: np.random.Generator) -> Floats:
        """Draws some anew by chance.

        Args:
            actions: Of lanes that hold none. [B, A]
            share: Of the time that each lane holds one. [B]
            rng: Of the draws.

        Returns:
            The actions, of lanes that hold one that. [B, A]
        """
        if len(self._held) != len(actions):
            self._held = np.full(actions.shape, np.nan, np.float32)
        anew = np.flatnonzero(rng.random(len(actions)) < 1.0 / self._steps)
        if len(anew):
            drawn = rng.uniform(-1.0, 1.0, (len(anew), actions.shape[1]))
            strong = (drawn + np.sign(drawn)) / 2.0
            self._held[anew] = np.where(rng.random((len(anew), 1)) < share[anew, None], strong, np.nan)
        return np.where(np.isnan(self._held), actions, self._held)


class Novelty:
    """A bonus for states that were hardly seen: 1/√n after n visits (Tang et al., 2017).

    A reward that chance hardly comes upon is found by who is paid for looking around. States are one if their
    numbers are equal once rounded, in the maze about those of a cell.

    Args:
        size: D, numbers in a state.
    """

    def __init__(self, size: int) -> None:
        self._code = np.random.default_rng(0).integers(2**62, size=size)
        self._visits = np.zeros(2**18, np.int32)  # where two codes meet, their states are taken for one

    def count(self, states: Floats) -> None:
        """Takes visits down. [..., D]"""
        np.add.at(self._visits, self._places(states), 1)

    def bonus(self, states: Floats) -> Floats:
        """Of each state; 1 of one never seen. [n, D] -> [n]"""
        visits = self._visits[self._places(states)].clip(min=1)
        bonus: Floats = (1.0 / np.sqrt(visits)).astype(np.float32)
        return bonus

    def _places(self, states: Floats) -> NDArray[np.int64]:
        """Where in the table each state is counted. [..., D] -> [...]"""
        places: NDArray[np.int64] = np.rint(states).astype(np.int64) @ self._code % len(self._visits)
        return places
