"""Jobs side by side: a process and one torch thread each (two threads only fight over small networks)."""

import multiprocessing
import os
import queue
import signal
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any

from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import Job, Progress, TrainJob, TransferJob
from paddlectl.experiments.stop import Stop

_POLL = 0.2  # seconds between two looks at a silent queue
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PATIENCE = 10.0  # seconds that a stopped process may take to mark its run


def run_jobs(
    jobs: Sequence[Job],
    registry: str,
    report: Callable[[int, Progress], None],
    workers: int | None = None,
    every: float | None = None,
) -> list[dict[str, Any]]:
    """Does all jobs, as many at a time as there are cores.

    Args:
        jobs: What to do.
        registry: Its place; each process opens it for itself.
        report: Called with a job's number and its progress.
        workers: Most processes at a time.
        every: Seconds between two checkpoints of a run; None for the usual.

    Returns:
        The jobs' rows, in the order of the jobs.

    Raises:
        PaddlectlError: What went wrong in one of them; the others are stopped and marked interrupted.
        RuntimeError: For a fault that nobody foresaw, with its traceback as a note.
        KeyboardInterrupt: After the running ones were marked interrupted.
    """
    context = multiprocessing.get_context("spawn")
    with _held_back():  # from the process that keeps its semaphores, too
        events: Any = context.Queue()
    waiting = list(enumerate(jobs))[::-1]
    running: dict[int, BaseProcess] = {}
    rows: dict[int, dict[str, Any]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < (workers or os.cpu_count() or 1):
                index, job = waiting.pop()
                process = context.Process(target=_work, args=(index, job, registry, events, every))
                with _held_back():
                    process.start()
                    running[index] = process
            for index, event in _events(events, running):
                if isinstance(event, Progress):
                    report(index, event)
                    continue
                running.pop(index).join()
                if isinstance(event, Exception):
                    raise event
                rows[index] = event
        return [rows[index] for index in range(len(jobs))]
    finally:
        _stop(running.values())


@contextmanager
def _held_back() -> Iterator[None]:
    """No signal to stop comes through meanwhile, nor to a process that is started in here.

    A terminal sends ^C, or that it was closed, to all of them at once; were a run's process stopped by it
    and by its parent, the second signal could strike while it marks its run.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)


def _events(events: Any, running: dict[int, BaseProcess]) -> Iterator[tuple[int, Any]]:
    """What the processes tell; an error for one that ended without a word."""
    try:
        yield events.get(timeout=_POLL)
    except queue.Empty:
        for index, process in list(running.items()):
            if not process.is_alive() and events.empty():
                yield (
                    index,
                    PaddlectlError(
                        f"a run's process ended unexpectedly (exit {process.exitcode})",
                        "the registry is sound; look at the machine's memory, then run it again",
                    ),
                )


def _stop(processes: Iterable[BaseProcess]) -> None:
    left = list(processes)
    for process in left:
        process.terminate()
    for process in left:
        process.join(_PATIENCE)
        process.kill()


def _work(index: int, job: Job, registry: str, events: Any, every: float | None) -> None:
    stop = Stop()
    signal.signal(signal.SIGTERM, stop)
    try:
        events.put((index, _done(index, job, registry, events, stop, every)))
    except PaddlectlError as error:
        events.put((index, error))
    except KeyboardInterrupt:
        pass
    except Exception as error:
        told = RuntimeError(f"a run failed: {type(error).__name__}: {error}")
        told.add_note(traceback.format_exc())
        events.put((index, told))
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _note(text: str) -> None:
    print(f"note: {text}", file=sys.stderr)


def _done(
    index: int, job: Job, registry: str, events: Any, stop: Stop, every: float | None
) -> dict[str, Any]:
    import torch

    from paddlectl.experiments.pace import EVERY, Pace
    from paddlectl.experiments.resuming import resume
    from paddlectl.experiments.sources import train_source
    from paddlectl.experiments.transfers import run_transfer
    from paddlectl.registry.store import Registry

    torch.set_num_threads(1)
    signal.pthread_sigmask(
        signal.SIG_UNBLOCK, {signal.SIGTERM}
    )  # not before: torch's import can't be stopped

    def report(progress: Progress) -> None:
        events.put((index, progress))

    pace = Pace(EVERY if every is None else every, stop, tell=_note)
    with Registry.open(registry) as opened:
        match job:
            case TrainJob():
                return train_source(job, opened, report, pace)
            case TransferJob():
                return run_transfer(job, opened, report, pace)
        return resume(job.run, opened, report, pace)
