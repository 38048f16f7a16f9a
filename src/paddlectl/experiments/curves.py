"""The figures of a learning curve, all of them over episodes in the order in which they started.

Lanes run side by side, so those that end first are the short ones, and those solve more. A figure over the
first or the latest episodes that ended would flatter what is measured; weighing episodes by their steps would
do the opposite. Of episodes that started one after another, a fair share is solved: but only up to the first
of them that hasn't ended yet.
"""

from collections.abc import Iterable, Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from paddlectl.agents.base import Episode

WINDOW = 100
"""Episodes that a figure is over."""


class Ordered(Protocol):
    """An episode by its place in the order of starting."""

    @property
    def order(self) -> int: ...


class Ended(Ordered, Protocol):
    """An episode that ended: when it started, and its score."""

    @property
    def started(self) -> int: ...
    @property
    def score(self) -> float: ...


E = TypeVar("E", bound=Ordered)


class InOrder(Generic[E]):
    """Episodes that end in any order, put in the order in which they started.

    Attributes:
        known: How many there are from the first one started on, up to the first that hasn't ended yet.
    """

    def __init__(self) -> None:
        self.known = 0
        self._waiting: dict[int, E] = {}

    def add(self, ended: Iterable[E]) -> list[E]:
        """Takes in episodes that ended, and gives those that are known by it."""
        self._waiting.update((episode.order, episode) for episode in ended)
        known = []
        while self.known in self._waiting:
            known.append(self._waiting.pop(self.known))
            self.known += 1
        return known


class Known(NamedTuple):
    """An episode by its place in the order of starting, and its score."""

    order: int
    score: float


class Curve:
    """How well a run does; no larger after a million episodes than after a thousand.

    Attributes:
        ended: Episodes that ended.
    """

    def __init__(self) -> None:
        self.ended = 0
        self._order: InOrder[Known] = InOrder()
        self._scores = np.zeros(WINDOW)  # of the latest that are known, the latest last

    @property
    def known(self) -> int:
        """Episodes in the order in which they started, up to the first that hasn't ended."""
        return self._order.known

    def add(self, episodes: Sequence[Episode]) -> None:
        """Takes in episodes that ended."""
        self.ended += len(episodes)
        known = self._order.add(Known(episode.order, episode.score) for episode in episodes)
        self._scores = np.append(self._scores, [episode.score for episode in known])[-WINDOW:]

    def rates(self) -> dict[str, float | None]:
        """Success and mean score of the latest 100 that are known; None before the first."""
        return _rates(self._scores[max(0, WINDOW - self.known) :])


def in_order(ended: Iterable[E]) -> list[E]:
    """Episodes in the order in which they started, up to the first that hasn't ended."""
    return InOrder[E]().add(ended)


def rates(known: Sequence[Ended]) -> dict[str, float | None]:
    """Success and mean score of the latest 100 of `in_order`; None before the first."""
    return _rates(np.array([episode.score for episode in known[-WINDOW:]]))


def _rates(scores: np.ndarray) -> dict[str, float | None]:
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
    rows = np.fromiter(((e.order, e.started, e.score) for e in ended), _ROW)
    first = rows["score"][rows["order"] < WINDOW]
    rows.sort(order="order")
    known = rows[rows["order"] == np.arange(len(rows))]
    scores = known["score"]
    moments = np.linspace(0, frames, 100, endpoint=False)
    started = np.searchsorted(known["started"], moments, side="right")
    last = _rates(scores[-WINDOW:])
    return {
        "jump_start": sum(first.tolist()) / WINDOW,
        "final_score": last["mean_score"] or 0.0,
        "success_rate": last["success_rate"] or 0.0,
        "area_under_curve": float(np.mean([_mean(scores[max(0, n - WINDOW) : n]) for n in started])),
    }


_ROW = np.dtype([("order", np.intp), ("started", np.intp), ("score", np.float64)])


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0
