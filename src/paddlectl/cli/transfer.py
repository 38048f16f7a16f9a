"""`paddlectl transfer`."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from paddlectl import shipped
from paddlectl.cli.named import UNLABELLED, Labels, labels_of
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
    at_home,
    chosen_seeds,
    complete_scenarios,
    one_method_of,
)
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.methods.catalogue import METHODS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from paddlectl.cli.running import Asked
    from paddlectl.experiments.jobs import TrainJob
    from paddlectl.experiments.sources import Sources
    from paddlectl.methods.changes import Changes
    from paddlectl.registry.store import Registry
    from paddlectl.scenario import Scenario

EXAMPLE = "Example: paddlectl transfer A --seed 0 --frames 60000 --train-missing"


ScenarioFile = Annotated[
    str,
    typer.Argument(
        parser=at_home,
        metavar="FILE.yaml|NAME",
        autocompletion=complete_scenarios,
        help="A scenario: target, sources, method, seeds, frames. Its file, or one that is shipped: "
        f"{', '.join(shipped.scenarios())}.",
        show_default=False,
    ),
]
AnyMethod = Annotated[
    str | None,
    typer.Option(
        metavar="M",
        autocompletion=one_method_of(METHODS),
        help=f"Instead of the scenario's: {', '.join(METHODS)}.",
        show_default=False,
    ),
]
ItsFrames = Annotated[
    int | None,
    typer.Option(
        parser=FRAMES,
        metavar="N",
        help="Environment steps, instead of the scenario's.",
        show_default=False,
    ),
]


def transfer(
    file: ScenarioFile,
    method: AnyMethod = None,
    seed: OneSeed = None,
    seeds: ManySeeds = None,
    frames: ItsFrames = None,
    changed: Changed = None,
    train_missing: Annotated[
        bool, typer.Option("--train-missing", help="Train the sources that the registry lacks.")
    ] = False,
    name: RunName = None,
    tag: Tags = None,
    jobs: Jobs = None,
    checkpoint_every: CheckpointEvery = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Learn a scenario's target, guided by policies of its sources."""
    from paddlectl.cli.quiet import stdout_kept
    from paddlectl.cli.texts import here
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import TRANSFERRED, table
    from paddlectl.scenario import load_scenario

    scenario = load_scenario(shipped.scenario(file))
    chosen = chosen_seeds(seed, seeds, scenario.seeds)
    method = scenario.method if method is None else method
    labels = labels_of(name, tag, [str(scenario.target)] * len(chosen), registry)
    with stdout_kept():
        changes = changes_of(scenario, method, changed or ())
        found = sources_of(scenario, method, chosen, registry, train_missing, jobs)
    if any(found.ids.values()):
        print(plan_of(found), file=sys.stderr)
    with stdout_kept():
        from paddlectl.cli.running import run

        asked = asked_for(scenario, found.ids, method, frames or scenario.frames, changes, labels)
        ended = run(asked, registry, checkpoint_every, jobs)
    if as_json:
        why = [{"seed": seed, **each._asdict()} for seed, its in found.why.items() for each in its]
        told = {"scenario": scenario.name, "target": str(scenario.target), **({"chosen": why} if why else {})}
        print_json({**told, "runs": ended.rows, "failed": ended.documents()})
    elif ended.rows:
        title = f"Scenario {scenario.name}: {scenario.target}"
        next_one = here(f"next: paddlectl explain {ended.rows[0]['run']}")
        print_text([table(TRANSFERRED, ended.rows, title), next_one])
    ended.require_all()


def changes_of(scenario: "Scenario", method: str, given: "Sequence[str]") -> "Changes":
    """What `--set` changes, over what the scenario does.

    Raises:
        UsageError: If the method's numbers can't be changed so; or not as the scenario says, as it is for
            another method.
    """
    from paddlectl.cli.train import changes_for
    from paddlectl.methods.catalogue import require_actions
    from paddlectl.methods.changes import Changes
    from paddlectl.scenario import misfits_of
    from paddlectl.tasks.suite import load

    target = load(scenario.target)
    require_actions(method, target)
    for place, why in misfits_of(scenario, method, Changes(scenario.settings, scenario.rules)):
        raise UsageError(
            f"{scenario.name} sets {'.'.join(place)} for {scenario.method}: {method}: {why}",
            f"leave out --method, or {place[0]} in the file",
        )
    return changes_for(method, [target], scenario, given)


