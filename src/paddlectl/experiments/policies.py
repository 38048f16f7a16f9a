"""Keeping a policy, reviving it and evaluating it: what was stored is what is loaded."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import safetensors
import safetensors.torch
import torch

from paddlectl.agents.base import Policy
from paddlectl.agents.evaluation import evaluate as played
from paddlectl.errors import IntegrityError, NotFoundError, UsageError
from paddlectl.experiments.log import RunLog
from paddlectl.logic.syntax import format_program
from paddlectl.methods import catalogue
from paddlectl.methods.base import Method, method_of
from paddlectl.registry.names import shown
from paddlectl.registry.records import DEFINITION, PolicyRecord, RunRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.base import Task
from paddlectl.tasks.naming import kept
from paddlectl.tasks.suite import AnyTask, load

EVALUATION_EPISODES = 200
EVALUATION_SEED = 12345


def keep(registry: Registry, run: RunRecord, policy: Policy, log: RunLog) -> PolicyRecord:
    """Evaluates what was learned on unseen layouts and publishes it, only once for a run that is resumed.

    Its settings are kept with it, for it to be revived by.
    """
    task = policy.task
    data = checkpoint(policy)
    known = registry.run(run.id).policy
    if known and registry.policy(known).checkpoint == hashlib.sha256(data).hexdigest():
        return registry.policy(known)
    with one_thread():
        result = played(policy, task, EVALUATION_EPISODES, EVALUATION_SEED)
    return registry.add_policy(
        run=run.id,
        task=task.name,
        domain=task.domain,
        method=run.method,
        seed=run.seed,
        frames=log.frames,
        program=None if result.program is None else format_program(result.program),
        checkpoint=data,
        success_rate=result.success_rate,
        mean_score=result.mean_score,
        mean_length=result.mean_length,
        crispness=result.crispness,
        metadata={
            **_symbols(task),
            **definition_of(task),
            "settings": policy.settings_document(),
            "evaluation": {"episodes": EVALUATION_EPISODES, "seed": EVALUATION_SEED},
        },
    )


def definition_of(task: Task) -> dict[str, Any]:
    """What a run's settings and a policy's metadata have for a task from a file; nothing for another."""
    return {} if task.definition is None else {DEFINITION: dict(task.definition)}


def _symbols(task: Task) -> dict[str, list[str]]:
    """What the rows and columns of a policy's tensors stand for."""
    return {
        "heads": [str(subgoal) for subgoal in task.subgoals],
        "atoms": [str(atom) for atom in task.vocabulary.atoms],
        "domain_heads": [str(subgoal) for subgoal in task.domain_subgoals],
    }


def checkpoint(policy: Policy) -> bytes:
    """The policy's tensors as a safetensors file; equal tensors give equal bytes."""
    tensors = {name: tensor.detach().contiguous() for name, tensor in policy.state().items()}
    return safetensors.torch.save(tensors)


def revive(registry: Registry, record: PolicyRecord) -> Policy:
    """The policy of a record, with its tensors and the settings that it was kept with.

    Raises:
        IntegrityError: If the checkpoint isn't what was stored, or of another shape than its task asks for,
            or if this version can't read its settings, or lacks its task or method.
    """
    task, method = needs_of(record)
    with _fitting(registry, record):
        _require_symbols(record, task)
        policy = method.policy(task, record.seed, _settings_of(registry, record, task, method))
        policy.load(safetensors.torch.load(registry.read_checkpoint(record)))
    return policy


def require_whole(registry: Registry, record: PolicyRecord) -> Task:
    """Refuses a policy that is damaged or that this version lacks something for, without loading it.

    Returns:
        Its task.

    Raises:
        IntegrityError: As `revive` does.
    """
    task, method = needs_of(record)
    with _fitting(registry, record):
        _require_symbols(record, task)
        _settings_of(registry, record, task, method)
        registry.read_checkpoint(record)
    return task


