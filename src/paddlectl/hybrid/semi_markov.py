"""A tabular model of the high level: returns by planning in it, not averaged over whole episodes."""

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]


class SemiMarkovModel:
    """The high level as a semi-Markov decision process (Sutton et al., 1999), counted while it is played.

    In a scene state an option (a subgoal, or a guide) is taken; what its decisions earned and where they led
    is counted, and returns follow by dynamic programming over the counts. A mean over whole episodes
    blames a good first move for what came later, hardly notices two moves that undo each other, and
    waits for episodes to end; the model has none of these faults.

    Args:
        scene_states: R, how many.
        options: O, how many.
        memory: A cell weighs at most about this many of its latest decisions. A number, or one an option.

    Attributes:
        count: Decisions that each cell weighs. [R, O]
    """

    def __init__(self, scene_states: int, options: int, memory: float | Table) -> None:
        self.count: Table = np.zeros((scene_states, options))
        self._keep = np.broadcast_to(1.0 - 1.0 / np.asarray(memory), (options,))
        self._reward: Table = np.zeros((scene_states, options))
        self._led_to: Table = np.zeros((scene_states, options, scene_states))

    def record(
        self, scene_state: int, option: int, reward: float, following: int | None, discount: float
    ) -> None:
        """Counts one decision.

        Args:
            scene_state: Where it was taken.
            option: What was taken.
            reward: What it earned.
            following: The scene state that it led to, None if the episode ended.
            discount: γ of the whole decision; smaller for a longer one.
        """
        cell, keep = (scene_state, option), self._keep[option]
        self.count[cell] = keep * self.count[cell] + 1.0
        self._reward[cell] = keep * self._reward[cell] + discount * reward
        self._led_to[cell] *= keep
        if following is not None:
            self._led_to[cell][following] += discount

    def returns(self, values: Table, prior: float = 0.0) -> Table:
        """G of every option: mean reward plus discounted value of where it led.

        Args:
            values: Of the scene states. [R]
            prior: Decisions' worth of belief that an option is worth as much as its scene state.

        Returns:
            [R, O]; 0 for an option without decisions and prior.
        """
        total = self._reward + self._led_to @ values + prior * values[:, None]
        returns: Table = total / np.maximum(self.count + prior, 1e-9)
        return returns
