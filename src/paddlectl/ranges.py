"""What numbers a setting may have, told by the type of its field: `learning_rate: Positive = 5e-4`."""

import math
from typing import Annotated, NamedTuple


class Range(NamedTuple):
    """Numbers from `least` to `most`.

    Attributes:
        above: `least` itself isn't among them.
    """

    least: float = -math.inf
    most: float = math.inf
    above: bool = False

    def __contains__(self, value: object) -> bool:
        if not isinstance(value, int | float) or not math.isfinite(value):
            return False
        return (self.least < value if self.above else self.least <= value) and value <= self.most

    def __str__(self) -> str:
        """`from 1 to 4096`, `above 0`, …"""
        least = f"{'above' if self.above else 'from'} {self.least:g}"
        if math.isinf(self.most):
            return least if self.above else f"at least {self.least:g}"
        return f"{least} {'up ' * self.above}to {self.most:g}"


class Many(NamedTuple):
    """Lists of `least` to `most` numbers of a range."""

    each: Range
    least: int = 0
    most: int = 16

    def __contains__(self, value: object) -> bool:
        if not isinstance(value, list | tuple) or not self.least <= len(value) <= self.most:
            return False
        return all(type(item) is int and item in self.each for item in value)

    def __str__(self) -> str:
        return f"a list of {self.least} to {self.most} whole numbers, each {self.each}"


Share = Annotated[float, Range(0.0, 1.0)]
PositiveShare = Annotated[float, Range(0.0, 1.0, above=True)]
Positive = Annotated[float, Range(0.0, above=True)]
NotNegative = Annotated[float, Range(0.0)]
AtLeastOne = Annotated[float, Range(1.0)]
Finite = Annotated[float, Range()]

Count = Annotated[int, Range(1, 10**9)]
Frames = Annotated[int, Range(1, 10**12)]
Environments = Annotated[int, Range(1, 4096)]
Steps = Annotated[int, Range(1, 10**5)]
Kept = Annotated[int, Range(1, 10**8)]
"""Transitions in a memory."""
Hidden = Annotated[tuple[int, ...], Many(Range(1, 10**4), least=1)]
"""Units of each hidden layer."""
