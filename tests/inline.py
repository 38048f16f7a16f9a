"""Jobs done in the process of who asks, one after the other and evaluated on few layouts.

Where it isn't tested that each has a process of its own.
"""

from collections.abc import Callable, Sequence
from typing import Any

from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.runner import run_transfer, train_source
from paddlectl.registry.store import Registry
from trials.runs import quiet, small


def run_jobs(
    jobs: Sequence[TrainJob | TransferJob], location: str, tell: Callable[[int, Any], None], *_: object
) -> list[dict[str, Any]]:
    """In place of `experiments.processes.run_jobs`."""
    rows = []
    with small(), Registry.open(location) as registry:
        for index, job in enumerate(jobs):
            work: Any = train_source if isinstance(job, TrainJob) else run_transfer
            rows.append(work(job, registry, quiet))
            tell(index, rows[-1])
    return rows
