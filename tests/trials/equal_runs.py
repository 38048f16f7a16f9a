"""Equal runs end equal: stopped every k rounds (R16), repeated, and side by side with others (R15)."""

import random
from contextlib import suppress
from pathlib import Path
from typing import Any

from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import Job, TrainJob
from paddlectl.experiments.processes import rows_of, run_jobs
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import run_transfer, train_source
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from small_transfer import SMALL, job
from trials.runs import KINDS, StopAfter, add_sources, begin, ended, quiet, small

EVERY, LONG = (1, 7, 50), 52  # rounds


def stopped_every(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many runs that are stopped every k rounds, of every kind for k = 1, 7 and 50, then for any k."""
    place = folder / "registry"
    others = [(kind, k) for kind in KINDS for k in range(1, max(EVERY) + 1) if k not in EVERY]
    pairs = [(kind, k) for k in EVERY for kind in KINDS] + random.Random(seed).sample(others, len(others))
    stops = 0
    with small():
        registry = Registry.open(place)
        add_sources(registry)
        whole = {
            kind: ended(registry, begin(kind, registry, Checkpointer(), rounds=LONG)["run"]) for kind in KINDS
        }
        for kind, k in pairs[:count]:
            with suppress(KeyboardInterrupt):
                begin(kind, registry, Checkpointer(stop=StopAfter(k)), rounds=LONG)
            run = registry.runs()[0]
            while run.status != "finished":
                stops += 1
                with suppress(KeyboardInterrupt):
                    resume(run.id, registry, quiet, Checkpointer(stop=StopAfter(k)))
                run = registry.run(run.id)
            assert run.resumes == LONG // k
            assert ended(registry, run.id) == whole[kind], (
                f"{kind} ended differently, stopped every {k} rounds"
            )
        assert not check(place, read_data=True).findings
    return {"runs": len(pairs[:count]), "stops": stops, "kinds": len(KINDS), "different": 0}


def repeated_runs(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Every kind of run so many times one after another, and as often in sweeps of two processes.

    All runs of one seed end as its first did; with the next seed they end otherwise.
    """
    place = folder / "registry"
    registry = Registry.open(place)
    add_sources(registry)
    first = [ended(registry, _done(job, registry)) for job in _jobs(seed)]
    for _ in range(count - 1):
        assert [ended(registry, _done(job, registry)) for job in _jobs(seed)] == first
    for _ in range(count):
        rows = rows_of(run_jobs(_jobs(seed), str(place), lambda *_: None, workers=2))
        assert [ended(registry, row["run"]) for row in rows] == first
    rows = rows_of(run_jobs(_jobs(seed + 1), str(place), lambda *_: None, workers=2))
    for row, found in zip(rows, first, strict=True):
        assert registry.policy(row["policy"]).checkpoint != found["policy"]["checkpoint"]
    return {"serial": count, "sweeps": count, "kinds": len(first), "different": 0}


def _jobs(seed: int) -> list[Job]:
    """Of every kind, with lanes so few that each is over in seconds."""
    in_maze = {"num_envs": 8, "low_level": {"warm_up": 100}}
    sources = TrainJob("GapBall", seed, 3072, SMALL), TrainJob("CoffeeMaze", seed, 6400, in_maze)
    ways = (("default", "paddle"), ("paper", "paddle"), ("default", "hdm"))
    return [*sources, *(job(("policy-1", "policy-2"), *way, seed, 3072) for way in ways)]


def _done(job: Job, registry: Registry) -> str:
    learn: Any = train_source if isinstance(job, TrainJob) else run_transfer
    return str(learn(job, registry, quiet)["run"])
