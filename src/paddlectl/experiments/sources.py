"""Learning a source, keeping a policy, reviving and evaluating it."""

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import safetensors
import safetensors.torch
import torch

from paddlectl.errors import IntegrityError
from paddlectl.experiments.curves import Known
from paddlectl.experiments.jobs import Progress, TrainJob
from paddlectl.experiments.log import RunLog, recorded, versions
from paddlectl.experiments.pace import Pace
from paddlectl.hybrid import training
from paddlectl.hybrid.policy import HybridPolicy, HybridSettings, settings_for, settings_from
from paddlectl.logic.syntax import format_program
from paddlectl.registry.records import PolicyRecord, RunRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.base import Task
from paddlectl.tasks.suite import load

RECENT = 500
"""Latest episodes that the crispness shown meanwhile is over."""

EVALUATION_EPISODES = 200
EVALUATION_SEED = 12345


def train_source(
    job: TrainJob, registry: Registry, report: Callable[[Progress], None], pace: Pace | None = None
) -> dict[str, Any]:
    """Learns a source with the hybrid model.

    Args:
        job: What to learn.
        registry: Where it is kept.
        report: Told of each round.
        pace: When checkpoints are kept, and the run to go on with, if any.

    Returns:
        A row of `train --json`.
    """
    task = load(job.task)
    settings = settings_for(task, preset(task, job.preset), job.hybrid)
    frames = job.frames or settings.frames
    pace = pace or Pace()
    run = pace.begin(
        registry,
        lambda: registry.add_run(
            kind="train",
            method="hdm",
            task=task.name,
            scenario=None,
            sources=(),
            seed=job.seed,
            settings={"frames": frames, "preset": job.preset, "hybrid": dataclasses.asdict(settings)},
            versions=versions(),
        ),
    )
    with recorded(registry, run) as log:
        policy = HybridPolicy(task, job.seed, settings)
        learning = training.train(policy, job.seed, frames)
        recent = _Recent(len(policy.clauses.bodies))
        pace.tell_of_rounds(frames, learning.round)
        with pace.rounds(registry, log, {"learning": learning, "recent": recent}) as after_round:
            for round_ in learning:
                recent.add(log.add(round_))
                crisp = training.crispness(policy, recent.shares())
                log.write(round_, crispness=crisp)
                report(log.progress(max(frames, learning.round), f"crisp {crisp:.2f}"))
                after_round()
        kept = keep(registry, run, policy, log)
        log.results = _figures(kept)
    return {
        "run": run.id,
        "policy": kept.id,
        "task": task.name,
        "seed": job.seed,
        **log.counts(),
        "success_rate": kept.success_rate,
        "mean_score": kept.mean_score,
        "crispness": kept.crispness,
    }


def preset(task: Task, name: str | None) -> Mapping[str, Any]:
    """What that preset of the task's changes; None changes nothing.

    Raises:
        KeyError: If the task has no such preset.
    """
    return task.presets[name] if name else {}


def random_source(task: str, seed: int, registry: Registry) -> PolicyRecord:
    """Keeps a policy as it is before it learns: a source that has nothing to teach.

    Its method is `random`. It is the best policy of its task only while no other solves more.
    """
    settings = settings_for(load(task))
    run = registry.add_run(
        kind="train",
        method="random",
        task=task,
        scenario=None,
        sources=(),
        seed=seed,
        settings={"frames": 0, "hybrid": dataclasses.asdict(settings)},
        versions=versions(),
    )
    with recorded(registry, run) as log:
        kept = keep(registry, run, HybridPolicy(load(task), seed, settings), log)
        log.results = _figures(kept)
    return kept


def _figures(kept: PolicyRecord) -> dict[str, float]:
    return {
        "success_rate": kept.success_rate,
        "mean_score": kept.mean_score,
        "mean_length": kept.mean_length,
        "crispness": kept.crispness,
    }


class _Recent:
    """Which of so many scenes the latest known episodes came through."""

    def __init__(self, scenes: int) -> None:
        self._known = 0
        self._passed = np.zeros((RECENT, scenes), np.bool_)

    def add(self, known: Sequence[Known]) -> None:
        """Takes in the next episodes."""
        passed = np.zeros((len(known), self._passed.shape[1]), np.bool_)
        for row, episode in zip(passed, known, strict=True):
            row[list(episode.scenes)] = True
        self._known += len(known)
        self._passed = np.concatenate([self._passed, passed])[-RECENT:]

    def shares(self) -> np.ndarray:
        """Share of the episodes that came through each scene; 0 before the first. [S]"""
        shares: np.ndarray = self._passed.sum(0) / max(1, min(self._known, RECENT))
        return shares


