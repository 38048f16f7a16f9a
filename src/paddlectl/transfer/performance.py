"""The performance Φ of a guide in a target scene (Eq. 2), over two estimates of its return G.

A *candidate* is a pair (guide, its scene), c_S in the paper; candidate 0 is the target itself. Tables
are S target scenes by C candidates.
"""

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]


def performance(return_: Table, entropy: Table, epsilon: float = 0.05) -> Table:
    """Φ = G + max(0, min(-G, ε))·H, in [0, 1] (Eq. 2; the printed min(0, clip(-G, ε)) is a misprint).

    Args:
        return_: G, mean discounted extrinsic return. [S, C]
        entropy: H of the candidate's head distribution, in nats. [S, C]
        epsilon: Largest weight of the entropy, reached when G ≤ -ε.
    """
    bonus = np.clip(-return_, 0.0, epsilon) * entropy
    return np.clip(return_ + bonus, 0.0, 1.0)


class MeanReturns:
    """G as the paper has it: the running mean of the returns from decisions on (Algorithm 2, line 18).

    Args:
        shape: [S, C]
        initial: G before the first sample, "a constant".
    """

    def __init__(self, shape: tuple[int, int], initial: float = 1.0) -> None:
        self.mean = np.full(shape, initial)
        self.count = np.zeros(shape)

    def record(self, scene: int, candidate: int, return_: float) -> None:
        """Adds one sample."""
        self.count[scene, candidate] += 1
        error = return_ - self.mean[scene, candidate]
        self.mean[scene, candidate] += error / self.count[scene, candidate]


class PlannedReturns:
    """G by planning: the return expected if every later scene is led by its best candidate.

    Scenes and candidates make a small semi-Markov decision process. What each candidate's decisions
    earned and where they led is counted, and value iteration runs over the counts. A mean over whole
    episodes blames a good first move for what others did later, and hardly notices two guides that
    undo each other; the plan sees both at once, from few samples.

    Args:
        shape: [S, C]
        discount: γ_h per decision.
        memory: A cell forgets so as to weigh at most about this many of its latest decisions. [C]
    """

    def __init__(self, shape: tuple[int, int], discount: float, memory: Table) -> None:
        scenes, candidates = shape
        self.count = np.zeros(shape)
        self.mean = np.zeros(shape)
        self._discount = discount
        self._forget = 1.0 - 1.0 / memory
        self._reward = np.zeros(shape)
        self._led_to = np.zeros((scenes, candidates, scenes))

    def record(self, scene: int, candidate: int, reward: float, next_scene: int | None) -> None:
        """Adds one decision; `next_scene` is None if the episode ended with it."""
        keep = self._forget[candidate]
        self.count[scene, candidate] = keep * self.count[scene, candidate] + 1.0
        self._reward[scene, candidate] = keep * self._reward[scene, candidate] + reward
        self._led_to[scene, candidate] *= keep
        if next_scene is not None:
            self._led_to[scene, candidate, next_scene] += 1.0

    def sweep(self, values: Table) -> None:
        """One sweep of value iteration: G from the present values of the scenes [S]."""
        total = self._reward + self._discount * (self._led_to @ values)
        self.mean = total / np.maximum(self.count, 1.0)
