"""The performance Φ of a guide in a target scene (Eq. 2), over the running mean of its return G.

A *candidate* is a pair (guide, its scene), c_S in the paper; candidate 0 is the target itself. Tables
are S target scenes by C candidates.
"""

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]


def performance(return_: Table, entropy: Table, epsilon: float = 0.05, *, clipped: bool = True) -> Table:
    """Φ = G + max(0, min(-G, ε))·H (Eq. 2; the printed min(0, clip(-G, ε)) is a misprint).

    Args:
        return_: G, mean discounted extrinsic return. [S, C]
        entropy: H of the candidate's subgoal distribution, in nats. [S, C]
        epsilon: Largest weight of the entropy, reached when G ≤ -ε.
        clipped: To [0, 1].
    """
    bonus = np.clip(-return_, 0.0, epsilon) * entropy
    return np.clip(return_ + bonus, 0.0, 1.0) if clipped else return_ + bonus


class MeanReturns:
    """G as the paper has it: the running mean of the returns from decisions on (Algorithm 2, line 18).

    Args:
        shape: [S, C]
        initial: G before the first sample, "a constant".
    """

    def __init__(self, shape: tuple[int, int], initial: float) -> None:
        self.mean = np.full(shape, initial)
        self.count = np.zeros(shape)

    def record(self, row: int, column: int, return_: float) -> None:
        """Adds one sample."""
        self.count[row, column] += 1
        error = return_ - self.mean[row, column]
        self.mean[row, column] += error / self.count[row, column]
