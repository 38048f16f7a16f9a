"""Jobs done in the process of who asks, one after the other and evaluated on few layouts.

Where it isn't tested that each has a process of its own.
"""

from collections.abc import Callable, Sequence
from typing import Any

from paddlectl.errors import PaddlectlError
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import Failure, Job, RandomJob, ResumeJob, TrainJob
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import random_source, run_transfer, train_source
from paddlectl.registry.store import Registry
from trials.runs import quiet, small


def run_jobs(jobs: Sequence[Job], location: str, tell: Callable[[int, Any], None], *_: object) -> list[Any]:
    """In place of `experiments.processes.run_jobs`."""
    outcomes = []
    with small(), Registry.open(location) as registry:
        for index, job in enumerate(jobs):
            try:
                outcomes.append(_done(job, registry))
            except PaddlectlError as error:
                outcomes.append(Failure(None, error))
            tell(index, outcomes[-1])
    return outcomes


def _done(job: Job, registry: Registry) -> dict[str, Any]:
    match job:
        case TrainJob():
            return train_source(job, registry, quiet)
        case RandomJob():
            kept = random_source(job.task, job.seed, registry)
            return {"run": kept.run, "policy": kept.id}
        case ResumeJob():
            return resume(job.run, registry, quiet, Checkpointer())
    return run_transfer(job, registry, quiet)
