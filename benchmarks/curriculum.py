"""A library that grows: twelve tasks in a row, each learned by reusing what was learned before.

python benchmarks/curriculum.py [--folder FOLDER] [--jobs 2] [--only auto] [--seeds 0 1 2]

A row is run by the command line, in a registry of its own, in one of four ways:

- `scratch`: each task by `hdm`;
- `all`: by `paddle`, with all that the registry holds as sources;
- `auto`: with the three that are most similar to the task (`sources: {auto: 3}`);
- `random`: with three by chance.

The first task of each row is learned by `hdm`. At the end each row's policies are evaluated again. Rows go on
where they were stopped; those that the result has already aren't run again. The result goes into
benchmarks/curriculum.json.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.studies.results import result_of

HERE = Path(__file__).parent
RESULT = HERE / "curriculum.json"
BUILT_IN = ("OpenGoal", "GapBall", "BoxDoor", "BlockedDoor", "DoorBall")
FROM_FILES = ("KeyGoal", "BoxGoal", "BlockedBall", "PlaceGoal", "PlaceBall")
LAST = ("BlockedBoxUnlockPickup", "BlockedBoxPlaceGoal")
ROW = (*BUILT_IN, *FROM_FILES, *LAST)
WAYS = ("scratch", "all", "auto", "random")
SOURCES = 3
FRAMES = 100_000
FIGURES = (
    "area_under_curve", "jump_start", "final_score", "frames_to_success", "unseen_success",
    "frames", "seconds",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=HERE.parent / "build" / "curriculum")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="+", default=WAYS, choices=WAYS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--tasks", type=int, default=len(ROW), help="the first so many")
    parser.add_argument("--result", type=Path, default=RESULT)
    options = parser.parse_args()
    tasks = ROW[: options.tasks]
    told: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for figures in json.loads(options.result.read_text("utf-8")) if options.result.exists() else ():
        told.setdefault((figures["way"], figures["seed"]), []).append(figures)
    rows = [(way, seed) for seed in options.seeds for way in options.only]
    rows = [row for row in rows if len(told.get(row, ())) < len(tasks)]

    def learned(row: tuple[str, int]) -> list[dict[str, Any]]:
        return Row(options.folder, *row, options.frames).learn(tasks)

    with ThreadPoolExecutor(options.jobs) as pool:
        for row, figures in zip(rows, pool.map(learned, rows), strict=True):
            told[row] = figures
            write(options.result, [each for row in sorted(told) for each in told[row]])


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    lines = ",\n".join(map(json.dumps, rows))
    path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


class Row:
    """One row of tasks with one seed, in its own registry."""

    def __init__(self, folder: Path, way: str, seed: int, frames: int) -> None:
        self.way, self.seed, self.frames = way, seed, frames
        self.folder = folder / f"{way}-{seed}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.location = self.folder / "registry"

    def learn(self, tasks: tuple[str, ...]) -> list[dict[str, Any]]:
        """Learns all that are missing; the figures of each."""
        if self._runs():
            self._paddlectl("resume", "--all")
        for place, task in enumerate(tasks):
            if place == len(self._runs()):
                self._learn(task, place)
        return [self._told(place, run) for place, run in enumerate(self._runs())]

    def _learn(self, task: str, place: int) -> None:
        numbers = ("--frames", str(self.frames), "--seed", str(self.seed))
        if place == 0 or self.way == "scratch":
            self._paddlectl("train", _typed(task), *numbers)
            return
        scenario = self.folder / f"{task}.yaml"
        told = {"name": task, "target": _typed(task), "sources": self._sources(place)}
        scenario.write_text(json.dumps(told), encoding="utf-8")  # JSON is YAML
        self._paddlectl("transfer", str(scenario), *numbers)

    def _sources(self, place: int) -> Any:
        held = [str(run.policy) for run in self._runs()]
        if self.way == "all" or place <= SOURCES:
            return held
        if self.way == "auto":
            return {"auto": SOURCES}
        chance = np.random.default_rng([self.seed, place])
        return [str(policy) for policy in chance.choice(held, SOURCES, replace=False)]

    def _told(self, place: int, run: RunRecord) -> dict[str, Any]:
        again = json.loads(self._paddlectl("evaluate", str(run.policy), "--json"))
        with Registry.open(self.location) as registry:
            result = result_of(registry, run)
            sources = [registry.policy(source).task for source in run.sources]
        told = {"way": self.way, "seed": self.seed, "place": place, "task": run.task, "sources": sources}
        told |= {name: getattr(result, name) for name in FIGURES}
        return told | {"success_at_the_end": again["success_rate"], "code": result.code}

    def _runs(self) -> list[RunRecord]:
        """Those that ended, in their order."""
        if not self.location.exists():
            return []
        with Registry.open(self.location) as registry:
            return [run for run in reversed(registry.runs()) if run.status == "finished"]

    def _paddlectl(self, *words: str) -> str:
        line = [sys.executable, "-m", "paddlectl", *words]
        own = os.environ | {"PADDLECTL_REGISTRY": str(self.location), "OMP_NUM_THREADS": "1"}
        with (self.folder / "log").open("a") as log:
            done = subprocess.run(line, env=own, stdout=subprocess.PIPE, stderr=log, text=True, check=True)
        return done.stdout


def _typed(task: str) -> str:
    return str(HERE / "curriculum" / f"{task}.yaml") if task in FROM_FILES else task


if __name__ == "__main__":
    main()
