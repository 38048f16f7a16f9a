"""One run of any method: recorded and checkpointed, and what it learned is evaluated and kept."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from paddlectl.agents.interaction import Learning
from paddlectl.agents.recording import Recorder
from paddlectl.agents.settings import changed, leaves
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.curves import LearningCurve
from paddlectl.experiments.jobs import Progress, TrainJob, TransferJob
from paddlectl.experiments.log import RunLog, ended_episodes, recorded, versions
from paddlectl.experiments.policies import definition_of, keep, require_whole, revive
from paddlectl.experiments.recordings import recordings_document
from paddlectl.experiments.similar import stored_program
from paddlectl.methods.base import Method, Setup, Source, method_of
from paddlectl.methods.catalogue import entry_of, require_actions
from paddlectl.methods.changes import RULES
from paddlectl.registry.records import RECORDINGS, PolicyRecord, RunRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import AnyTask, load

Report = Callable[[Progress], None]
INEXACT = (
    "its environment isn't the same again by its seed and actions; "
    "a run that is stopped goes on from the beginnings of its last episodes"
)


def train_source(
    job: TrainJob, registry: Registry, report: Report, checkpointer: Checkpointer | None = None
) -> dict[str, Any]:
    """Learns a source.

    Args:
        job: What to learn.
        registry: Where it is kept.
        report: Told of each round.
        checkpointer: When checkpoints are kept, and the run to go on with, if any.

    Returns:
        A row of `train --json`.
    """
    task, method = load(job.task), method_of(job.method)
    require_actions(method.name, task)
    settings, frames = settings_of(job), budget_of(job)
    differing = differences(method.settings_for(task, None), settings)
    checkpointer = checkpointer or Checkpointer()
    run = checkpointer.begin(
        registry,
        lambda: registry.add_run(
            kind="train",
            method=method.name,
            task=task.name,
            scenario=None,
            sources=(),
            seed=job.seed,
            settings={
                "frames": frames,
                "preset": job.preset,
                "learning": dataclasses.asdict(settings),
                "unusual": differing,
                **definition_of(task),
            },
            versions=versions(),
            name=job.name,
            tags=job.tags,
        ),
    )
    with recorded(registry, run) as log:
        kept = _learned(
            registry, run, method, Setup(task, settings, job.seed, frames), log, report, checkpointer
        )
        log.results = figures_of(kept)
    return {
        "run": run.id,
        "policy": kept.id,
        "task": task.name,
        "method": method.name,
        "seed": job.seed,
        **log.counts(),
        "success_rate": kept.success_rate,
        "mean_score": kept.mean_score,
        "crispness": kept.crispness,
    }


def settings_of(job: TrainJob | TransferJob) -> Any:
    """The method's numbers that a task is learned by.

    Raises:
        KeyError: If the method has no such preset for the task.
    """
    method = method_of(job.method)
    if isinstance(job, TransferJob):
        scenario = job.scenario
        return method.settings_for(load(scenario.target), scenario, scenario.settings, job.changes)
    task = load(job.task)
    if job.preset is None:
        return method.settings_for(task, None, job.changes)
    return changed(method.presets(task)[job.preset], job.changes)


def rules_of(job: TransferJob) -> Any:
    """By which the method reuses sources; None if its settings tell all."""
    if job.rules:
        return job.rules
    rules = method_of(job.method).rules_for(load(job.scenario.target))
    return changed(rules, job.scenario.rules) if job.scenario.rules else rules


def differences(usual: Any, own: Any, before: str = "") -> dict[str, Any]:
    """What differs from usual settings or rules: each name as after `--set`, with the usual value."""
    chosen = dict(leaves(own))
    return {before + name: value for name, value in leaves(usual) if chosen[name] != value}


def budget_of(job: TrainJob) -> int:
    """Most environment steps that a source is learned with."""
    return job.frames or int(settings_of(job).frames)


def run_transfer(
    job: TransferJob, registry: Registry, report: Report, checkpointer: Checkpointer | None = None
) -> dict[str, Any]:
    """Learns a scenario's target.

    Args:
        job: What to learn.
        registry: Where it is kept.
        report: Told of each round.
        checkpointer: When checkpoints are kept, and the run to go on with, if any.

    Returns:
        A row of `transfer --json`.
    """
    task, method = load(job.scenario.target), method_of(job.method)
    require_actions(method.name, task)
    settings, rules = settings_of(job), rules_of(job)
    differing = differences(method.settings_for(task, job.scenario), settings)
    differing |= differences(method.rules_for(task), rules, f"{RULES}.")
    reused = job.sources if entry_of(method.name).teaches else ()
    checkpointer = checkpointer or Checkpointer()
    run = checkpointer.begin(
        registry,
        lambda: registry.add_run(
            kind="transfer",
            method=method.name,
            task=task.name,
            scenario=job.scenario.name,
            sources=reused,
            seed=job.seed,
            settings={
                "frames": job.frames,
                "scenario": job.scenario.model_dump(mode="json"),
                "learning": dataclasses.asdict(settings),
                "rules": rules and dataclasses.asdict(rules),
                "unusual": differing,
                **definition_of(task),
            },
            versions=versions(),
            name=job.name,
            tags=job.tags,
        ),
    )
    with recorded(registry, run) as log:
        setup = Setup(task, settings, job.seed, job.frames, (), job.scenario, rules)
        kept = _learned(registry, run, method, setup, log, report, checkpointer)
        figures = LearningCurve(ended_episodes(registry, run.id), log.frames).figures()
        log.results = figures | figures_of(kept)
    return {
        "run": run.id,
        "policy": kept.id,
        "method": method.name,
        "sources": list(run.sources),
        "seed": job.seed,
        **log.counts(),
        **figures,
        "success_rate": kept.success_rate,
    }


def _learned(
    registry: Registry,
    run: RunRecord,
    method: Method,
    setup: Setup,
    log: RunLog,
    report: Report,
    checkpointer: Checkpointer,
) -> PolicyRecord:
    """Runs the method's agent within its budget, and keeps its policy; the run says which sources it has."""
    sources = tuple(_source(registry, policy) for policy in run.sources)
    agent = method.make(setup._replace(sources=sources))
    del sources  # what the agent doesn't need of them is free
    layouts = np.random.SeedSequence(setup.seed).spawn(1)[0]
    settings = setup.settings
    environment = setup.task.make(
        settings.num_envs, int(layouts.generate_state(1)[0]), settings.action_repeat
    )
    recorder = Recorder(environment, setup.task.horizon) if hasattr(environment, "start") else None
    learning = Learning(environment, agent, setup.frames, recorder)
    _keep_documents(registry, run, agent.documents())
    checkpointer.tell_of_rounds(setup.frames, learning.round)
    with checkpointer.rounds(registry, log, {"learning": learning}) as after_round:
        if not getattr(environment, "exact", True):
            checkpointer.tell(f"{setup.task.name}: {INEXACT}")
        for round_ in learning:
            log.add(round_)
            _keep_rows(registry, run, agent.record(round_.frames, round_.episodes, log.curve.known))
            log.write(round_)
            note = "  ".join(f"{name} {value:.2f}" for name, value in round_.figures.items())
            report(log.progress(max(setup.frames, learning.round), note))
            after_round()
    _keep_rows(registry, run, agent.close())
    _keep_documents(registry, run, agent.documents())
    if recorder is not None:
        told = recordings_document(setup.task, settings.action_repeat, recorder.kept)
        registry.files.write_document(run.id, RECORDINGS, told)
    return keep(registry, run, agent.policy(), log)


