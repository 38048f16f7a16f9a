"""Results side by side: by scenario, method and seed, and a figure's values as the statistics take them."""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from paddlectl.registry.names import number_of
from paddlectl.statistics import Sample
from paddlectl.studies.results import Result

T = TypeVar("T")

SCORES = ("area_under_curve", "jump_start", "final_score")
FIGURES = (*SCORES, "frames_to_success")
"""What methods are compared by. Of the last one less is better; it is infinite if a run never got there."""


def one_of_each(
    items: Sequence[T], key: Callable[[T], Hashable], rank: Callable[[T], Any]
) -> tuple[list[T], list[T]]:
    """Of the items with the same key the one of the highest rank; and the others."""
    highest = {key(item): item for item in sorted(items, key=rank)}
    kept = [item for item in items if highest[key(item)] is item]
    return kept, [item for item in items if highest[key(item)] is not item]


def recency(run: str) -> int:
    """The newer a run is, the larger."""
    return number_of(run, "run") or 0


def label_of(method: str, variant: str) -> str:
    """`method` or `method, variant`."""
    return f"{method}, {variant}" if variant else method


class Grouped:
    """Results of which each scenario, target, label and seed has one at most.

    Attributes:
        places: Scenario -> its target. The target is part of the name where two have scenarios of one name.
        labels: As in `label_of`.
    """

    def __init__(self, results: Sequence[Result]) -> None:
        targets: dict[str, set[str]] = {}
        for result in results:
            targets.setdefault(result.scenario, set()).add(result.target)
        self.places: dict[str, str] = {}
        self._cells: dict[tuple[str, str], dict[int, Result]] = {}
        for result in results:
            unclear = len(targets[result.scenario]) > 1
            place = f"{result.scenario} ({result.target})" if unclear else result.scenario
            self.places[place] = result.target
            cell = place, label_of(result.method, result.variant)
            self._cells.setdefault(cell, {})[result.seed] = result
        self.labels = tuple(dict.fromkeys(label_of(result.method, result.variant) for result in results))

    def cell(self, place: str, label: str) -> Mapping[int, Result]:
        """Seed -> result, by seed."""
        return dict(sorted(self._cells.get((place, label), {}).items()))

    def seeds(self, place: str) -> list[int]:
        """Those of any label."""
        return sorted({seed for label in self.labels for seed in self.cell(place, label)})

    def shared(self) -> list[str]:
        """The places where every label has results."""
        return [place for place in self.places if all(self.cell(place, label) for label in self.labels)]

    def sample(self, figure: str, label: str, places: Sequence[str]) -> Sample:
        """The figure's values in each place. [seeds]"""
        return [
            np.array([value_of(figure, result) for result in self.cell(place, label).values()])
            for place in places
        ]

    def differences(self, figure: str, label: str, other: str, places: Sequence[str]) -> Sample:
        """How far the label's values are above the other's, by the seeds that both have. [seeds]"""
        found = []
        for place in places:
            ours, theirs = self.cell(place, label), self.cell(place, other)
            pairs = [(value_of(figure, ours[s]), value_of(figure, theirs[s])) for s in ours if s in theirs]
            # Of two runs that never got there none did so sooner, but how much sooner one did isn't known.
            found.append(
                np.array([x - y if math.isfinite(x) and math.isfinite(y) else np.nan for x, y in pairs])
            )
        return found

    def together(self, labels: Sequence[str], places: Sequence[str]) -> list[int]:
        """A number for each place, the same for those that share runs."""
        runs = [
            {r.cell or r.run for label in labels for r in self.cell(place, label).values()}
            for place in places
        ]
        return [next(first for first, those in enumerate(runs) if those & its) for its in runs]


def value_of(figure: str, result: Result) -> float:
    """The figure of a result; infinite for frames that never sufficed."""
    value = getattr(result, figure)
    return math.inf if value is None else float(value)
