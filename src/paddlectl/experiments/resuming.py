"""Going on with a run that was stopped, from what the registry says of it."""

import dataclasses
import json
from collections.abc import Callable
from typing import Any

from paddlectl.agents.settings import restored
from paddlectl.errors import IntegrityError
from paddlectl.experiments.checkpointer import Checkpointer, require_resumable
from paddlectl.experiments.jobs import Progress, TrainJob, TransferJob
from paddlectl.experiments.policies import needs_of, task_of
from paddlectl.experiments.runner import run_transfer, train_source
from paddlectl.methods.base import Method
from paddlectl.registry import fields
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.tasks.base import Task
from paddlectl.tasks.suite import AnyTask


def resume(
    run: str, registry: Registry, report: Callable[[Progress], None], checkpointer: Checkpointer
) -> dict[str, Any]:
    """Goes on where the run's last checkpoint was; it ends as if it had never been stopped.

    Returns:
        A row of `train --json` or of `transfer --json`.

    Raises:
        NotFoundError: If there is no such run.
        UsageError: If it can't go on.
        RegistryBusyError: If it goes on in another process.
        IntegrityError: If none of its checkpoints is whole, or none fits this version.
    """
    record = registry.run(run)
    require_resumable(record)
    checkpointer.resumed = record.id
    job = job_of(record)
    if isinstance(job, TrainJob):
        return train_source(job, registry, report, checkpointer)
    return run_transfer(job, registry, report, checkpointer)


def job_of(run: RunRecord) -> TrainJob | TransferJob:
    """The job that a run was begun with.

    Raises:
        IntegrityError: If this version can't read its settings, or lacks its task or method.
    """
    told, (task, method) = run.settings, needs_of(run)
    try:
        frames = _budget(told["frames"])
        changes = dataclasses.asdict(method.settings_from(task, told["learning"]))
        if run.kind == "train":
            preset = _preset(method, task, told["preset"])
            return TrainJob(task_of(run), run.seed, frames, changes, preset, method.name)
        return TransferJob(
            scenario=_scenario(told["scenario"], task_of(run)),
            sources=run.sources,
            method=method.name,
            seed=run.seed,
            frames=frames,
            rules=told["rules"] and restored(method.rules_for(task), told["rules"], "rules"),
            changes=changes,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise IntegrityError(
            f"the settings of {run.id} aren't what this version writes: {str(error)[:100]}",
            "go on with the version of paddlectl that the run began with",
        ) from error


def _preset(method: Method, task: Task, name: Any) -> str | None:
    if name is not None and name not in method.presets(task):
        raise ValueError(f"there is no preset {str(name)[:60]!r}")
    return None if name is None else str(name)


def _budget(frames: Any) -> int:
    if wrong := fields.misfit({"frames": frames}, {"frames": fields.BUDGET}):
        raise ValueError(wrong)
    return int(frames)


def _scenario(told: Any, target: AnyTask) -> Scenario:
    """The scenario that a run was begun with, its target as it was then.

    Raises:
        ValueError: If it isn't one, or guides by the paper in a way that it doesn't tell (before 0.1.0).
    """
    if told["guidance"] == {"mode": "paper"}:
        raise ValueError("its guidance tells no readings of the paper")
    return Scenario.model_validate_json(json.dumps(told)).model_copy(update={"target": target})
