"""Small charts as SVG text: lines, and shares stacked on each other. A colour is a class of the page's."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

LEFT, RIGHT, TOP, BOTTOM = 44, 12, 10, 30  # pixels around a chart
TICKS = 5
"""Steps between the numbers below a chart, about."""
COLOURS = 8


class Line(NamedTuple):
    """A curve.

    Attributes:
        name: What it is of.
        colour: Number of its class.
        x, y: Its points, x rising. [n]
    """

    name: str
    colour: int
    x: Sequence[float]
    y: Sequence[float]

    def until(self, most_x: float) -> "Line":
        """Its beginning, up to there."""
        count = bisect_right(self.x, most_x)
        return self._replace(x=self.x[:count], y=self.y[:count])


def lines(chart: Sequence[Line], most_x: float, size: tuple[int, int]) -> str:
    """Curves over frames, which run to `most_x`; y runs from 0 to the largest, and to 1 at least."""
    most_y = max(1.0, *(max(line.y) for line in chart))
    frame = _Frame(size, most_x, most_y)
    drawn = [
        f'<polyline class="line c{line.colour}" points="{frame.points(line.x, line.y)}"/>' for line in chart
    ]
    return frame.svg(drawn, f"score over frames: {', '.join(line.name for line in chart)}")


def stacked(shares: Mapping[int, Sequence[float]], x: Sequence[float], size: tuple[int, int], of: str) -> str:
    """Shares that add up to 1, or to 0 where there is nothing, one upon the other.

    Args:
        shares: Colour -> a share for each x. [n]
        x: Where each ends that begins where the one before ended, in frames; rising. [n]
        size: Width and height of the picture.
        of: What it shows, for who can't see it.
    """
    frame = _Frame(size, x[-1], 1.0)
    x = [0.0, *x]
    below = np.zeros(len(x))
    drawn = []
    for colour, share in shares.items():
        above = below + np.asarray([share[0], *share])
        there, back = frame.points(x, above), frame.points(x[::-1], below[::-1])
        drawn.append(f'<polygon class="area c{colour}" points="{there} {back}"/>')
        below = above
    return frame.svg(drawn, of)


class _Frame:
    def __init__(self, size: tuple[int, int], most_x: float, most_y: float) -> None:
        self._width, self._height = size
        self._most_x, self._most_y = most_x or 1.0, most_y

    def points(self, x: Sequence[float] | Numbers, y: Sequence[float] | Numbers) -> str:
        across = LEFT + np.asarray(x) / self._most_x * (self._width - LEFT - RIGHT)
        down = self._height - BOTTOM - np.asarray(y) / self._most_y * (self._height - TOP - BOTTOM)
        return " ".join(f"{a:.1f},{d:.1f}" for a, d in zip(across, down, strict=True))

    def svg(self, drawn: Sequence[str], told: str) -> str:
        left, right, floor = LEFT, self._width - RIGHT, self._height - BOTTOM
        parts = [f'<svg viewBox="0 0 {self._width} {self._height}" role="img" aria-label="{_escaped(told)}">']
        for tick in _ticks(self._most_y, TICKS - 1):
            y = floor - tick / self._most_y * (floor - TOP)
            parts.append(f'<line class="grid" x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
            parts.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:.3g}</text>')
        for tick in _ticks(self._most_x, TICKS):
            x = left + tick / self._most_x * (right - left)
            anchor = "start" if not tick else "end" if tick > 0.9 * self._most_x else "middle"
            parts.append(f'<text x="{x:.1f}" y="{floor + 15}" text-anchor="{anchor}">{tick:,.0f}</text>')
        parts.append(
            f'<text x="{(left + right) / 2:.0f}" y="{floor + 28}" text-anchor="middle">frames</text>'
        )
        return "".join([*parts, *drawn, "</svg>"])


def _ticks(most: float, parts: int) -> list[float]:
    """Round numbers from 0 up to `most`, about so many steps of 1, 2 or 5 and zeros."""
    size = float(10.0 ** np.floor(np.log10(most / parts)))
    step = next(size * times for times in (1, 2, 5, 10) if size * times >= most / parts)
    return [step * number for number in range(int(most / step + 1e-9) + 1)]


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
