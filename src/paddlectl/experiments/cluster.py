"""Jobs on a Ray cluster: each is a task of Ray's, which learns in a registry of its own.

Ray chooses the node, retries what was lost with one, and moves what a task needs. A job gets its sources as
bundles, and gives its run back as one; so no disk is shared. Its sources keep their ids on the way, as all
that a run writes down has them: the same run is equal at home, to the last bit.
"""

import logging
import math
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from paddlectl import plugins
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import Event, Failure, Job, Outcome, RandomJob, TrainJob, TransferJob
from paddlectl.experiments.log import versions
from paddlectl.registry.bundles import bundles
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite

LOCAL = "ray"
"""Instead of an address: the cluster of this machine, by RAY_ADDRESS or `ray start`; else Ray's own of it."""
RETRIES = 3
"""How often a job is begun anew whose node or process was lost."""
PATIENCE = 10.0  # seconds until an address must have answered
_SAME = ("paddlectl", "commit")

Files = Mapping[str, str]
"""Python files with tasks, by name."""


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
    outcomes: dict[int, Outcome] = {}
    files = {path.name: path.read_text() for path in plugins.files()}
    with Registry.open(registry) as home, _cluster(address) as ray:
        # A process a job, as at home: nothing that one leaves behind reaches the next.
        learn = ray.remote(num_cpus=1, max_retries=RETRIES, max_calls=1)(_learn)
        needed = {source for job in jobs if isinstance(job, TransferJob) for source in job.sources}
        sent = {source: ray.put(bundles.packed(home, source)) for source in sorted(needed)}
        tasks = {}
        for index, job in enumerate(jobs):
            sources = job.sources if isinstance(job, TransferJob) else ()
            tasks[learn.remote(job, files, _own(), *map(sent.get, sources))] = index
        while tasks:
            (ended,), _ = ray.wait(list(tasks), num_returns=1)
            index = tasks.pop(ended)
            outcomes[index] = _outcome(ray, ended, home)
            tell(index, outcomes[index])
    return [outcomes[index] for index in range(len(jobs))]


@contextmanager
def _cluster(address: str) -> Iterator[Any]:
    """Ray, connected; what still goes on when it is left is given up."""
    try:
        import ray
    except ImportError:
        raise PaddlectlError("Ray isn't installed", "run: pip install 'paddlectl[ray]'") from None
    _require_answer(address)
    try:
        ray.init(None if address == LOCAL else address, log_to_driver=False, logging_level=logging.ERROR)
        yield ray
    except (ConnectionError, ray.exceptions.RaySystemError) as error:
        told = str(error).strip().splitlines()[:1]
        raise PaddlectlError(
            f"the Ray cluster {address} can't be reached, or was lost: {''.join(told)[:200]}",
            "check it with: ray status; what has ended is kept, so run the same again",
        ) from error
    finally:
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Ray itself waits for minutes where nobody answers.

    Raises:
        PaddlectlError: If nobody does.
    """
    if address == LOCAL:
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        socket.create_connection((host, int(port)), PATIENCE).close()
    except (OSError, OverflowError) as error:
        raise PaddlectlError(
            f"the Ray cluster {address} can't be reached: {error}", "check the address with: ray status"
        ) from error


def _outcome(ray: Any, ended: Any, home: Registry) -> Outcome:
    """Keeps the run of a job that has ended."""
    try:
        found = ray.get(ended)
    except (
        ray.exceptions.RayTaskError,
        ray.exceptions.WorkerCrashedError,
        ray.exceptions.NodeDiedError,
    ) as error:
        why = str(error).strip().splitlines()[-1]
        return Failure(None, PaddlectlError(f"it failed on the cluster: {why[:200]}", "run it again"))
    if isinstance(found, PaddlectlError):
        return Failure(None, found)
    kept = bundles.take_back(home, found)
    return {"run": kept["run"], "policy": kept["policy"]}


def _own() -> dict[str, str | None]:
    return {name: versions().get(name) for name in _SAME}


# On a node


def _learn(
    job: TrainJob | TransferJob | RandomJob, files: Files, home: Mapping[str, Any], *sources: bytes
) -> bytes | PaddlectlError:
    """The bundle of the run that does a job, or why there is none."""
    import torch

    torch.set_num_threads(1)
    if (own := _own()) != home:
        return PaddlectlError(
            f"a node has {_told(own)}; here is {_told(home)}", "install the same on all nodes"
        )
    try:
        with TemporaryDirectory() as folder, Registry.open(Path(folder) / "registry") as registry:
            _add(files, Path(folder))
            if isinstance(job, TransferJob):
                for source, bundle in zip(job.sources, sources, strict=True):
                    bundles.lend(registry, bundle, source)
            return bundles.packed(registry, _run(job, registry))
    except PaddlectlError as error:
        return error


def _told(own: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in own.items() if value)


def _add(files: Files, folder: Path) -> None:
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
