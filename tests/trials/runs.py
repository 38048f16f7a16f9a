"""Small runs of every kind, and all that each leaves behind."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import torch

from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.runner import random_source, run_transfer, train_source
from paddlectl.experiments.stop import Stop
from paddlectl.methods.catalogue import METHODS, teacher_of
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from small_transfer import SHORT, SMALL, TARGET, job

SEEDED = ("train", "train maze", "paddle default", "paddle paper", "hdm")
"""Those whose end is recorded."""

KINDS = (
    *SEEDED,
    *(f"train {name}" for name in ("ppo", "td3")),
    *sorted(METHODS.keys() - {"paddle", "hdm", "ppo", "td3"}),
)
FRAMES, ROUNDS = 3072, 12
FLAT = {"num_envs": 8}
FEWER: dict[str, dict[str, Any]] = {
    "componet": {"learner": {"epochs": 1}},
    "cup": {"learner": {"epochs": 1}, "critic_epochs": 1},
    "hdqn": {"meta": {"capacity": 500, "warm_up": 50, "batch": 32}},
    "ptf": {"learner": {"epochs": 1}},
    "qmp": {"rollout_steps": 32, "learner": {"capacity": 2000, "warm_up": 50, "batch": 32}},
}
SOURCES = ("BlockedDoor", "GapBall")
TIME = {"seconds", "created", "finished", "resumes"}


def quiet(_: Any) -> None:
    pass


class StopAfter(Stop):
    """Asks to stop once so many rounds are over."""

    def __init__(self, rounds: int) -> None:
        super().__init__()
        self.rounds = rounds

    @property
    def asked(self) -> bool:  # type: ignore[override]
        self.rounds -= 1
        return self.rounds == 0

    @asked.setter
    def asked(self, value: bool) -> None:
        pass


@contextmanager
def small() -> Iterator[None]:
    """Few episodes; one thread, as runs have."""
    torch.set_num_threads(1)
    with ExitStack() as patches:
        for module, name, value in SHORT:
            patches.enter_context(mock.patch.object(module, name, value))
        yield


@contextmanager
def short_episodes() -> Iterator[None]:
    """Of 64 steps in MiniGrid and 200 in the maze, in this process."""
    with (
        mock.patch("paddlectl.tasks.minigrid.engine.HORIZON", 64),
        mock.patch("paddlectl.tasks.maze2d.engine.HORIZON", 200),
    ):
        yield


def add_sources(registry: Registry) -> None:
    """Four policies: what they teach doesn't matter here."""
    for task in SOURCES:
        random_source(task, 0, registry)
    for task in SOURCES:
        train_source(TrainJob(task, 0, 1, FLAT, method="ppo"), registry, quiet)


def begin(kind: str, registry: Registry, checkpointer: Checkpointer, rounds: int = ROUNDS) -> dict[str, Any]:
    """Starts a run of that kind, or goes on with it."""
    frames = rounds * FRAMES // ROUNDS
    match kind.split():
        case ["train"]:
            return train_source(TrainJob("GapBall", 0, frames, SMALL), registry, quiet, checkpointer)
        case ["train", "ppo"]:
            return train_source(
                TrainJob("GapBall", 0, frames, FLAT, method="ppo"), registry, quiet, checkpointer
            )
        case ["train", maze]:  # 8 lanes, 8 actions a round, 20 steps an action
            low_level, method = ("learner", "td3") if maze == "td3" else ("low_level", "hdm")
            changes = {"num_envs": 8, low_level: {"warm_up": 100}}
            frames = rounds * 8 * 8 * 20
            return train_source(
                TrainJob("CoffeeMaze", 0, frames, changes, method=method), registry, quiet, checkpointer
            )
        case [method, *mode]:
            teacher = teacher_of(method, load(TARGET))
            reused = {None: (), "hdm": ("policy-1", "policy-2"), "ppo": ("policy-3", "policy-4")}[teacher]
            changes = (FLAT if teacher == "ppo" else SMALL) | FEWER.get(method, {})
            asked = job(reused, *(mode or ["default"]), method=method, frames=frames, changes=changes)
            return run_transfer(asked, registry, quiet, checkpointer)
    raise ValueError(kind)


def ended(registry: Registry, run: str) -> dict[str, Any]:
    """All that a run leaves, but for the time it took and its own ids."""
    record = registry.run(run)
    policy = dataclasses.asdict(registry.policy(str(record.policy)))
    told = dataclasses.asdict(record)
    files = {}
    for path in sorted((registry.folder / "runs" / run).glob("*.json*")):
        rows = [json.loads(line) for line in path.read_text().splitlines()]
        files[path.name] = [{k: v for k, v in row.items() if k not in TIME} for row in rows]
    return {
        "run": {k: v for k, v in told.items() if k not in TIME | {"id", "policy"}},
        "files": files,
        "policy": {k: policy[k] for k in policy.keys() - TIME - {"id", "run"}},
    }


def digest(run: dict[str, Any]) -> dict[str, Any]:
    """Of what a run left, that which no change of the code may change unless learning itself is changed."""
    rows = run["files"]["episodes.jsonl"]
    episodes = json.dumps([[row[name] for name in ("started", "frames", "score")] for row in rows])
    return {
        "episodes": [len(rows), hashlib.sha256(episodes.encode()).hexdigest()],
        "checkpoint": run["policy"]["checkpoint"],
        "program": hashlib.sha256(run["policy"]["program"].encode()).hexdigest(),
        "results": run["run"]["results"],
    }


def machine() -> list[str]:
    """What the last bit of a run depends on besides the code."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    models = {line.partition(":")[2].strip() for line in lines if line.startswith("model name")}
    return [torch.__version__, torch.backends.cpu.get_cpu_capability(), *sorted(models)]
