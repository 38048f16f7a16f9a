"""What the low level sees: the state mapped by a subgoal, 6 numbers, the same for all tasks.

Position of the ball in m, its velocity in units of 2.5 m/s, and the subgoal's place. Neither what is carried
nor what was delivered shows, so a skill works in any task that has its place.
"""

import numpy as np

from paddlectl.tasks.base import Floats, Ints
from paddlectl.tasks.maze2d.layouts import PLACES, Points

OBSERVATION_SIZE = 6
_SPEED = 2.5


def observe(position: Points, velocity: Points, heads: Ints) -> Floats:
    """Position, velocity and the subgoal's place. [B, 6]"""
    return np.hstack([position, velocity / _SPEED, PLACES[heads]]).astype(np.float32)
