"""Jobs side by side: a process and one torch thread each (two threads only fight over small networks)."""

import multiprocessing
import os
import select
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext
from pathlib import Path
from typing import Any

from paddlectl import plugins
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.cores import permitted
from paddlectl.experiments.jobs import (
    Begun,
    Event,
    Failure,
    Job,
    Note,
    Outcome,
    RandomJob,
    Row,
    TrainJob,
    TransferJob,
)
from paddlectl.experiments.stop import Stop
from paddlectl.tasks import suite

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PATIENCE = 10.0  # seconds that a stopped process may take to mark its run


def run_jobs(
    jobs: Sequence[Job],
    registry: str,
    tell: Callable[[int, Event], None],
    workers: int | None = None,
    every: float | None = None,
) -> list[Outcome]:
    """Does all jobs, some at a time; one that fails, or whose process is lost, stops no other.

    Args:
        jobs: What to do.
        registry: Its place; each process opens it for itself.
        tell: Called with a job's number and what is new of it, its outcome at last.
        workers: Most processes at a time; None for as many as there are CPUs.
        every: Seconds between two checkpoints of a run; None for the usual.

    Returns:
        The jobs' rows, or how they failed, in the order of the jobs.

    Raises:
        KeyboardInterrupt: After the running ones were marked interrupted.
    """
    context = spawning()
    waiting = deque(enumerate(jobs))
    running: dict[Any, _Worker] = {}
    outcomes: dict[int, Outcome] = {}
    try:
        while waiting or running:
            while waiting and len(running) < (workers or permitted()):
                with held_back():
                    worker = _Worker(context, *waiting.popleft(), registry, every)
                    running[worker.events] = worker
            for events in wait(list(running)):
                worker = running[events]
                with held_back():
                    event = worker.hear()
                    if isinstance(event, dict | Failure):
                        outcomes[worker.index] = event
                        del running[events]
                        worker.end()
                tell(worker.index, event)
        return [outcomes[index] for index in range(len(jobs))]
    finally:
        with held_back():
            _stop(running.values(), tell)


def rows_of(outcomes: Sequence[Outcome]) -> list[Row]:
    """The rows of jobs that all went well.

    Raises:
        Exception: What went wrong in the first one that didn't.
    """
    rows = []
    for outcome in outcomes:
        if isinstance(outcome, Failure):
            raise outcome.error
        rows.append(outcome)
    return rows


def spawning() -> SpawnContext:
    """How processes are started, none before this."""
    os.environ["PYTHONSAFEPATH"] = "1"  # no file of the working folder is taken for one of Python's
    resource_tracker.ensure_running()  # or the first start would do it, and let signals through after it
    return multiprocessing.get_context("spawn")


@contextmanager
def held_back() -> Iterator[None]:
    """No signal to stop comes through meanwhile, nor ever to a process that is started in here.

    A terminal sends ^C, or that it was closed, to all of them at once; were a run's process stopped by it
    and by its parent, the second signal could strike while it marks its run.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


class _Worker:
    """A job's process, seen by who started it. Each has a pipe of its own: one that dies blocks no other."""

    def __init__(
        self, context: SpawnContext, index: int, job: Job, registry: str, every: float | None
    ) -> None:
        self.index = index
        self.events, theirs = context.Pipe(duplex=False)
        self._registry = registry
        self._run: str | None = None
        self._process = context.Process(target=_work, args=(job, registry, theirs, every, plugins.files()))
        self._process.start()
        theirs.close()

    def hear(self) -> Event:
        """What it says next; a failure if it died without having told its outcome."""
        try:
            event = self.events.recv()
        except (EOFError, OSError):
            return Failure(self._run, self._lost())
        if isinstance(event, Begun):
            self._run = event.run
        return Failure(self._run, event) if isinstance(event, Exception) else event

    def stop(self) -> None:
        self._process.terminate()

    def end(self) -> None:
        """Waits until it is gone, but not for ever."""
        self._process.join(_PATIENCE)
        self._process.kill()
        self._process.join()

    def _lost(self) -> PaddlectlError:
        self._process.join()
        ended = _ended_by(self._process.exitcode or 0)
        if self._run is None:
            return PaddlectlError(f"the process of a run {ended} before it had begun", "run it again")
        _mark(self._registry, self._run)
        return PaddlectlError(f"{self._run} {ended}", f"run: paddlectl resume {self._run}")


