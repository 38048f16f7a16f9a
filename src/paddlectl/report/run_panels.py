"""What a figure of a single run shows: its score, and whose share of the decisions was how large."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from paddlectl.errors import NotFoundError
from paddlectl.experiments.curves import MOMENTS, WINDOW, LearningCurve, in_order
from paddlectl.experiments.log import ended_episodes
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.explanation import reuse_rows, weight_rows
from paddlectl.report.mapping import labels_of
from paddlectl.report.panels import SCORE, Panel, Series
from paddlectl.studies.results import EPISODES


def run_panels(registry: Registry, run: RunRecord, axis: str) -> list[Panel]:
    """The run's score and, if it recorded whom it followed, their shares; of one that goes on, so far.

    Raises:
        NotFoundError: If too few episodes have ended.
        IntegrityError: If a table of it isn't what a run writes.
    """
    title, note = f"{run.id}: {run.method} on {run.task}", f"seed {run.seed}, latest {WINDOW} episodes"
    score = Panel(title, note, axis, SCORE, (_score(registry, run, axis),), counted=False)
    return [score, *_followed(registry, run)]


def _score(registry: Registry, run: RunRecord, axis: str) -> Series:
    episodes = in_order(ended_episodes(registry, run.id))
    if len(episodes) < (EPISODES if axis == "episodes" else 1):
        told = f"{len(episodes)} episodes of {run.id} have ended, too few for a curve over {axis}"
        raise NotFoundError(told, registry.way_on(run))
    frames = max(run.frames, *(episode.finished for episode in episodes))  # it may go on
    curve = LearningCurve(episodes, frames)
    if axis == "frames":
        return Series.single(run.method, np.linspace(0, frames, MOMENTS, endpoint=False), curve.by_frames())
    values = curve.by_episodes(EPISODES)
    return Series.single(run.method, EPISODES * np.arange(1, len(values) + 1), values)


def _followed(registry: Registry, run: RunRecord) -> list[Panel]:
    """The share of each in the choices of each period; no panel of a run that reuses nothing."""
    if rows := reuse_rows(registry, run):
        followed, note = _counted(rows, "source"), ""
    else:
        rows = [row for row in weight_rows(registry, run) if "frames" in row]
        followed, note = _counted(rows, "policy"), "in the first episodes, and at the end"
    totals = {frames: of_period.total() for frames, of_period in followed.items()}
    met = [frames for frames in sorted(followed) if totals[frames]]
    if not met:
        return []
    labels = labels_of(registry, run)
    candidates = dict.fromkeys(candidate for of_period in followed.values() for candidate in of_period)
    lines = tuple(
        Series.single(labels(candidate), met, [followed[at][candidate] / totals[at] for at in met])
        for candidate in candidates
    )
    x_label = "frames, at the end of each period"
    return [Panel("who was followed", note, x_label, "share of choices", lines, counted=False)]


def _counted(rows: Iterable[Mapping[str, Any]], who: str) -> dict[int, Counter[str]]:
    """End of a period -> how often each was followed in it."""
    periods: dict[int, Counter[str]] = {}
    for row in rows:
        periods.setdefault(row["frames"], Counter())[row[who]] += row["chosen"]
    return periods
