"""The figures of a learning curve, all of them over episodes in the order in which they started.

Lanes run side by side, so those that end first are the short ones, and those solve more. A figure over the
first or the latest episodes that ended would flatter what is measured; weighing episodes by their steps would
do the opposite. Of episodes that started one after another, a fair share is solved: but only up to the first
of them that hasn't ended yet.
"""

from collections.abc import Iterable, Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

WINDOW = 100
"""Episodes that a figure is over."""


class Ended(Protocol):
    """An episode that ended: its place in the order of starting, when it started, and its score."""

    @property
    def order(self) -> int: ...
    @property
    def started(self) -> int: ...
    @property
    def score(self) -> float: ...


E = TypeVar("E", bound=Ended)


class InOrder(Generic[E]):
    """Episodes that end in any order, put in the order in which they started.

    Attributes:
        known: From the first one started on, all up to the first that hasn't ended yet.
    """

    def __init__(self) -> None:
        self.known: list[E] = []
        self._waiting: dict[int, E] = {}

    def add(self, ended: Iterable[E]) -> None:
        """Takes in episodes that ended."""
        self._waiting.update((episode.order, episode) for episode in ended)
        while len(self.known) in self._waiting:
            self.known.append(self._waiting.pop(len(self.known)))


def in_order(ended: Iterable[E]) -> list[E]:
    """Episodes in the order in which they started, up to the first that hasn't ended."""
    order: InOrder[E] = InOrder()
    order.add(ended)
    return order.known


def rates(known: Sequence[Ended]) -> dict[str, float | None]:
    """Success and mean score of the latest 100 of `in_order`; None before the first."""
    scores = np.array([episode.score for episode in known[-WINDOW:]])
    if not len(scores):
        return {"success_rate": None, "mean_score": None}
    return {"success_rate": float((scores > 0).mean()), "mean_score": float(scores.mean())}


def curve_figures(ended: Iterable[Ended], frames: int) -> dict[str, float]:
    """The figures of a learning curve.

    Args:
        ended: All episodes that ended within the run, in any order.
        frames: Of the whole run.

    Returns:
        `jump_start`: mean score of the first 100 episodes started; one that didn't end within the run counts
        as 0. `final_score` and `success_rate`: of the last 100 of `in_order`. `area_under_curve`: the mean,
        over 100 moments evenly spread from the start of the run, of the mean score of the latest 100
        episodes of `in_order` that had started by then.
    """
    ended = list(ended)
    known = in_order(ended)
    scores = np.array([episode.score for episode in known])
    moments = np.linspace(0, frames, 100, endpoint=False)
    started = np.searchsorted([episode.started for episode in known], moments, side="right")
    last = rates(known)
    return {
        "jump_start": sum(e.score for e in ended if e.order < WINDOW) / WINDOW,
        "final_score": last["mean_score"] or 0.0,
        "success_rate": last["success_rate"] or 0.0,
        "area_under_curve": float(np.mean([_mean(scores[max(0, n - WINDOW) : n]) for n in started])),
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0