def keep(registry: Registry, run: RunRecord, policy: HybridPolicy, log: RunLog) -> PolicyRecord:
    """Evaluates what was learned on unseen layouts and publishes it, only once for a run that is resumed.

    Its settings are kept with it, for it to be revived by.
    """
    task = policy.task
    data = checkpoint(policy)
    known = registry.run(run.id).policy
    if known and registry.policy(known).checkpoint == hashlib.sha256(data).hexdigest():
        return registry.policy(known)
    with _one_thread():
        result = training.evaluate(policy, task, EVALUATION_EPISODES, EVALUATION_SEED)
    chosen = {"preset": run.settings["preset"]} if run.settings.get("preset") else {}
    return registry.add_policy(
        run=run.id,
        task=task.name,
        domain=task.domain,
        method=run.method,
        seed=run.seed,
        frames=log.frames,
        program=format_program(result.program),
        checkpoint=data,
        success_rate=result.success_rate,
        mean_score=result.mean_score,
        mean_length=result.mean_length,
        crispness=result.crispness,
        metadata={
            **_symbols(task),
            **chosen,
            "settings": dataclasses.asdict(policy.settings),
            "evaluation": {"episodes": EVALUATION_EPISODES, "seed": EVALUATION_SEED},
        },
    )


def _symbols(task: Task) -> dict[str, list[str]]:
    """What the rows and columns of a policy's tensors stand for."""
    return {
        "heads": [str(head) for head in task.heads],
        "atoms": [str(atom) for atom in task.vocabulary.atoms],
        "domain_heads": [str(head) for head in task.domain_heads],
    }


def checkpoint(policy: HybridPolicy) -> bytes:
    """The policy's tensors as a safetensors file; equal tensors give equal bytes."""
    tensors = {name: tensor.detach().contiguous() for name, tensor in policy.state().items()}
    return safetensors.torch.save(tensors)


def revive(registry: Registry, record: PolicyRecord) -> HybridPolicy:
    """The policy of a record, with its tensors and the settings that it was kept with.

    Raises:
        IntegrityError: If the checkpoint isn't what was stored, or of another shape than its task asks for,
            or if this version can't read its settings.
    """
    task = load(record.task)
    try:
        _require_symbols(record, task)
        policy = HybridPolicy(task, record.seed, _settings_of(registry, record, task))
        policy.load(safetensors.torch.load(registry.read_checkpoint(record)))
    except (RuntimeError, KeyError, TypeError, safetensors.SafetensorError) as error:
        raise IntegrityError(
            f"the checkpoint of {record.id} doesn't fit {record.task} as this version defines it",
            f"train it again: paddlectl train {record.task}",
        ) from error
    return policy


def _require_symbols(record: PolicyRecord, task: Task) -> None:
    for name, symbols in _symbols(task).items():
        if record.metadata.get(name, symbols) != symbols:
            raise KeyError(name)


def _settings_of(registry: Registry, record: PolicyRecord, task: Task) -> HybridSettings:
    """Those kept with the policy; with an older one, those of its run, or today's of its preset.

    Raises:
        IntegrityError: If this version can't read them.
        KeyError: If the task has no such preset.
    """
    stored, today = record.metadata.get("settings"), None
    if stored is None:
        stored = registry.run(record.run).settings.get("hybrid", {})
        today = settings_for(task, preset(task, record.metadata.get("preset")))
    try:
        return settings_from(task, stored, today)
    except ValueError as error:
        raise IntegrityError(
            f"the settings of {record.id} aren't what this version writes: {str(error)[:100]}",
            "use the version of paddlectl that learned it",
        ) from error


@contextmanager
def _one_thread() -> Iterator[None]:
    """As in the processes of runs: with several, torch may add in another order, and a bit may differ."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def evaluate(registry: Registry, policy: PolicyRecord, task: str, episodes: int, seed: int) -> dict[str, Any]:
    """Plays a policy on unseen layouts of a task of its domain.

    The same four give the same figures to the last bit, those that the policy was kept with among them.

    Returns:
        The document of `evaluate --json`.

    Raises:
        IntegrityError: If the task is of another domain, or the checkpoint isn't what was stored.
    """
    played = load(task)
    if played.domain != policy.domain:
        raise IntegrityError(
            f"{policy.id} is a {policy.domain} policy; {task} is a {played.domain} task",
            "policies can be played within their domain only",
        )
    revived = revive(registry, policy)
    with _one_thread():
        result = training.evaluate(revived, played, episodes, seed)
    return {
        "policy": policy.id,
        "task": played.name,
        "episodes": episodes,
        "seed": seed,
        "success_rate": result.success_rate,
        "mean_score": result.mean_score,
        "mean_length": result.mean_length,
    }
