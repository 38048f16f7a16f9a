"""Methods side by side: their figures with intervals over seeds, and each against a chosen one."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from paddlectl import statistics
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.names import nearest, shown
from paddlectl.statistics import Sample
from paddlectl.studies.grouped import FIGURES, SCORES, Grouped, one_of_each, recency
from paddlectl.studies.results import Result
from paddlectl.studies.verdicts import UNDECIDED, notes_of, sentences, verdict_of

Document: TypeAlias = dict[str, Any]

CHOSEN = "paddle"
RESAMPLES = 10_000
PROFILE = 2_000  # resamples of a performance profile
THRESHOLDS = 51


def comparison_document(
    results: Sequence[Result], of: str | None = None, notes: Sequence[str] = ()
) -> Document:
    """All that can be said of the results. The same results give the same numbers.

    Of several of one scenario, label and seed the newest run counts. An estimate is `{value, low, high}`; the
    ends are None where a scenario has one seed only, and an infinite number of frames is never.

    Args:
        results: One or more.
        of: The label that each other one is compared with; else `paddle` if it is there, else the first.
        notes: What else a reader must know of them.

    Returns:
        of: The chosen label.
        places: `[{scenario, target}]`.
        cells: Of each scenario and label its n, seeds, and each figure's `iqm`, `mean` and `median`.
        overall: Of each label the same over the scenarios that all have, and the `optimality_gap`.
        against: Of each other label, in each scenario that both have and over all (None), each figure's
            `probability_of_improvement`, `difference` and `verdict`.
        best: Of each scenario and over all (None), and each figure, the best label and its ties.
        profiles: Of each label and score, the share of runs above each threshold.
        verdicts: Each figure -> what `against` says, in words.
        notes: What limits all that.

    Raises:
        NotFoundError: If there are no results of that label.
        UsageError: If no run was long enough to have figures.
    """
    long = [result for result in results if result.has_figures]
    if not long:
        raise UsageError(
            "no run is long enough to have figures: none has an episode that ended", "give more --frames"
        )
    kept, older = one_of_each(
        long, lambda r: (r.scenario, r.target, r.method, r.variant, r.seed), lambda r: recency(r.run)
    )
    grouped = Grouped(kept)
    chosen = _chosen(grouped.labels, of)
    made = _Comparison(grouped, chosen)
    against = made.against()
    return {
        "of": chosen,
        "places": [{"scenario": place, "target": target} for place, target in grouped.places.items()],
        "labels": list(grouped.labels),
        "cells": made.cells(),
        "overall": made.overall(),
        "against": against,
        "best": made.best(),
        "profiles": made.profiles(),
        "verdicts": {figure: sentences(chosen, against, figure) for figure in FIGURES},
        "intervals": {
            "level": statistics.LEVEL,
            "method": "expanded percentile bootstrap over seeds, scenarios are strata",
            "resamples": RESAMPLES,
            "coverage": {str(seeds): list(share) for seeds, share in statistics.COVERAGE.items()},
        },
        "notes": [*notes, *notes_of(grouped, chosen, len(older), len(results) - len(long))],
    }


def _chosen(labels: Sequence[str], of: str | None) -> str:
    if of is None:
        return CHOSEN if CHOSEN in labels else labels[0]
    if of not in labels:
        hint = f"{nearest(of, labels)}one of: {'; '.join(labels)}"
        raise NotFoundError(f"no results of {shown(of)} are compared", hint)
    return of


def _scenario(places: Sequence[str]) -> str | None:
    """None stands for over all."""
    return places[0] if len(places) == 1 else None


def _mean_or_none(counts: Sequence[int | None]) -> int | None:
    known = [count for count in counts if count is not None]
    return round(sum(known) / len(known)) if len(known) == len(counts) else None


class _Comparison:
    def __init__(self, grouped: Grouped, chosen: str) -> None:
        self._grouped, self._chosen = grouped, chosen
        self._others = [label for label in grouped.labels if label != chosen]
        self._shared = grouped.shared()
        self._generator = np.random.default_rng(0)
        self._known: dict[tuple[str, ...], Document] = {}

    def cells(self) -> list[Document]:
        rows = []
        for place, target in self._grouped.places.items():
            for label in self._grouped.labels:
                if cell := self._grouped.cell(place, label):
                    row = {"scenario": place, "target": target, "label": label, "n": len(cell)}
                    runs = list(cell.values())
                    row |= {"method": runs[0].method, "variant": runs[0].variant, "seeds": list(cell)}
                    row["source_frames"] = _mean_or_none([run.source_frames for run in runs])
                    rows.append(row | self._figures(label, [place], statistics.seed_median))
        return rows

    def overall(self) -> Document:
        """Of places that all labels have, if there are several."""
        rows = []
        for label in self._grouped.labels if len(self._shared) > 1 else ():
            n = sum(len(self._grouped.cell(place, label)) for place in self._shared)
            rows.append({"label": label, "n": n, **self._figures(label, self._shared, statistics.median)})
            for figure in SCORES:
                sample = self._grouped.sample(figure, label, self._shared)
                gap = self._estimate(statistics.optimality_gap, sample, together=self._together(label))
                rows[-1][figure]["optimality_gap"] = gap if self._bounded(figure) else None
        return {"scenarios": self._shared if rows else [], "labels": rows}

    def _figures(self, label: str, places: Sequence[str], median: Callable[[Sample], Any]) -> Document:
        kinds = {"iqm": statistics.interquartile_mean, "mean": statistics.mean, "median": median}
        together = self._grouped.together([label], places)
        figures: Document = {}
        for figure in FIGURES:
            sample = self._grouped.sample(figure, label, places)
            figures[figure] = {
                name: self._estimate(kind, sample, together=together) for name, kind in kinds.items()
            }
        reached = sum(int(np.isfinite(values).sum()) for values in sample)
        figures["frames_to_success"]["reached"] = reached
        return figures

    def against(self) -> list[Document]:
        return [
            self._pair(other, places)
            for other in self._others
            for places in self._scopes
            if {other, self._chosen} <= set(self._present(places))
        ]

    def _pair(self, other: str, places: Sequence[str]) -> Document:
        n = [sum(len(self._grouped.cell(p, label)) for p in places) for label in (self._chosen, other)]
        pairs = self._grouped.differences(FIGURES[0], self._chosen, other, places)
        row: Document = {"label": other, "scenario": _scenario(places)}
        row |= {"n": n, "pairs": sum(map(len, pairs))}
        return row | {figure: self._versus(figure, self._chosen, other, places) for figure in FIGURES}

    def _versus(self, figure: str, label: str, other: str, places: Sequence[str]) -> Document:
        """Drawn once, so that what is said of the same two twice is the same."""
        key = (figure, label, other, *places)
        if key not in self._known:
            self._known[key] = self._drawn(figure, label, other, places)
        return self._known[key]

    def _drawn(self, figure: str, label: str, other: str, places: Sequence[str]) -> Document:
        sign = 1 if figure in SCORES else -1
        ours, theirs = (
            [sign * values for values in self._grouped.sample(figure, each, places)]
            for each in (label, other)
        )
        together = self._grouped.together([label, other], places)
        above = self._estimate(statistics.probability_of_improvement, ours, theirs, together=together)
        return {
            "probability_of_improvement": above,
            "difference": self._difference(figure, label, other, places),
            "verdict": verdict_of(above, statistics.separable(ours, theirs, together)),
        }

    def _difference(self, figure: str, label: str, other: str, places: Sequence[str]) -> Document | None:
        """Of the means, by pairs of seeds; None if a scenario has none, or a run of them never got there."""
        pairs = self._grouped.differences(figure, label, other, places)
        if any(not len(values) or np.isnan(values).any() for values in pairs):
            return None
        return self._estimate(statistics.mean, pairs, together=self._grouped.together([label, other], places))

    def best(self) -> list[Document]:
        return [
            {"scenario": _scenario(places), "figure": figure, "labels": self._best(figure, places)}
            for places in self._scopes
            for figure in FIGURES
        ]

    @property
    def _scopes(self) -> list[list[str]]:
        """Each scenario; and all that every label has, if these are several."""
        alone = [[place] for place in self._grouped.places]
        return [*alone, self._shared] if len(self._shared) > 1 else alone

    def _present(self, places: Sequence[str]) -> list[str]:
        """The labels that have results in all of the places."""
        return [label for label in self._grouped.labels if all(self._grouped.cell(p, label) for p in places)]

    def _best(self, figure: str, places: Sequence[str]) -> list[str]:
        """The label of the best mean, of frames the best median, and those that aren't told apart from it."""
        labels = self._present(places)
        sign, centre = (1, statistics.mean) if figure in SCORES else (-1, statistics.seed_median)
        centres = {
            label: sign * float(centre(self._grouped.sample(figure, label, places))) for label in labels
        }
        first = max(centres, key=lambda label: centres[label])
        return [label for label in labels if label == first or not self._apart(figure, first, label, places)]

    def _apart(self, figure: str, first: str, label: str, places: Sequence[str]) -> bool:
        """By the difference; where a run never got there, by P(improvement)."""
        versus = self._versus(figure, first, label, places)
        difference = versus["difference"]
        if versus["verdict"] == UNDECIDED or difference is None:
            return versus["verdict"] in ("ahead", "behind")
        return difference["low"] is not None and not difference["low"] <= 0 <= difference["high"]

    def profiles(self) -> list[Document]:
        return [
            self._profile(figure, label)
            for figure in SCORES
            for label in self._grouped.labels
            if self._shared
        ]

    def _profile(self, figure: str, label: str) -> Document:
        thresholds = np.linspace(*self._range(figure), THRESHOLDS)

        def profile(sample: Sample) -> Any:
            return statistics.performance_profile(sample, thresholds)

        sample = self._grouped.sample(figure, label, self._shared)
        estimate = self._estimate(profile, sample, together=self._together(label), resamples=PROFILE)
        return {"label": label, "figure": figure, "thresholds": thresholds.tolist(), **estimate}

    def _together(self, label: str) -> list[int]:
        return self._grouped.together([label], self._shared)

    def _bounded(self, figure: str) -> bool:
        low, high = self._range(figure)
        return (low, high) == (0.0, 1.0)

    def _range(self, figure: str) -> tuple[float, float]:
        """[0, 1] if all values over the shared places are in it, else what they reach."""
        samples = (self._grouped.sample(figure, label, self._shared) for label in self._grouped.labels)
        values = np.concatenate([array for sample in samples for array in sample])
        low, high = float(values.min()), float(values.max())
        return (0.0, 1.0) if low >= 0.0 and high <= 1.0 else (low, high)

    def _estimate(
        self,
        statistic: statistics.Statistic,
        *samples: Sample,
        together: Sequence[int],
        resamples: int = RESAMPLES,
    ) -> Document:
        value = np.asarray(statistic(*samples)).tolist()
        if min(len(values) for sample in samples for values in sample) < 2:
            return {"value": value, "low": None, "high": None}
        ends = statistics.interval(
            statistic, *samples, generator=self._generator, together=together, resamples=resamples
        )
        low, high = (np.asarray(end).tolist() for end in ends)
        return {"value": value, "low": low, "high": high}
