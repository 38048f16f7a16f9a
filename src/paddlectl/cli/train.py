"""`paddlectl train`."""

from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import (
    FRAMES,
    AsJson,
    CheckpointEvery,
    Jobs,
    ManySeeds,
    OneSeed,
    RegistryPlace,
    chosen_seeds,
    complete_tasks,
    one_method_of,
)
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.methods.catalogue import ALONE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.cli.running import Ended
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
    method: Annotated[
        str,
        typer.Option(metavar="M", autocompletion=one_method_of(ALONE), help=f"By which: {', '.join(ALONE)}."),
    ] = "hdm",
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Train sources from scratch and keep them in the registry."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.texts import here
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TRAINED, table

    with stdout_kept():
        asked = train_jobs(task, chosen_seeds(seed, seeds, (0,)), frames, preset, method)
    ended = run_training(asked, registry, checkpoint_every, jobs)
    if as_json:
        print_json({"runs": ended.rows, "failed": ended.documents()})
    elif ended.rows:
        next_one = here(f"next: paddlectl show {ended.rows[0]['policy']}")
        print_text([table(TRAINED, ended.rows, "Trained"), next_one])
    ended.require_all()


def train_jobs(
    tasks: "Sequence[str]",
    seeds: "Sequence[int]",
    frames: int | None = None,
    preset: str | None = None,
    method: str = "hdm",
) -> "list[TrainJob]":
    """One job for each task and seed, the tasks of one seed together.

    Raises:
        NotFoundError: If there is no such task, or one of them has no such preset.
        UsageError: If there is no such method, or it is none for a source.
    """
    from paddlectl.methods.catalogue import alone, entry_of, require_actions
    from paddlectl.tasks.base import GUIDED
    from paddlectl.tasks.suite import load

    known = {load(task).name: sorted({*load(task).presets} - {GUIDED}) for task in tasks}
    for name, presets in known.items():
        if preset is not None and preset not in presets:
            has = f"its presets: {', '.join(presets)}" if presets else "it has none: leave out --preset"
            raise NotFoundError(f"{name} has no preset {preset}", has)

    if entry_of(method, alone).teaches:
        raise UsageError(f"{method} reuses sources, so it trains none", f"one of: {', '.join(alone())}")

    for name in known:
        require_actions(method, load(name), alone)

    from paddlectl.experiments.jobs import TrainJob

    return [
        TrainJob(task=name, seed=seed, frames=frames, preset=preset, method=method)
        for seed in seeds
        for name in known
    ]


def run_training(
    jobs: "Sequence[TrainJob]",
    registry: str,
    checkpoint_every: float | None = None,
    at_a_time: int | None = None,
) -> "Ended":
    """Runs the jobs with their progress on stderr."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.running import Asked, run
    from paddlectl.registry.store import Registry
    from paddlectl.tasks.suite import load

    Registry.open(registry).close()  # a place that can't be used is told before anything is trained

    with stdout_kept():
        asked = []
        for job in jobs:
            frames = job.frames or load(job.task).frames(job.preset)
            asked.append(Asked(job, f"{job.task} seed {job.seed}", "train", job.method, job.task, frames))
        return run(asked, registry, checkpoint_every, at_a_time)
