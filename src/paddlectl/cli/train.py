"""`paddlectl train`."""

from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl.cli.options import (
    FRAMES,
    AsJson,
    Changed,
    CheckpointEvery,
    Jobs,
    ManySeeds,
    OneSeed,
    RegistryPlace,
    RunName,
    Tags,
    TaskFiles,
    chosen_seeds,
    complete_tasks,
    one_method_of,
)
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.methods.catalogue import ALONE

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from paddlectl.cli.running import Ended
    from paddlectl.experiments.jobs import TrainJob
    from paddlectl.methods.changes import Changes
    from paddlectl.scenario import Scenario
    from paddlectl.tasks.base import Task

EXAMPLE = "Example: paddlectl train BlockedDoor GapBall --seed 0"


def train(
    task: Annotated[
        list[str],
        typer.Argument(
            metavar="TASK...",
            autocompletion=complete_tasks,
            help="Tasks to learn, side by side: names or task files.",
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
    changed: Changed = None,
    name: RunName = None,
    tag: Tags = None,
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Train sources from scratch and keep them in the registry."""
    from dataclasses import replace

    from paddlectl.cli.named import labels_of
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.texts import here
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TRAINED, table

    with stdout_kept():
        asked = train_jobs(task, chosen_seeds(seed, seeds, (0,)), frames, preset, method, changed or ())
        labels = labels_of(name, tag, [str(job.task) for job in asked], registry)
        asked = [replace(job, **labels._asdict()) for job in asked]
    ended = run_training(asked, registry, checkpoint_every, jobs)
    if as_json:
        print_json({"runs": ended.rows, "failed": ended.documents()})
    elif ended.rows:
        first = ended.rows[0]
        look = "evaluate" if first["crispness"] is None else "show"  # None is without clauses
        next_one = here(f"next: paddlectl {look} {first['policy']}")
        print_text([table(TRAINED, ended.rows, "Trained"), next_one])
    ended.require_all()


def train_jobs(
    tasks: "Sequence[str]",
    seeds: "Sequence[int]",
    frames: int | None = None,
    preset: str | None = None,
    method: str = "hdm",
    changed: "Sequence[str]" = (),
) -> "list[TrainJob]":
    """One job for each task and seed, the tasks of one seed together.

    Args:
        tasks: Their names, or files.
        seeds: Of each.
        frames: The budget; None is the usual one.
        preset: Instead of the usual settings.
        method: By which.
        changed: What differs from them, as after `--set`.

    Raises:
        NotFoundError: If there is no such task, or the method has no such preset for one of them.
        UsageError: If there is no such method, or it is none for a source, or can't be changed so.
    """
    from paddlectl.cli.named import task_named
    from paddlectl.methods.catalogue import alone, entry_of, require_actions
    from paddlectl.scenario import ambiguous
    from paddlectl.tasks.suite import load

    asked = dict.fromkeys(map(task_named, tasks))
    known = {task: load(task) for task in asked}
    if wrong := ambiguous(asked):
        raise UsageError(wrong)
    if entry_of(method, alone).teaches:
        raise UsageError(f"{method} reuses sources, so it trains none", f"one of: {', '.join(alone())}")
    for task in known.values():
        require_actions(method, task, alone)
        _require_preset(method, task, preset)

    from paddlectl.experiments.jobs import TrainJob

    changes = changes_for(method, known.values(), None, changed, preset)
    return [
        TrainJob(name, seed, frames, changes.settings, preset, method) for seed in seeds for name in known
    ]


def changes_for(
    method: str,
    tasks: "Iterable[Task]",
    scenario: "Scenario | None",
    given: "Sequence[str]",
    preset: str | None = None,
) -> "Changes":
    """What `--set` changes of a method's numbers for tasks.

    Raises:
        UsageError: If they can't be changed so.
    """
    from paddlectl.methods.changes import Changes, require_fit, typed

    if not given:  # and nothing that takes long to load
        return Changes({}, {})
    from paddlectl.methods.base import method_of

    changes = typed(given)
    for task in tasks:
        require_fit(method_of(method), task, scenario, changes, preset)
    return changes


def _require_preset(method: str, task: "Task", preset: str | None) -> None:
    from paddlectl.methods.catalogue import entry_of, usable
    from paddlectl.registry.names import shown

    has = entry_of(method).presets.get(task.domain, ())
    if preset is None or preset in has:
        return
    others = [
        name
        for name, entry in usable().items()
        if preset in entry.presets.get(task.domain, ()) and not entry.teaches
    ]
    hint = f"its presets: {', '.join(has)}" if has else "it has none: leave out --preset"
    more = f", or take another method: {', '.join(others)}" if others else ""
    raise NotFoundError(f"{method} has no preset {shown(preset)} for {task.name}", hint + more)


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

    with Registry.open(registry) as opened:  # what can't be is told before anything is trained
        opened.require_free(None, {str(job.task) for job in jobs})

    with stdout_kept():
        asked = [
            Asked(job, f"{job.task} seed {job.seed}", "train", job.method, str(job.task), _budget(job))
            for job in jobs
        ]
        return run(asked, registry, checkpoint_every, at_a_time)


def _budget(job: "TrainJob") -> int:
    if job.frames is not None:
        return job.frames
    from paddlectl.experiments.runner import budget_of  # loads torch

    return budget_of(job)
