"""Progress of runs side by side, on stderr: bars with an estimate on a terminal, else a line now and then."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn

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
    def success_rate(self) -> float | None: ...
    @property
    def mean_score(self) -> float | None: ...
    @property
    def note(self) -> str: ...


Report = Callable[[int, Tick], None]


@contextmanager
def progress(labels: Sequence[str]) -> Iterator[Report]:
    """Gives a function `report(index, tick)` for the jobs with these labels."""
    if sys.stderr.isatty():
        with _bars(labels) as report:
            yield report
    else:
        yield _lines(labels)


@contextmanager
def _bars(labels: Sequence[str]) -> Iterator[Report]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TextColumn("{task.fields[told]}", markup=False),
        TimeRemainingColumn(compact=True),
    )
    console = Console(stderr=True, markup=False, emoji=False, highlight=False)
    with Progress(*columns, console=console, transient=True) as bars:
        ids: list[TaskID] = [bars.add_task(clean(label), total=None, told="starting") for label in labels]

        def report(index: int, tick: Tick) -> None:
            bars.update(ids[index], completed=tick.frames, total=tick.total, told=_rates(tick))

        yield report


def _lines(labels: Sequence[str]) -> Report:
    due = [0.0] * len(labels)
    began = time.monotonic()

    def report(index: int, tick: Tick) -> None:
        now = time.monotonic()
        if now < due[index] and tick.frames < tick.total:
            return
        due[index] = now + EVERY
        left = _left(now - began, tick)
        print(f"{clean(labels[index])} ({clean(tick.run)}): {_told(tick)}{left}", file=sys.stderr, flush=True)

    return report


def _told(tick: Tick) -> str:
    return f"{tick.frames:,}/{tick.total:,} frames  {_rates(tick)}"


def _rates(tick: Tick) -> str:
    solved = "no episode known yet"
    if tick.success_rate is not None and tick.mean_score is not None:
        solved = f"success {100 * tick.success_rate:.0f} %  score {tick.mean_score:.2f}"
    return f"{solved}  {clean(tick.note)}".rstrip()


def _left(passed: float, tick: Tick) -> str:
    if tick.frames <= 0 or tick.frames >= tick.total:
        return ""
    return f"  about {passed * (tick.total / tick.frames - 1):.0f} s left at most"
