"""A curve in one line of a terminal."""

from collections.abc import Sequence

import numpy as np

BLOCKS = "▁▂▃▄▅▆▇█"
LETTERS = "_.:-=+*#"
"""For an encoding that lacks one of the blocks."""


def sparkline(values: Sequence[float], width: int, encoding: str = "utf-8") -> str:
    """The values as bars between 0 and 1, or their largest if that is more.

    Args:
        values: Finite; each bar is the mean of equally many.
        width: Bars at most.
        encoding: That the line is shown in.
    """
    if not values:
        return ""
    marks = BLOCKS if _encodes(encoding, BLOCKS) else LETTERS
    means = [float(part.mean()) for part in np.array_split(np.array(values), min(width, len(values)))]
    top = max(1.0, *means)
    return "".join(marks[round(max(0.0, mean) / top * (len(marks) - 1))] for mean in means)


def _encodes(encoding: str, text: str) -> bool:
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True
