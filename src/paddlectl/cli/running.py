"""Runs jobs with their progress on stderr, and says how to go on if they are stopped."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from paddlectl.experiments.jobs import Job, Progress


def run(
    jobs: "Sequence[Job]", names: Sequence[str], registry: str, checkpoint_every: float | None
) -> list[dict[str, Any]]:
    """The jobs' rows; `names` is what their progress is called."""
    from paddlectl.experiments.processes import run_jobs
    from paddlectl.report.progress import progress

    begun: dict[str, None] = {}
    try:
        with progress(names) as report:

            def told(index: int, progressed: "Progress") -> None:
                begun[progressed.run] = None
                report(index, progressed)

            return run_jobs(jobs, registry, told, every=checkpoint_every)
    except KeyboardInterrupt:
        if begun:
            print(f"go on with: paddlectl resume {' '.join(begun)}", file=sys.stderr)
        raise
