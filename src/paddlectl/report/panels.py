"""What a figure shows, as numbers: panels of lines with their bands, each line a method over its seeds."""

import csv
import io
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paddlectl.experiments.curves import MOMENTS
from paddlectl.statistics import Sample, interquartile_mean, interval
from paddlectl.studies.results import EPISODES, Result

Floats = NDArray[np.float64]

SCORE = "score"
AXES = ("frames", "episodes")
RESAMPLES = 2000
DIGITS = 6
FIELDS = ("panel", "note", "label", "x", "mid", "low", "high", "n")


@dataclass(frozen=True)
class Series:
    """A line, and the band around it.

    Attributes:
        x: Where its points are, ascending. [points], as are the next three.
        low: Lower end of the interval; equal to `mid` if it is over one seed.
        n: Seeds that it is over.
    """

    label: str
    x: tuple[float, ...]
    mid: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    n: int

    @classmethod
    def single(cls, label: str, x: Iterable[float], values: Iterable[float]) -> "Series":
        """A line without a band."""
        y = tuple(round(float(value), DIGITS) for value in values)
        return cls(label, tuple(map(float, x)), y, y, y, 1)


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        note: What stands below the title.
        counted: Whether its lines are over seeds.
    """

    title: str
    note: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    counted: bool = True

    @property
    def seeds(self) -> str:
        """How many seeds its lines are over: `n = 6`, or `n = 4–6`."""
        least, most = min(one.n for one in self.series), max(one.n for one in self.series)
        return f"n = {most if least == most else f'{least}–{most}'}"


def band(curves: Floats, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """The interquartile mean over seeds, and its 95 % bootstrap interval.

    Args:
        curves: [seeds, points]
        rng: Draws the resamples of seeds.

    Returns:
        Mean, lower and upper end. [points] each
    """

    def mean(seeds: Sample) -> Floats:
        return interquartile_mean([np.moveaxis(curves[seeds[0].astype(np.intp)], -2, -1)])

    every = np.arange(float(len(curves)))
    if len(curves) == 1:
        return curves[0], curves[0], curves[0]
    return mean([every]), *interval(mean, [every], generator=rng, resamples=RESAMPLES)


def panels_of(results: Iterable[Result], axis: str) -> list[Panel]:
    """A panel for each scenario, a line for each method and variant, in the order in which they come.

    A line goes as far as every seed of it. Of a cell that is told twice the latter counts. Runs that are too
    short to have figures are left out.

    Args:
        results: Of a study.
        axis: One of AXES.
    """
    cells: dict[str, dict[str, dict[int, Result]]] = {}
    for result in filter(operator.attrgetter("has_figures"), results):
        label = f"{result.method}, {result.variant}" if result.variant else result.method
        cells.setdefault(result.scenario, {}).setdefault(label, {})[result.seed] = result
    return [_panel(scenario, lines, axis) for scenario, lines in cells.items()]


def _panel(scenario: str, lines: dict[str, dict[int, Result]], axis: str) -> Panel:
    aligned = _over_frames if axis == "frames" else _over_episodes
    series = tuple(_series(label, [*seeds.values()], aligned) for label, seeds in lines.items())
    targets = {result.target for seeds in lines.values() for result in seeds.values()}
    return Panel(scenario, ", ".join(sorted(targets - {scenario})), axis, SCORE, series)


def _series(
    label: str,
    results: Sequence[Result],
    aligned: Callable[[Sequence[Result]], tuple[Floats, Floats]],
) -> Series:
    return mean_line(label, *aligned(results))


def mean_line(label: str, x: Floats, curves: Floats) -> Series:
    """The interquartile mean of curves with its interval. [points], [seeds, points]"""
    mid, low, high = (_rounded(values) for values in band(curves, np.random.default_rng(0)))
    return Series(label, _rounded(x), mid, low, high, len(curves))


def _over_frames(results: Sequence[Result]) -> tuple[Floats, Floats]:
    """Moments up to the end of the shortest run, and the scores there. [points], [seeds, points]"""
    points = MOMENTS if all(result.by_frames for result in results) else 0
    x = np.linspace(0, min(result.frames for result in results), points, endpoint=False)
    curves = []
    for result in results:
        own = np.linspace(0, result.frames, len(result.by_frames), endpoint=False)
        curves.append(np.interp(x, own, result.by_frames) if points else x)
    return x, np.array(curves)


def _over_episodes(results: Sequence[Result]) -> tuple[Floats, Floats]:
    """Likewise, over episodes."""
    points = min(len(result.by_episodes) for result in results)
    curves = np.array([result.by_episodes[:points] for result in results])
    return EPISODES * np.arange(1.0, points + 1), curves


def _rounded(values: Floats) -> tuple[float, ...]:
    return tuple(values.round(DIGITS).tolist())


def csv_text(panels: Iterable[Panel]) -> str:
    """The numbers that a figure shows, a row a point; without an interval where none is shown."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(FIELDS)
    for panel in panels:
        for one in panel.series:
            for x, mid, *ends in zip(one.x, one.mid, one.low, one.high, strict=True):
                shown = (x, mid, *(ends if one.n > 1 else ("", "")))
                numbers = (f"{value:.12g}" if value != "" else "" for value in shown)
                table.writerow((panel.title, panel.note, one.label, *numbers, one.n))
    return text.getvalue()
