"""A run's entry in the registry while it goes on: its tables, its figures, and how it ended."""

import platform
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import distributions, version
from typing import Any

import numpy as np

from paddlectl.experiments.jobs import Progress
from paddlectl.hybrid.rollout import Episode
from paddlectl.hybrid.training import Round
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

WINDOW = 100
"""Episodes that `jump_start`, `final_score` and the progress figures are over."""


class RunLog:
    """What a run has done so far; its tables grow in the run's folder a round at a time.

    Attributes:
        frames: Environment steps.
        episodes: In the order in which they ended.
        results: Figures to close the run with.
        run: Its id.
    """

    def __init__(self, registry: Registry, run: RunRecord) -> None:
        self.run = run.id
        self.frames = 0
        self.episodes: list[Episode] = []
        self.results: dict[str, Any] = {}
        self._registry = registry
        self._began = time.monotonic()

    def add(self, round_: Round, **figures: float) -> None:
        """Takes in a round and appends it, with further figures, to the run's tables."""
        self.frames = round_.frames
        self.episodes += round_.episodes
        row = {**self.counts(), **self._rates(), **figures}
        self._registry.append_rows(self.run, "episodes", map(_episode_row, round_.episodes))
        self._registry.append_rows(self.run, "progress", [row])

    def go_on(self, frames: int, seconds: float) -> None:
        """Counts on from what the run had done before it was stopped."""
        self.frames = frames
        self._began = time.monotonic() - seconds

    def counts(self) -> dict[str, Any]:
        """Frames, episodes and seconds since the start."""
        seconds = round(time.monotonic() - self._began, 3)
        return {"frames": self.frames, "episodes": len(self.episodes), "seconds": seconds}

    def progress(self, total: int, note: str = "") -> Progress:
        """How far the run is, of `total` frames."""
        return Progress(self.run, self.frames, total, len(self.episodes), **self._rates(), note=note)

    def _rates(self) -> dict[str, float]:
        scores = np.array([episode.score for episode in self.episodes[-WINDOW:]] or [0.0])
        return {"success_rate": float((scores > 0).mean()), "mean_score": float(scores.mean())}


@contextmanager
def recorded(registry: Registry, run: RunRecord) -> Iterator[RunLog]:
    """Holds the run, and marks it finished, interrupted or failed, whichever way the block is left."""
    log = RunLog(registry, run)
    status = "failed"
    with registry.hold(run.id):
        try:
            yield log
            status = "finished"
        except KeyboardInterrupt:
            status = "interrupted"
            raise
        finally:
            registry.finish_run(run.id, status=status, results=log.results, **log.counts())
        registry.drop_checkpoints(run.id)


def curve_figures(episodes: Sequence[Episode], frames: int) -> dict[str, float]:
    """The figures of a learning curve.

    Args:
        episodes: In the order in which they ended.
        frames: Of the whole run.

    Returns:
        `jump_start`: mean score of the first 100 episodes started; lanes that finish early are the lucky
        ones, so one that didn't end within the run counts as 0. `final_score` and `success_rate`: of the
        last 100 that ended. `area_under_curve`: mean over 100 equal spans of the run of the mean score of
        the latest 100 episodes, 0 before the first.
    """
    scores = np.array([episode.score for episode in episodes])
    ended = np.array([episode.finished for episode in episodes])
    first = [episode.score for episode in episodes if episode.order < WINDOW]
    spans = np.searchsorted(ended, frames * np.arange(1, 101) / 100, side="right")
    return {
        "jump_start": sum(first) / WINDOW,
        "final_score": _mean(scores[-WINDOW:]),
        "success_rate": _mean(scores[-WINDOW:] > 0),
        "area_under_curve": float(np.mean([_mean(scores[max(0, n - WINDOW) : n]) for n in spans])),
    }


def versions() -> dict[str, str]:
    """What a run depends on: equal seeds give equal results where these are equal."""
    packages = ("paddlectl", "torch", "numpy", "gymnasium", "minigrid", "gymnasium-robotics", "mujoco")
    installed = {distribution.name for distribution in distributions()}
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": "1",
        **{package: version(package) for package in packages if package in installed},
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else 0.0


def _episode_row(episode: Episode) -> dict[str, Any]:
    return {
        "order": episode.order,
        "started": episode.started,
        "frames": episode.finished,
        "score": episode.score,
        "length": episode.length,
        "success": episode.score > 0,
        "decisions": len(episode.decisions.scenes),
    }
