"""Jobs on a Ray cluster: each is a task of Ray's, which learns in a registry of its own.

Ray chooses the node, retries what was lost with one, and moves what a task needs. A job gets its sources as
bundles, and gives its run back as one; so no disk is shared. Its sources keep their ids on the way, as all
that a run writes down has them: the same run is equal at home, to the last bit.

Who speaks with Ray is a process of its own, the driver: Ray ends it, without a word, when the cluster is
lost. What comes back is kept by the process that the user started, which outlives that.
"""

import importlib.util
import logging
import math
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from paddlectl import plugins
from paddlectl.errors import IntegrityError, NotFoundError, PaddlectlError
from paddlectl.experiments.cores import permitted
from paddlectl.experiments.jobs import Event, Failure, Job, Outcome, RandomJob, TrainJob, TransferJob
from paddlectl.experiments.log import versions
from paddlectl.experiments.processes import SIGNALS, end_with_parent, held_back, spawning
from paddlectl.registry.bundles import bundles
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite

LOCAL = "ray"
"""Instead of an address: RAY_ADDRESS, or this machine's cluster by `ray start`; else one that is started."""
RETRIES = 3
"""How often a job is begun anew whose node or process was lost."""
ANSWER = 10.0  # seconds until somebody must be there at an address,
CONNECTED = 120.0  # and Ray must have taken up the driver
LOOK = 10.0  # seconds without news until the cluster is asked whether it is still there
ENDED = 10.0  # seconds that the driver may take to end
CHECK = "check it with: ray status"
UNREACHED = f"{CHECK}; Ray's version, RAY_AUTH_MODE and token must be the same here and there"
LOST = f"{CHECK}; what has ended is kept, so run the same again"

Found = bytes | PaddlectlError
"""The bundle of a run, or why there is none."""


class Work(NamedTuple):
    """What a driver is to have done, all of it plain values.

    Attributes:
        jobs: None of them a `ResumeJob`.
        files: Python files with tasks, by name.
        sources: The bundles of the policies that the jobs reuse, by id.
        own: What must be the same on each node.
    """

    jobs: Sequence[Job]
    files: Mapping[str, str]
    sources: Mapping[str, bytes]
    own: str


def run_jobs(
    jobs: Sequence[Job], registry: str, tell: Callable[[int, Event], None], address: str
) -> list[Outcome]:
    """Does all jobs on a cluster; one that fails stops no other. None of them may be a `ResumeJob`.

    Args:
        jobs: What to do.
        registry: Where the sources are, and the runs are kept as they end.
        tell: Called with a job's number and its outcome.
        address: `ray`, or one as `ray://head:10001`.

    Returns:
        The jobs' runs and policies, or how they failed, in the order of the jobs.

    Raises:
        PaddlectlError: If Ray isn't installed, or the cluster can't be reached or is lost.
        KeyboardInterrupt: What has ended by then is kept.
    """
    if importlib.util.find_spec("ray") is None:
        raise PaddlectlError("Ray isn't installed", "run: pip install 'paddlectl[ray]'")
    address = (os.environ.get("RAY_ADDRESS") or LOCAL) if address == LOCAL else address
    _require_answer(address)
    outcomes: dict[int, Outcome] = {}
    with Registry.open(registry) as home, _driver(_work(jobs, home), address) as told:
        while len(outcomes) < len(jobs):
            wait([told])
            with held_back():
                index, found = _heard(told, f"{_name(address)} was lost", LOST)
                outcomes[index] = _kept(home, found)
            tell(index, outcomes[index])
    return [outcomes[index] for index in range(len(jobs))]


def _name(address: str) -> str:
    return "this machine's Ray cluster" if address == LOCAL else f"the Ray cluster {address}"


