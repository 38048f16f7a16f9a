"""A run's entry in the registry while it goes on: its tables, its figures, and how it ended."""

import math
import os
import platform
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from paddlectl import plugins
from paddlectl.errors import IntegrityError
from paddlectl.experiments.curves import Curve
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

if TYPE_CHECKING:
    from paddlectl.agents.base import Episode
    from paddlectl.agents.interaction import Round
    from paddlectl.experiments.jobs import Progress


class Row(NamedTuple):
    """An episode that ended, as the run's table has it."""

    order: int
    started: int
    finished: int
    score: float


class RunLog:
    """What a run has done so far; its tables grow in the run's folder a round at a time.

    Attributes:
        frames: Environment steps.
        curve: How well it does.
        results: Figures to close the run with.
        run: Its id.
    """

    def __init__(self, registry: Registry, run: RunRecord) -> None:
        self.run = run.id
        self.frames = 0
        self.curve = Curve()
        self.results: dict[str, Any] = {}
        self._registry = registry
        self._began = time.monotonic()
        self._before = run if run.resumes else None

    def add(self, round_: "Round") -> None:
        """Takes in a round."""
        self.frames = round_.frames
        self.curve.add(round_.episodes)

    def write(self, round_: "Round") -> None:
        """Appends the round that was just taken in to the run's tables."""
        row = {**self.counts(), **self.curve.rates(), **round_.figures}
        self._registry.files.append_rows(self.run, "episodes", map(_episode_row, round_.episodes))
        self._registry.files.append_rows(self.run, "progress", [row])

    def go_on(self, frames: int, seconds: float) -> None:
        """Counts on from what the run had done before it was stopped."""
        self._before = None
        self.frames = frames
        self._began = time.monotonic() - seconds

    @property
    def goes_on(self) -> bool:
        """Whether it has begun, or gone on if it is resumed."""
        return self._before is None

    def counts(self) -> dict[str, Any]:
        """Frames, episodes and seconds since the start; as they were, of a run that hasn't gone on yet."""
        if self._before is not None:
            return {name: getattr(self._before, name) for name in ("frames", "episodes", "seconds")}
        seconds = round(time.monotonic() - self._began, 3)
        return {"frames": self.frames, "episodes": self.curve.ended, "seconds": seconds}

    def progress(self, total: int, note: str = "") -> "Progress":
        """How far the run is, of `total` frames."""
        from paddlectl.experiments.jobs import Progress

        return Progress(self.run, self.frames, total, self.curve.ended, **self.curve.rates(), note=note)


def ended_episodes(registry: Registry, run: str, *, whole: bool = False) -> Iterator[Row]:
    """All episodes of a run so far in the order in which they ended.

    `whole` is for a run that has ended: its file is read at once, and must be what it was then.

    Raises:
        IntegrityError: If they aren't what was written.
    """
    try:
        files = registry.files
        for row in files.read_rows(run, "episodes") if whole else files.each_row(run, "episodes"):
            yield _ended(row)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise IntegrityError(
            f"the episodes of {run} aren't what was written", "run: paddlectl registry check"
        ) from error


def _ended(row: Mapping[str, Any]) -> Row:
    counts = int(row["order"]), int(row["started"]), int(row["frames"])
    score = float(row["score"])
    if not all(0 <= count < 2**63 for count in counts) or not math.isfinite(score):
        raise ValueError
    return Row(*counts, score)


@contextmanager
def recorded(registry: Registry, run: RunRecord) -> Iterator[RunLog]:
    """Holds the run, and marks it finished, interrupted or failed, whichever way the block is left."""
    log = RunLog(registry, run)
    status = "failed"
    with registry.files.hold(run.id):
        try:
            yield log
            status = "finished"
        except KeyboardInterrupt:
            status = "interrupted"
            raise
        finally:
            if not log.goes_on:
                status = "interrupted"  # it is as it was
            registry.finish_run(run.id, status=status, results=log.results, **log.counts())
        registry.files.drop_checkpoints(run.id)


def versions() -> dict[str, str]:
    """What a run depends on: equal seeds give equal results where these are equal."""
    packages = ("paddlectl", "torch", "numpy", "gymnasium", "minigrid", "gymnasium-robotics", "mujoco")
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": "1",
        **{package: found for package in packages if (found := _installed(package))},
        "paddlectl": version("paddlectl") + _commit(),
        **plugins.versions(),
    }


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@cache
def _commit() -> str:
    """`+g2a34b0c` where the code is a checkout, with `.changed` if it isn't as committed; else empty."""
    root = Path(__file__).parents[3]
    if not (root / ".git").exists():
        return ""
    line = ["git", "-C", str(root), "describe", "--always", "--dirty=.changed", "--exclude=*"]
    reads_only = os.environ | {"GIT_OPTIONAL_LOCKS": "0"}
    try:
        told = subprocess.run(line, env=reads_only, capture_output=True, text=True, timeout=5, check=True)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"+g{told.stdout.strip()}"


def _episode_row(episode: "Episode") -> dict[str, Any]:
    return {
        "order": episode.order,
        "started": episode.started,
        "frames": episode.finished,
        "score": episode.score,
        "length": episode.length,
        "success": episode.score > 0,
    }
