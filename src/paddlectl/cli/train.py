"""`paddlectl train`."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import (
    FRAMES,
    AsJson,
    CheckpointEvery,
    ManySeeds,
    OneSeed,
    RegistryPlace,
    chosen_seeds,
    complete_tasks,
)
from paddlectl.errors import NotFoundError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.experiments.jobs import TrainJob

EXAMPLE = "Example: paddlectl train BlockedDoor GapBall --seed 0"


def train(
    task: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK...",
            autocompletion=complete_tasks,
            help="Tasks to learn, side by side.",
            show_default=False,
        ),
    ],
    seed: OneSeed = None,
    seeds: ManySeeds = None,
    frames: Annotated[
        int | None,
        typer.Option(
            parser=FRAMES, metavar="N", help="At most so many environment steps.", show_default=False
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Other settings than the usual: paper, for the maze.",
            show_default=False,
        ),
    ] = None,
    checkpoint_every: CheckpointEvery = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Train sources with the hybrid decision model and keep them in the registry."""
    from paddlectl.cli.texts import here
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TRAINED, table

    jobs = train_jobs(task, chosen_seeds(seed, seeds, (0,)), frames, preset)
    rows = run_training(jobs, registry, checkpoint_every)
    if as_json:
        print_json({"runs": rows})
    else:
        print_text([table(TRAINED, rows, "Trained"), here(f"next: paddlectl show {rows[0]['policy']}")])


def train_jobs(
    tasks: "Sequence[str]", seeds: "Sequence[int]", frames: int | None = None, preset: str | None = None
) -> "list[TrainJob]":
    """One job for each task and seed, the tasks of one seed together.

    Raises:
        NotFoundError: If there is no such task, or one of them has no such preset.
    """
    from paddlectl.tasks.base import GUIDED
    from paddlectl.tasks.suite import load

    known = {load(task).name: sorted({*load(task).presets} - {GUIDED}) for task in tasks}
    for name, presets in known.items():
        if preset is not None and preset not in presets:
            has = f"its presets: {', '.join(presets)}" if presets else "it has none: leave out --preset"
            raise NotFoundError(f"{name} has no preset {preset}", has)

    from paddlectl.experiments.jobs import TrainJob

    return [TrainJob(task=name, seed=seed, frames=frames, preset=preset) for seed in seeds for name in known]


def run_training(
    jobs: "Sequence[TrainJob]", registry: str, checkpoint_every: float | None = None
) -> list[dict[str, Any]]:
    """Runs the jobs with their progress on stderr and gives their rows."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.running import run
    from paddlectl.registry.store import Registry

    Registry.open(registry).close()  # a place that can't be used is told before anything is trained

    with stdout_kept():
        return run(jobs, [f"{job.task} seed {job.seed}" for job in jobs], registry, checkpoint_every)
