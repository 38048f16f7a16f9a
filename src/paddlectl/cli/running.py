"""Runs jobs with their progress on stderr, and says how to go on with those that were stopped."""

import statistics
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from paddlectl.cli.texts import here
from paddlectl.errors import NotFoundError, PaddlectlError

if TYPE_CHECKING:
    from paddlectl.experiments.jobs import Event, Failure, Job
    from paddlectl.report.progress import View

MOST_NAMED = 20


class Asked(NamedTuple):
    """A job, what its progress is called, and its size: kind, method, task and frames at most."""

    job: "Job"
    name: str
    kind: str
    method: str
    task: str
    frames: int


class Ended(NamedTuple):
    """The rows of the jobs that went well, and how others failed, by their names."""

    rows: list[dict[str, Any]]
    failed: "Mapping[str, Failure]"

    def documents(self) -> list[dict[str, Any]]:
        """What failed, for `--json`."""
        return [
            {"job": name, "run": failure.run, "error": str(failure.error)}
            for name, failure in self.failed.items()
        ]

    def require_all(self) -> None:
        """Asks that nothing failed.

        Raises:
            ExceptionGroup: Of all that did.
        """
        require_none(self.failed)


def run(asked: Sequence[Asked], registry: str, checkpoint_every: float | None, jobs: int | None) -> Ended:
    """Does the jobs, `jobs` at a time; one that fails stops no other.

    Raises:
        Exception: What went wrong, if only one job was asked for.
        KeyboardInterrupt: If they were stopped; how to go on is said.
    """
    begun = _Begun(asked)
    try:
        ended = run_each(asked, registry, checkpoint_every, jobs, hear=begun.hear)
    except KeyboardInterrupt:
        begun.tell()
        raise
    if len(asked) == 1:
        for failure in ended.failed.values():
            raise failure.error
    return ended


def run_each(
    asked: Sequence[Asked],
    registry: str,
    checkpoint_every: float | None,
    jobs: int | None,
    *,
    hear: "Callable[[int, Event], None]" = lambda *_: None,
    fail_fast: bool = False,
    on: str | None = None,
) -> Ended:
    """Does the jobs, however few; `hear` is told what is new of each. One that fails may stop all others.

    `on` is the address of a Ray cluster; without it they are done by processes of this machine.

    Raises:
        KeyboardInterrupt: If they were stopped.
    """
    from paddlectl.experiments import cluster
    from paddlectl.experiments.cores import permitted
    from paddlectl.experiments.jobs import Failure
    from paddlectl.experiments.processes import run_jobs
    from paddlectl.report.progress import progress

    workers = jobs or permitted()
    print(plan_of(asked, None if on else workers, registry), file=sys.stderr)
    with progress([each.name for each in asked]) as view:

        def tell(index: int, event: "Event") -> None:
            _show(view, index, event)
            hear(index, event)
            if fail_fast and isinstance(event, Failure):
                raise _FailedFirst(index, event)

        try:
            work = [each.job for each in asked]
            if on:
                outcomes = cluster.run_jobs(work, registry, tell, on)
            else:
                outcomes = run_jobs(work, registry, tell, workers, checkpoint_every)
        except _FailedFirst as first:
            return Ended([], {asked[first.index].name: first.failure})
    names = [each.name for each in asked]
    failed = {n: each for n, each in zip(names, outcomes, strict=True) if isinstance(each, Failure)}
    return Ended([each for each in outcomes if not isinstance(each, Failure)], failed)


class _FailedFirst(Exception):
    def __init__(self, index: int, failure: "Failure") -> None:
        self.index, self.failure = index, failure


class _Begun:
    """Which runs are begun, and which jobs have ended."""

    def __init__(self, asked: Sequence[Asked]) -> None:
        self._left = {index: each.name for index, each in enumerate(asked)}
        self._runs: dict[int, str] = {}

    def hear(self, index: int, event: "Event") -> None:
        from paddlectl.experiments.jobs import Begun, Failure

        if isinstance(event, Begun):
            self._runs[index] = event.run
        elif isinstance(event, dict | Failure):
            self._left.pop(index, None)
            if isinstance(event, dict):
                self._runs.pop(index, None)

    def tell(self) -> None:
        """How to go on, after an interruption."""
        if self._runs:
            print(here(f"go on with: paddlectl resume {' '.join(self._runs.values())}"), file=sys.stderr)
        if new := [name for index, name in self._left.items() if index not in self._runs]:
            more = f" and {len(new) - MOST_NAMED} more" if len(new) > MOST_NAMED else ""
            print(f"not begun: {', '.join(new[:MOST_NAMED])}{more}", file=sys.stderr)


def _show(view: "View", index: int, event: "Event") -> None:
    from paddlectl.experiments.jobs import Begun, Failure, Note

    match event:
        case Begun():
            pass
        case Note(text):
            view.note(f"note: {text}")
        case Failure() | dict():
            view.end(index)
        case _:
            view.tick(index, event)


def plan_of(asked: Sequence[Asked], workers: int | None, registry: str, usually: float | None = None) -> str:
    """What is going to be done: `6 runs × 60,000 frames, 2 at a time, about 5 minutes`.

    Args:
        asked: The jobs.
        workers: How many of them go on at a time; None if that isn't known.
        registry: Where earlier ones are, that tell how long it takes.
        usually: Seconds that a frame takes where there were none; None tells nothing then.
    """
    runs = f"{len(asked)} run{'s' * (len(asked) != 1)}"
    sizes = {each.frames for each in asked}
    frames = f" × {sizes.pop():,}" if len(sizes) == 1 else f", {sum(each.frames for each in asked):,}"
    if workers is None:
        return f"{runs}{frames} frames on the cluster"
    at_a_time = f", {min(workers, len(asked))} at a time" if len(asked) > 1 else ""
    return f"{runs}{frames} frames{at_a_time}{_duration(asked, workers, registry, usually)}"


def _duration(asked: Sequence[Asked], workers: int, registry: str, usually: float | None) -> str:
    """As long as earlier runs of the same task and method took, or of any; empty if there were none."""
    from paddlectl.registry.store import Registry

    kinds: dict[tuple[str, str, str], float | None] = {}
    with suppress(NotFoundError), Registry.open(registry, create=False) as opened:
        kinds = {each[2:5]: opened.seconds_per_frame(*each[2:5]) for each in asked}
    known = [rate for rate in kinds.values() if rate]
    rate = statistics.median(known) if known else usually
    if rate is None:
        return ""
    each_takes = [(kinds.get(each[2:5]) or rate) * each.frames for each in asked]
    seconds = max(sum(each_takes) / min(workers, len(asked)), max(each_takes))
    return f", about {_spelled(seconds)}"


def _spelled(seconds: float) -> str:
    for size, unit in ((3600, "hour"), (60, "minute")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}s"
    return f"{seconds:.0f} seconds" if seconds >= 1.5 else "1 second"


def require_none(failed: "Mapping[str, Failure]") -> None:
    """Asks that nothing failed.

    Raises:
        ExceptionGroup: Of all that did, with their names.
    """
    if failed:
        raise ExceptionGroup("runs failed", [_named(*each) for each in failed.items()])


def _named(name: str, failure: "Failure") -> Exception:
    error = failure.error
    if isinstance(error, PaddlectlError):
        return PaddlectlError(f"{name}: {error.message}", error.hint)
    return error