def sources_of(
    scenario: "Scenario",
    method: str,
    seeds: "Sequence[int]",
    location: str,
    train_missing: bool,
    at_a_time: int | None = None,
) -> "Sources":
    """The policies that each seed's transfer reuses; what is missing is trained if that was asked for.

    Raises:
        NotFoundError: If a policy is missing and isn't to be trained.
        UsageError: If one that the scenario names can't be reused.
    """
    from paddlectl.experiments.sources import resolve

    with opened_for(scenario, method, seeds, location, train_missing) as registry:
        found = resolve(registry, scenario, method, seeds)
        if not (found.missing and train_missing):
            found.required()
            return found
        from paddlectl.cli.train import run_training

        run_training(found.missing, location, at_a_time=at_a_time).require_all()
        found = resolve(registry, scenario, method, seeds)
        found.required()
        return found


def missing_of(
    scenario: "Scenario", method: str, seeds: "Sequence[int]", location: str
) -> "Sequence[TrainJob]":
    """What would learn the policies that the registry lacks; it is made where there is none."""
    from paddlectl.experiments.sources import resolve

    with opened_for(scenario, method, seeds, location, train_missing=True) as registry:
        return resolve(registry, scenario, method, seeds).missing


def opened_for(
    scenario: "Scenario", method: str, seeds: "Sequence[int]", location: str, train_missing: bool
) -> "Registry":
    """The registry; it is made where it can come to hold all that is reused.

    Raises:
        NotFoundError: If there is none; with the command that trains the scenario's tasks.
    """
    from paddlectl.experiments.sources import unlearned
    from paddlectl.methods.catalogue import teacher_of
    from paddlectl.registry.names import is_id
    from paddlectl.registry.store import Registry
    from paddlectl.tasks.suite import load

    teaches = teacher_of(method, load(scenario.target))
    if teaches is None:
        return Registry.open(location)
    try:
        learned = scenario.chosen or any(is_id(str(name)) for name in scenario.source_names)
        return Registry.open(location, create=train_missing and not learned)
    except NotFoundError as error:
        lacking = unlearned(scenario, teaches, seeds)
        hint = f"run: {lacking.command()}" if lacking.missing else error.hint
        raise NotFoundError(error.message, hint) from None


def plan_of(sources: "Sources") -> str:
    """Which policies are reused, by the seeds of the transfers: `sources: policy-1, policy-2 (seed 0); …`.

    Those that were chosen stand with their task and ψ.
    """
    from paddlectl.cli.running import MOST_NAMED
    from paddlectl.whole import ranges

    seeds: dict[tuple[str, ...], list[int]] = {}
    for seed, ids in sources.ids.items():
        named = tuple(map(str, sources.why[seed])) if sources.why else ids
        seeds.setdefault(named, []).append(seed)
    if len(seeds) == 1:
        return f"sources: {', '.join(*seeds)}"
    told = [f"{', '.join(ids)} (seed {ranges(its)})" for ids, its in list(seeds.items())[:MOST_NAMED]]
    more = [f"and {len(seeds) - MOST_NAMED} more"] * (len(seeds) > MOST_NAMED)
    return f"sources: {'; '.join(told + more)}"


def asked_for(
    scenario: "Scenario",
    sources: "Mapping[int, tuple[str, ...]]",
    method: str,
    frames: int,
    changes: "Changes",
    labels: Labels = UNLABELLED,
) -> "list[Asked]":
    """A job for each seed."""
    from dataclasses import replace

    from paddlectl.agents.settings import changed
    from paddlectl.cli.running import Asked
    from paddlectl.experiments.jobs import TransferJob
    from paddlectl.experiments.runner import rules_of

    jobs = [TransferJob(scenario, ids, method, seed, frames) for seed, ids in sources.items()]
    if changes.rules:
        rules = changed(rules_of(jobs[0]), changes.rules)
        jobs = [replace(job, rules=rules) for job in jobs]
    jobs = [replace(job, changes=changes.settings, **labels._asdict()) for job in jobs]
    name = f"{scenario.name} {method} seed"
    return [
        Asked(job, f"{name} {job.seed}", "transfer", method, str(scenario.target), frames) for job in jobs
    ]
