"""Runs of jobs as the runner enters them, without their being done."""

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

from paddlectl.experiments.jobs import Job, RandomJob, TrainJob, TransferJob
from paddlectl.experiments.policies import definition_of
from paddlectl.experiments.runner import budget_of, rules_of, settings_of
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from samples import add_policy


def entered(
    registry: Registry,
    job: Job,
    status: str = "finished",
    text: str | None = None,
    change: Callable[[dict[str, Any]], None] = lambda _: None,
) -> str:
    """A run as the runner enters it for a job, its settings changed, and how it ended."""
    kind, method, task, sources, settings = told(job)
    settings = json.loads(json.dumps(settings))
    change(settings)
    run = registry.add_run(
        kind=kind,
        method=method,
        task=task,
        scenario="A" if kind == "transfer" else None,
        sources=sources,
        seed=job.seed,
        settings=settings,
        versions={},
    ).id
    if status == "finished":
        add_policy(registry, run, task, text, method=method, seed=job.seed)
    if status != "running":
        registry.finish_run(run, status=status, frames=9, episodes=1, seconds=1.0, results={})
    return run


def told(job: Job) -> tuple[str, str, str, tuple[str, ...], Mapping[str, Any]]:
    match job:
        case TransferJob():
            task, rules = load(job.scenario.target), rules_of(job)
            settings = {
                **definition_of(task),
                "frames": job.frames,
                "scenario": job.scenario.model_dump(mode="json"),
                "learning": dataclasses.asdict(settings_of(job)),
                "rules": rules and dataclasses.asdict(rules),
            }
            return "transfer", job.method, task.name, job.sources, settings
        case TrainJob():
            learning = {"learning": dataclasses.asdict(settings_of(job)), "frames": budget_of(job)}
            return "train", job.method, str(job.task), (), learning | definition_of(load(job.task))
        case RandomJob():
            drawn = TrainJob(job.task, job.seed)
            return (
                "train",
                "random",
                str(job.task),
                (),
                {"learning": dataclasses.asdict(settings_of(drawn)), "frames": 0},
            )
    raise AssertionError(job)
