"""The figures of a learning curve, all of them over episodes in the order in which they started.

Lanes run side by side, so those that end first are the short ones, and those solve more. A figure over the
first or the latest episodes that ended would flatter what is measured; weighing episodes by their steps would
do the opposite. Of episodes that started one after another, a fair share is solved: but only up to the first
of them that hasn't ended yet.
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

if TYPE_CHECKING:
    from paddlectl.agents.base import Episode

WINDOW = 100
"""Episodes that a figure is over."""
MOMENTS = 100
"""Points of a curve over frames."""


class Ordered(Protocol):
    """An episode by its place in the order of starting."""

    @property
    def order(self) -> int: ...


class Ended(Ordered, Protocol):
    """An episode that ended: when it started and ended, and its score."""

    @property
    def started(self) -> int: ...
    @property
    def finished(self) -> int: ...
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

    def add(self, episodes: "Sequence[Episode]") -> None:
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
        return {"latest_success": None, "latest_score": None}
    return {"latest_success": float((scores > 0).mean()), "latest_score": float(scores.mean())}


class LearningCurve:
    """A finished run's curve, over the episodes in the order in which they started.

    Args:
        ended: All episodes that ended within the run, in any order.
        frames: Of the whole run.
    """

    def __init__(self, ended: Iterable[Ended], frames: int) -> None:
        rows = np.fromiter(((e.order, e.started, e.finished, e.score) for e in ended), _ROW)
        rows.sort(order="order")
        self._frames = frames
        self._ended = len(rows)
        self._first = rows["score"][rows["order"] < WINDOW]
        self._known = rows[rows["order"] == np.arange(len(rows))]

    def figures(self) -> dict[str, float | None]:
        """The run in four numbers; each is None as long as the first episode hasn't ended.

        Returns:
            `jump_start`: mean score of the first 100 episodes started; one that didn't end within the run
            counts as 0. Of a run in which fewer ended, the mean of those up to the first that didn't end.
            `final_score` and `final_success`: of the last 100. `area_under_curve`: the mean of `by_frames`.
        """
        known = self._known["score"]
        if not len(known):
            return dict.fromkeys(("jump_start", "final_score", "final_success", "area_under_curve"))
        last = _rates(known[-WINDOW:])
        return {
            "jump_start": sum(self._first.tolist()) / WINDOW
            if self._ended >= WINDOW
            else float(known.mean()),
            "final_score": last["latest_score"],
            "final_success": last["latest_success"],
            "area_under_curve": float(np.mean(self.by_frames())),
        }

    def by_frames(self) -> list[float]:
        """Mean score of the latest 100 that had started, at 100 moments evenly spread from the start."""
        moments = np.linspace(0, self._frames, MOMENTS, endpoint=False)
        return [self._score(n) for n in np.searchsorted(self._known["started"], moments, side="right")]

    def by_episodes(self, step: int) -> list[float]:
        """Mean score of the latest 100, after every `step` episodes."""
        return [self._score(n) for n in range(step, len(self._known) + 1, step)]

    def frames_to(self, share: float) -> int | None:
        """Frames after which 100 that started one after another had all ended, this share of them solved.

        None if there were none. Counted by their start: those that end early are the lucky ones.
        """
        if len(self._known) < WINDOW:
            return None
        latest = np.lib.stride_tricks.sliding_window_view
        good = latest(self._known["score"] > 0, WINDOW).mean(-1) >= share
        ended = latest(self._known["finished"], WINDOW).max(-1)[good]
        return int(ended.min()) if len(ended) else None

    def _score(self, known: int) -> float:
        scores = self._known["score"][max(0, known - WINDOW) : known]
        return float(scores.mean()) if len(scores) else 0.0


_ROW = np.dtype([("order", np.intp), ("started", np.intp), ("finished", np.intp), ("score", np.float64)])
