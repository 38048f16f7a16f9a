"""What the low level sees: the state mapped by a subgoal, 6 numbers, the same for all tasks.

Position of the ball in m, its velocity in units of 2.5 m/s, and the subgoal's place. Neither what is carried
nor what was delivered shows, so a skill works in any task that has its place.
"""

import numpy as np

from paddlectl.tasks.base import Floats, Ints
from paddlectl.tasks.maze2d.layouts import HORIZON, PLACES, Points

OBSERVATION_SIZE = 6
FLAT_SIZE = 9
_SPEED = 2.5


def observe(position: Points, velocity: Points, subgoals: Ints) -> Floats:
    """Position, velocity and the subgoal's place. [B, 6]"""
    return np.hstack([position, velocity / _SPEED, PLACES[subgoals]]).astype(np.float32)


def flat_state(position: Points, velocity: Points, facts: Ints, t: Ints) -> Floats:
    """The whole state, for a learner without subgoals: nothing is left out that the hybrid model is told.

    Position and velocity as above; coffee in hand, coffee delivered, mail in hand, mail delivered (the bits
    of `symbols.Fact`); time left, as a share of the horizon. [B, 9]
    """
    told = (facts[:, None] >> np.arange(4)) & 1
    return np.hstack([position, velocity / _SPEED, told, 1 - t[:, None] / HORIZON]).astype(np.float32)
