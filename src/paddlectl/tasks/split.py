"""Which layouts are for training and which for evaluation: by their value, whatever seed draws them."""

from typing import get_args

import numpy as np
from numpy.typing import NDArray

from paddlectl.tasks.base import Bools, Ints, Split

ONE_IN = 8
"""One layout in so many is for evaluation."""


def checked_split(split: Split) -> Split:
    """The split itself.

    Raises:
        ValueError: If there is none of that name.
    """
    if split not in get_args(Split):
        raise ValueError(f"a split is training or evaluation, not {split!r}")
    return split


def belongs(values: Ints, split: Split) -> Bools:
    """Whether layouts belong to a split.

    A row of whole numbers says what a layout is. Equal rows are of one split; of unequal ones about an
    eighth are for evaluation, told by a hash (the mixer of SplitMix64; Steele, Lea & Flood, 2014).

    Args:
        values: What each layout is. [n, K]
        split: Which.

    Returns:
        [n]
    """
    key = np.zeros(len(values), np.uint64)
    for column in values.astype(np.uint64).T:
        key = _mixed(key + column + np.uint64(0x9E3779B97F4A7C15))
    chosen: Bools = (key % np.uint64(ONE_IN) == 0) == (checked_split(split) == "evaluation")
    return chosen


def _mixed(key: NDArray[np.uint64]) -> NDArray[np.uint64]:
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: NDArray[np.uint64] = key ^ (key >> np.uint64(31))
    return mixed
