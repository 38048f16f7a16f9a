"""Progress of runs side by side, on stderr: bars with an estimate on a terminal, else a line now and then."""

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from paddlectl.report.output import clean

EVERY = 10.0  # seconds between two lines of one run


class Tick(Protocol):
    """What a run tells of itself while it goes on."""

    @property
    def run(self) -> str: ...
    @property
    def frames(self) -> int: ...
    @property
    def total(self) -> int: ...
    @property
    def episodes(self) -> int: ...
    @property
    def latest_success(self) -> float | None: ...
    @property
    def latest_score(self) -> float | None: ...
    @property
    def note(self) -> str: ...


class View(Protocol):
    """Shows how far jobs are, which are known by their number."""

    def tick(self, index: int, tick: Tick) -> None:
        """A job is so far."""

    def end(self, index: int) -> None:
        """A job has ended, whichever way."""

    def note(self, text: str) -> None:
        """A line that isn't of one job's progress."""


@contextmanager
def progress(labels: Sequence[str]) -> Iterator[View]:
    """Gives a view of the jobs with these labels; what it costs doesn't depend on how many there are."""
    if not sys.stderr.isatty():
        yield _Lines(labels)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TextColumn("{task.fields[told]}", markup=False),
        TimeRemainingColumn(compact=True),
    )
    console = Console(stderr=True, markup=False, emoji=False, highlight=False)
    with _Bars(*columns, console=console, transient=True) as bars:
        yield _OnTerminal(labels, bars)


class _Bars(Progress):
    """A bar for each job that goes on, and below them a line for all others."""

    others = ""

    def get_renderables(self) -> Iterable[RenderableType]:
        yield self.make_tasks_table(self.tasks)
        if self.others:
            yield Text(self.others)


class _OnTerminal:
    def __init__(self, labels: Sequence[str], bars: _Bars) -> None:
        self._labels = labels
        self._bars = bars
        self._ids: dict[int, TaskID] = {}
        self._done = 0
        self._count()

    def tick(self, index: int, tick: Tick) -> None:
        if index not in self._ids:
            self._ids[index] = self._bars.add_task(clean(self._labels[index]), total=None, told="")
            self._count()
        self._bars.update(self._ids[index], completed=tick.frames, total=tick.total, told=_rates(tick))

    def end(self, index: int) -> None:
        if index in self._ids:
            self._bars.remove_task(self._ids.pop(index))
        self._done += 1
        self._count()

    def note(self, text: str) -> None:
        self._bars.console.print(clean(text))

    def _count(self) -> None:
        left = len(self._labels) - self._done - len(self._ids)
        self._bars.others = f"{self._done} done, {left} to come" if left or self._done else ""


class _Lines:
    def __init__(self, labels: Sequence[str]) -> None:
        self._labels = labels
        self._first: dict[int, tuple[float, int]] = {}
        self._due: dict[int, float] = {}

    def tick(self, index: int, tick: Tick) -> None:
        now = time.monotonic()
        since, frames = self._first.setdefault(index, (now, tick.frames))
        if now < self._due.get(index, now) and tick.frames < tick.total:
            return
        self._due[index] = now + EVERY
        label = f"{clean(self._labels[index])} ({clean(tick.run)})"
        self.note(f"{label}: {_told(tick)}{_left(now - since, tick.frames - frames, tick)}")

    def end(self, index: int) -> None:
        self._first.pop(index, None)
        self._due.pop(index, None)

    def note(self, text: str) -> None:
        print(clean(text), file=sys.stderr, flush=True)


def _told(tick: Tick) -> str:
    return f"{tick.frames:,}/{tick.total:,} frames  {_rates(tick)}"


def _rates(tick: Tick) -> str:
    solved = "no episode has ended yet"
    if tick.latest_success is not None and tick.latest_score is not None:
        solved = f"success {100 * tick.latest_success:.0f} %  score {tick.latest_score:.2f}"
    return f"{solved}  {clean(tick.note)}".rstrip()


def _left(seconds: float, frames: int, tick: Tick) -> str:
    """An estimate by the frames of the latest seconds; those before a run was resumed don't count."""
    if frames <= 0 or tick.frames >= tick.total:
        return ""
    return f"  about {seconds * (tick.total - tick.frames) / frames:.0f} s left at most"
