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

from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.pace import Pace
from paddlectl.experiments.runner import random_source, run_transfer, train_source
from paddlectl.experiments.stop import Stop
from paddlectl.registry.store import Registry
from small_transfer import SHORT, SMALL, job

KINDS = ("train", "train maze", "paddle default", "paddle paper", "hdm")
FRAMES, ROUNDS = 3072, 12
IN_MAZE = {"lanes": 8, "low_level": {"warm_up": 100}}
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


def add_sources(registry: Registry) -> None:
    """policy-1 and policy-2, untrained: what they teach doesn't matter here."""
    for task in ("BlockedDoor", "GapBall"):
        random_source(task, 0, registry)


def begin(kind: str, registry: Registry, pace: Pace, rounds: int = ROUNDS) -> dict[str, Any]:
    frames = rounds * FRAMES // ROUNDS
    if kind == "train":
        return train_source(TrainJob("GapBall", 0, frames, SMALL), registry, quiet, pace)
    if kind == "train maze":  # 8 lanes, 8 actions a round, 20 steps an action
        return train_source(TrainJob("CoffeeMaze", 0, rounds * 8 * 8 * 20, IN_MAZE), registry, quiet, pace)
    method, _, mode = kind.partition(" ")
    policies = ("policy-1", "policy-2")
    return run_transfer(job(policies, mode or "default", method, frames=frames), registry, quiet, pace)


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
