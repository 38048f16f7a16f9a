"""Runs jobs with their progress on stderr, and says how to go on with those that were stopped."""

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from paddlectl.cli.texts import here
from paddlectl.errors import PaddlectlError

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
        if self.failed:
            raise ExceptionGroup("runs failed", [_named(*failed) for failed in self.failed.items()])


def run(asked: Sequence[Asked], registry: str, checkpoint_every: float | None, jobs: int | None) -> Ended:
    """Does the jobs, `jobs` at a time; one that fails stops no other.

    Raises:
        Exception: What went wrong, if only one job was asked for.
        KeyboardInterrupt: If they were stopped.
    """
    from paddlectl.experiments.cores import permitted
    from paddlectl.experiments.jobs import Failure
    from paddlectl.experiments.processes import run_jobs
    from paddlectl.report.progress import progress

    workers = jobs or permitted()
    stopped = _Begun(asked)
    print(_plan(asked, workers, registry), file=sys.stderr)
    try:
        with progress([each.name for each in asked]) as view:

            def tell(index: int, event: "Event") -> None:
                stopped.hear(index, event)
                _show(view, index, event)

            outcomes = run_jobs([each.job for each in asked], registry, tell, workers, checkpoint_every)
    except KeyboardInterrupt:
        stopped.tell()
        raise
    named = list(zip([each.name for each in asked], outcomes, strict=True))
    failed = {name: outcome for name, outcome in named if isinstance(outcome, Failure)}
    if len(asked) == 1:
        for failure in failed.values():
            raise failure.error
    return Ended([outcome for _, outcome in named if not isinstance(outcome, Failure)], failed)


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


def _plan(asked: Sequence[Asked], workers: int, registry: str) -> str:
    """What is going to be done: `6 runs × 60,000 frames, 2 at a time, about 5 minutes`."""
    runs = f"{len(asked)} run{'s' * (len(asked) != 1)}"
    sizes = {each.frames for each in asked}
    frames = f" × {sizes.pop():,}" if len(sizes) == 1 else f", {sum(each.frames for each in asked):,}"
    at_a_time = f", {min(workers, len(asked))} at a time" if len(asked) > 1 else ""
    return f"{runs}{frames} frames{at_a_time}{_duration(asked, workers, registry)}"


def _duration(asked: Sequence[Asked], workers: int, registry: str) -> str:
    """As long as earlier runs of the same task and method took; empty if there were none."""
    from paddlectl.registry.store import Registry

    with Registry.open(registry) as opened:
        kinds = {each[2:5]: 0.0 for each in asked}
        rates = {kind: opened.seconds_per_frame(*kind) for kind in kinds}
    each_takes = [(rates[each[2:5]] or 0.0) * each.frames for each in asked]
    if not all(each_takes):
        return ""
    seconds = max(sum(each_takes) / min(workers, len(asked)), max(each_takes))
    return f", about {_spelled(seconds)}"


def _spelled(seconds: float) -> str:
    for size, unit in ((3600, "hour"), (60, "minute")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}s"
    return f"{seconds:.0f} seconds" if seconds >= 1.5 else "1 second"


def _named(name: str, failure: "Failure") -> Exception:
    error = failure.error
    if isinstance(error, PaddlectlError):
        return PaddlectlError(f"{name}: {error.message}", error.hint)
    return error