def _ended_by(exitcode: int) -> str:
    if exitcode >= 0:
        return f"ended unexpectedly, with exit code {exitcode},"
    why = " (by somebody, or by the system for want of memory)" if -exitcode == signal.SIGKILL else ""
    return f"was ended by {signal.Signals(-exitcode).name}{why}"


def _mark(location: str, run: str) -> None:
    """Marks a run as interrupted whose process couldn't do it, with what its tables tell."""
    from paddlectl.registry.store import Registry

    with (
        suppress(PaddlectlError),
        Registry.open(location, create=False) as registry,
        registry.files.hold(run),
    ):
        if registry.run(run).status == "running":
            last = registry.files.read_rows(run, "progress")[-1:]
            counts = {name: last[0][name] if last else 0 for name in ("frames", "episodes", "seconds")}
            registry.finish_run(run, status="interrupted", results={}, **counts)


def _stop(workers: Collection[_Worker], tell: Callable[[int, Event], None]) -> None:
    """Ends them and tells what they still said: no run is forgotten, nor called lost if it finished."""
    for worker in workers:
        worker.stop()
    for worker in workers:
        worker.end()
        while not isinstance(event := worker.hear(), Failure):
            tell(worker.index, event)


# Within a job's process


class _Line:
    """What a job's process says; who should hear it may be slow, stopped or dead."""

    def __init__(self, events: Connection) -> None:
        self._events = events
        self._room = select.poll()
        self._room.register(events.fileno(), select.POLLOUT)

    def send(self, event: Event | Exception) -> None:
        with suppress(OSError):
            self._events.send(event)

    def send_if_room(self, event: Event) -> None:
        """Drops it if nobody hears: no progress is worth waiting for."""
        if self._room.poll(0):
            self.send(event)


def _work(job: Job, registry: str, events: Connection, every: float | None, files: Sequence[Path]) -> None:
    stop = Stop()
    signal.signal(signal.SIGTERM, stop)
    line = _Line(events)
    try:
        with redirect_stdout(sys.stderr):  # stdout is the answer's
            for file in files:
                suite.add_file(file)
            line.send(_done(job, registry, line, stop, every))
    except PaddlectlError as error:
        line.send(error)
    except KeyboardInterrupt:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.raise_signal(signal.SIGTERM)  # its end says what ended it
    except Exception as error:
        told = RuntimeError(f"a run failed: {type(error).__name__}: {error}")
        told.add_note(traceback.format_exc())
        line.send(told)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _done(job: Job, registry: str, line: _Line, stop: Stop, every: float | None) -> Row:
    import torch

    from paddlectl.experiments.checkpointer import EVERY, Checkpointer
    from paddlectl.experiments.resuming import resume
    from paddlectl.experiments.runner import random_source, run_transfer, train_source
    from paddlectl.registry.store import Registry

    torch.set_num_threads(1)
    signal.pthread_sigmask(
        signal.SIG_UNBLOCK, {signal.SIGTERM}
    )  # not before: torch's import can't be stopped
    threading.Thread(target=end_with_parent, daemon=True).start()

    checkpointer = Checkpointer(
        EVERY if every is None else every,
        stop,
        tell=lambda text: line.send_if_room(Note(text)),
        begun=lambda run: line.send(Begun(run)),
    )
    with Registry.open(registry) as opened:
        match job:
            case TrainJob():
                return train_source(job, opened, line.send_if_room, checkpointer)
            case TransferJob():
                return run_transfer(job, opened, line.send_if_room, checkpointer)
            case RandomJob():
                kept = random_source(job.task, job.seed, opened)
                return {"run": kept.run, "policy": kept.id}
        return resume(job.run, opened, line.send_if_room, checkpointer)


def end_with_parent() -> None:
    """Asks this process to end, as by SIGTERM, once the one that started it is gone."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