def _require_answer(address: str) -> None:
    """Ray itself waits for minutes where nobody answers.

    Raises:
        PaddlectlError: If nobody does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not port.isdecimal():  # `ray`, or what else Ray finds itself
        return
    try:
        socket.create_connection((host, int(port)), ANSWER).close()
    except (OSError, OverflowError) as error:
        raise PaddlectlError(f"{_name(address)} can't be reached: {error}", CHECK) from error


def _work(jobs: Sequence[Job], home: Registry) -> Work:
    files = {path.name: path.read_text() for path in plugins.files()}
    needed = {source for job in jobs if isinstance(job, TransferJob) for source in job.sources}
    return Work(jobs, files, {source: bundles.packed(home, source) for source in sorted(needed)}, _own())


@contextmanager
def _driver(work: Work, address: str) -> Iterator[Connection]:
    """What a driver tells; with it ends all that still goes on there."""
    context = spawning()
    told, telling = context.Pipe(duplex=False)
    driver = context.Process(target=_drive, args=(work, address, telling))
    with held_back():
        driver.start()
    telling.close()
    try:
        if not told.poll(CONNECTED):
            raise PaddlectlError(f"{_name(address)} can't be reached: it doesn't answer", UNREACHED)
        _heard(told, f"{_name(address)} can't be reached", UNREACHED)
        yield told
    finally:
        with held_back():
            driver.terminate()
            driver.join(ENDED)
            driver.kill()
            driver.join()
            told.close()


def _heard(told: Connection, otherwise: str, hint: str) -> tuple[int, Found]:
    """What the driver says next: a job's number and what became of it.

    Raises:
        PaddlectlError: If it ended, or says why it ends.
    """
    try:
        said = told.recv()
    except (EOFError, OSError):
        said = "Ray ended the connection"
    if isinstance(said, str):
        raise PaddlectlError(f"{otherwise}: {said}", hint)
    index, found = said
    return index, found


def _kept(home: Registry, found: Found) -> Outcome:
    """Keeps the run of a job that has ended."""
    if isinstance(found, PaddlectlError):
        return Failure(None, found)
    try:
        kept = bundles.take_back(home, found)
    except (NotFoundError, IntegrityError) as error:  # as when its source was deleted meanwhile
        return Failure(None, error)
    return {"run": kept["run"], "policy": kept["policy"]}


def _own() -> str:
    return versions()["paddlectl"]


# In the driver


def _drive(work: Work, address: str, telling: Connection) -> None:
    """Has all of it done by Ray, and tells what became of each as it ends.

    It tells first that it is connected; and last, if it has to end, why.
    """
    os.setsid()  # ^C is for who started it
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    threading.Thread(target=end_with_parent, daemon=True).start()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):  # Ray's C++ writes there; its own logs have the same
        os.dup2(nowhere, stream)
    # Ray makes modules of these places importable on the nodes: a torch.py, say, in the working folder.
    os.chdir("/")
    sys.argv = [""]
    try:
        import ray

        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # nothing is told to Ray's makers
        try:
            _connect(ray, address)
            telling.send((-1, b""))
            for index, found in _ended(ray, work):
                telling.send((index, found))
        finally:
            ray.shutdown()
    except Exception as error:
        telling.send(_line(error))


def _connect(ray: Any, address: str) -> None:
    quiet = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address != LOCAL:
        ray.init(address, **quiet)
        return
    os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)  # or Ray keeps one at the user's home
    try:
        ray.init(num_cpus=permitted(), include_dashboard=False, **quiet)
    except ValueError:  # there is one by `ray start`, which has its own CPUs
        del os.environ["RAY_AUTH_TOKEN"]
        ray.init(**quiet)


def _ended(ray: Any, work: Work) -> Iterator[tuple[int, Found]]:
    """The jobs' numbers and bundles as they end."""
    # A process a job, as at home: nothing that one leaves behind reaches the next.
    learn = ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=1)(_learn)
    sent = {source: ray.put(bundle) for source, bundle in work.sources.items()}
    tasks = {}
    for index, job in enumerate(work.jobs):
        sources = job.sources if isinstance(job, TransferJob) else ()
        tasks[learn.remote(job, work.files, work.own, *map(sent.get, sources))] = index
    node = ray.get_runtime_context().get_node_id()
    while tasks:
        ended, _ = ray.wait(list(tasks), num_returns=1, timeout=LOOK)
        if not ended:
            _require_node(ray, node)
        for each in ended:
            yield tasks.pop(each), _found(ray, each)


def _require_node(ray: Any, node: str) -> None:
    """Asks that the driver's node is still one of the cluster's; Ray would wait for ever after a restart.

    It is the asking alone that ends the driver where the cluster at the address is another one now.

    Raises:
        ConnectionError: If it isn't.
    """
    if not any(each["NodeID"] == node and each["Alive"] for each in ray.nodes()):
        raise ConnectionError("the node that it was joined by is lost")


def _found(ray: Any, ended: Any) -> Found:
    try:
        found: Found = ray.get(ended)
    except (ray.exceptions.RaySystemError, ray.exceptions.LocalRayletDiedError):
        raise  # it is the driver's own node that is lost
    except ray.exceptions.RayError as error:
        return PaddlectlError(f"it failed on the cluster: {_line(error)}", "run it again")
    return found


def _line(error: BaseException) -> str:
    """The last line of an error, or rather of the first one that led to it: there Ray says what it was."""
    while error.__cause__:
        error = error.__cause__
    told = error.details() if hasattr(error, "details") else str(error)  # as gRPC's errors have it
    lines = f"{told}".strip().splitlines() or [type(error).__name__]
    return lines[-1][:200]


# On a node


def _learn(
    job: TrainJob | TransferJob | RandomJob, files: Mapping[str, str], home: str, *sources: bytes
) -> Found:
    """The bundle of the run that does a job, or why there is none."""
    import torch

    torch.set_num_threads(1)
    if (own := _own()) != home:
        return PaddlectlError(
            f"the node {socket.gethostname()} has paddlectl {own}; here is paddlectl {home}",
            "install the same on all nodes",
        )
    try:
        with (
            TemporaryDirectory(prefix="paddlectl-") as folder,
            Registry.open(Path(folder) / "registry") as registry,
        ):
            _add(files, Path(folder))
            if isinstance(job, TransferJob):
                for source, bundle in zip(job.sources, sources, strict=True):
                    bundles.lend(registry, bundle, source)
            return bundles.packed(registry, _run(job, registry))
    except PaddlectlError as error:
        return error


def _add(files: Mapping[str, str], folder: Path) -> None:
    for name, text in files.items():
        path = folder / name
        path.write_text(text)
        suite.add_file(path)


def _run(job: TrainJob | TransferJob | RandomJob, registry: Registry) -> str:
    from paddlectl.experiments.checkpointer import Checkpointer
    from paddlectl.experiments.runner import random_source, run_transfer, train_source

    match job:
        case TrainJob():
            made = train_source(job, registry, lambda _: None, Checkpointer(math.inf))
        case TransferJob():
            made = run_transfer(job, registry, lambda _: None, Checkpointer(math.inf))
        case RandomJob():
            return random_source(job.task, job.seed, registry).run
    return str(made["run"])
