"""`paddlectl transfer`."""

from pathlib import Path
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
    complete_scenarios,
    file_at,
)
from paddlectl.errors import NotFoundError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.cli.running import Asked
    from paddlectl.registry.store import Registry
    from paddlectl.scenario import Scenario

EXAMPLE = "Example: paddlectl transfer scenarios/A.yaml --seed 0 --frames 60000 --train-missing"


def transfer(
    file: Annotated[
        Path,
        typer.Argument(
            parser=file_at,
            metavar="FILE.yaml",
            autocompletion=complete_scenarios,
            help="A scenario: target, sources, method, seeds, frames.",
            show_default=False,
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(metavar="M", help="Instead of the scenario's: paddle or hdm.", show_default=False),
    ] = None,
    seed: OneSeed = None,
    seeds: ManySeeds = None,
    frames: Annotated[
        int | None,
        typer.Option(
            parser=FRAMES,
            metavar="N",
            help="Environment steps, instead of the scenario's.",
            show_default=False,
        ),
    ] = None,
    train_missing: Annotated[
        bool, typer.Option("--train-missing", help="Train the sources that the registry lacks.")
    ] = False,
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Learn a scenario's target, guided by policies of its sources."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.texts import here
    from paddlectl.methods.catalogue import teacher_of
    from paddlectl.registry.store import Registry
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TRANSFERRED, table
    from paddlectl.scenario import load_scenario
    from paddlectl.tasks.suite import load

    scenario = load_scenario(file)
    chosen = chosen_seeds(seed, seeds, scenario.seeds)
    method = method or scenario.method
    with stdout_kept():
        teaches = teacher_of(method, load(scenario.target))
    opened = Registry.open(registry, create=train_missing or teaches is None)
    sources = source_policies(opened, scenario, teaches, registry, train_missing, jobs) if teaches else ()
    with stdout_kept():
        from paddlectl.cli.running import run

        asked = asked_for(scenario, sources, method, chosen, frames or scenario.frames)
        ended = run(asked, registry, checkpoint_every, jobs)
    if as_json:
        told = {"scenario": scenario.name, "target": scenario.target}
        print_json({**told, "runs": ended.rows, "failed": ended.documents()})
    elif ended.rows:
        title = f"Scenario {scenario.name}: {scenario.target}"
        next_one = here(f"next: paddlectl explain {ended.rows[0]['run']}")
        print_text([table(TRANSFERRED, ended.rows, title), next_one])
    ended.require_all()


def source_policies(
    registry: "Registry",
    scenario: "Scenario",
    teaches: str,
    location: str,
    train_missing: bool,
    at_a_time: int | None = None,
) -> tuple[str, ...]:
    """Ids of the best policies of the scenario's sources, learned by the method that `teaches`.

    What is missing is trained if that was asked for.

    Raises:
        NotFoundError: If a source has no policy and none is to be trained.
    """
    from paddlectl.experiments.jobs import TrainJob

    solved = registry.solved(method=teaches)
    missing = [task for task in scenario.sources if task not in solved]
    if missing and not train_missing:
        by = "" if teaches == TrainJob.method else f" --method {teaches}"
        raise NotFoundError(
            f"no policy for {', '.join(missing)} by {teaches}",
            f"run: paddlectl train {' '.join(missing)}{by}",
        )
    if missing:
        from paddlectl.cli.train import run_training, train_jobs

        run_training(train_jobs(missing, (0,), method=teaches), location, at_a_time=at_a_time).require_all()
    return tuple(registry.policy(task, teaches).id for task in scenario.sources)


def asked_for(
    scenario: "Scenario", sources: tuple[str, ...], method: str, seeds: "Sequence[int]", frames: int
) -> "list[Asked]":
    """A job for each seed."""
    from paddlectl.cli.running import Asked
    from paddlectl.experiments.jobs import TransferJob

    jobs = [TransferJob(scenario, sources, method, seed, frames) for seed in seeds]
    name = f"{scenario.name} {method} seed"
    return [Asked(job, f"{name} {job.seed}", "transfer", method, scenario.target, frames) for job in jobs]