def _keep_rows(registry: Registry, run: RunRecord, tables: Any) -> None:
    for name, rows in tables.items():
        registry.files.append_rows(run.id, name, rows)


def _keep_documents(registry: Registry, run: RunRecord, documents: Any) -> None:
    for name, document in documents.items():
        registry.files.write_document(run.id, name, document)


def _source(registry: Registry, policy: str) -> Source:
    record = registry.policy(policy)
    program = None if record.program is None else stored_program(record)
    task = require_whole(registry, record)
    return Source(record.id, task, program, record.checkpoint, partial(revive, registry, record))


def random_source(task: AnyTask, seed: int, registry: Registry) -> PolicyRecord:
    """Keeps a policy as it is before it learns: a source that has nothing to teach.

    Its method is `random`. It is the best policy of its task only while no other solves more.
    """
    method, loaded = method_of("hdm"), load(task)
    settings = method.settings_for(loaded, None)
    run = registry.add_run(
        kind="train",
        method="random",
        task=loaded.name,
        scenario=None,
        sources=(),
        seed=seed,
        settings={"frames": 0, "learning": dataclasses.asdict(settings), **definition_of(loaded)},
        versions=versions(),
    )
    with recorded(registry, run) as log:
        kept = keep(registry, run, method.policy(loaded, seed, settings), log)
        log.results = figures_of(kept)
    return kept


def figures_of(kept: PolicyRecord) -> dict[str, Any]:
    """How well a policy plays."""
    return {
        "success_rate": kept.success_rate,
        "mean_score": kept.mean_score,
        "mean_length": kept.mean_length,
        "crispness": kept.crispness,
    }