@contextmanager
def _fitting(registry: Registry, record: PolicyRecord) -> Iterator[None]:
    """Tells what fails within as a checkpoint's fault."""
    try:
        yield
    except (RuntimeError, KeyError, TypeError, safetensors.SafetensorError) as error:
        raise IntegrityError(
            f"the checkpoint of {record.id} doesn't fit {record.task} as this version defines it",
            registry.way_again(record),
        ) from error


def needs_of(record: PolicyRecord | RunRecord) -> tuple[Task, Method]:
    """The task and the method of a policy or a run.

    Raises:
        IntegrityError: If one isn't there, as when the plug-in that had it is uninstalled.
    """
    try:
        task = load(task_of(record))
    except NotFoundError as error:
        ways = "install the plug-in, or name its file: --tasks FILE.py, in Python paddlectl.add_tasks(FILE)"
        raise _lacking(record, f"on {shown(record.task)}", ways) from error
    try:
        return task, method_of(catalogue.MADE_AS.get(record.method, record.method))
    except UsageError as error:
        raise _lacking(record, f"by {shown(record.method)}", "or install the plug-in") from error


def task_of(record: PolicyRecord | RunRecord) -> AnyTask:
    """The task of a policy or a run as it was then, for `tasks.suite.load`.

    Raises:
        IntegrityError: If what defines it is damaged.
    """
    return kept(*record.content)


def _lacking(record: PolicyRecord | RunRecord, what: str, ways: str) -> IntegrityError:
    return IntegrityError(
        f"{record.id} was learned {what}, which this version doesn't have",
        f"use the version of paddlectl that learned it, {ways}",
    )


def _require_symbols(record: PolicyRecord, task: Task) -> None:
    for name, symbols in _symbols(task).items():
        if record.metadata.get(name, symbols) != symbols:
            raise KeyError(name)


def _settings_of(registry: Registry, record: PolicyRecord, task: Task, method: Method) -> Any:
    """Those kept with the policy; with an older one, those of its run, or today's of its preset.

    Raises:
        IntegrityError: If this version can't read them.
        KeyError: If there is no such preset for the task.
    """
    stored, today = record.metadata.get("settings"), None
    if stored is None:
        stored = registry.run(record.run).settings.get("hybrid", {})
        chosen, hdm = record.metadata.get("preset"), method_of("hdm")
        presets = {**method_of("paddle").presets(task), **hdm.presets(task)}  # of all methods that there were
        today = presets[chosen] if chosen else hdm.settings_for(task, None)
    try:
        return method.settings_from(task, stored, today)
    except ValueError as error:
        raise IntegrityError(
            f"the settings of {record.id} aren't what this version writes: {str(error)[:100]}",
            "use the version of paddlectl that learned it",
        ) from error


def require_domain(policy: PolicyRecord, task: Task) -> None:
    """Refuses a task that the policy can't act in.

    Raises:
        IntegrityError: If it is of another domain.
    """
    if task.domain != policy.domain:
        raise IntegrityError(
            f"{policy.id} is a {policy.domain} policy; {task.name} is a {task.domain} task",
            "policies can be played within their domain only",
        )


@contextmanager
def one_thread() -> Iterator[None]:
    """As in the processes of runs: with several, torch may add in another order, and a bit may differ."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def evaluate(
    registry: Registry, policy: PolicyRecord, task: AnyTask, episodes: int, seed: int
) -> dict[str, Any]:
    """Plays a policy on unseen layouts of a task of its domain; by its own task's name on that.

    The same four give the same figures to the last bit, those that the policy was kept with among them.

    Returns:
        The document of `evaluate --json`.

    Raises:
        NotFoundError: If there is no such task.
        IntegrityError: If the task is of another domain, or the policy can't be revived.
    """
    environment = needs_of(policy)[0] if task == policy.task else load(task)
    require_domain(policy, environment)
    revived = revive(registry, policy)
    with one_thread():
        result = played(revived, environment, episodes, seed)
    return {
        "policy": policy.id,
        "task": environment.name,
        "episodes": episodes,
        "seed": seed,
        "success_rate": result.success_rate,
        "mean_score": result.mean_score,
        "mean_length": result.mean_length,
    }
