"""What a transfer costs as its sources grow in number: frames a second, CPU seconds and memory.

python benchmarks/many_sources.py [--frames 20000] [--counts 2 10 50 100]

Five source tasks are learned; each further source is a copy of one of them, as a policy of its own. Each
transfer is a process of its own; beside them `hdm`, which has no source. The result goes into
benchmarks/many_sources.json.
"""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from scale import measured
from start_up import command

from paddlectl.experiments.log import versions
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry

HERE = Path(__file__).parent
TASKS = ("BlockedDoor", "GapBall", "BoxDoor", "DoorBall", "OpenGoal")
TARGET = "BlockedBoxUnlockPickup"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--source-frames", type=int, default=60_000)
    parser.add_argument("--counts", type=int, nargs="+", default=[2, 10, 50, 100])
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        os.environ["PADDLECTL_REGISTRY"] = str(place / "registry")
        learn = command(f"train {' '.join(TASKS)} --frames {options.source_frames}")
        subprocess.run(learn, check=True, capture_output=True)
        with Registry.open(place / "registry") as registry:
            sources = copies(registry, max(options.counts))
        rows = [transfer(place, [], options.frames)]
        rows += [transfer(place, sources[:count], options.frames) for count in options.counts]
    told = {"frames": options.frames, "transfers": rows, "versions": versions()}
    (HERE / "many_sources.json").write_text(json.dumps(told, indent=1) + "\n")


def copies(registry: Registry, count: int) -> list[str]:
    """So many policies, of each task in turn: the ones learned, then copies of them."""
    learned = [registry.policy(task) for task in TASKS]
    ids = [policy.id for policy in learned]
    while len(ids) < count:
        ids.append(copied(registry, learned[len(ids) % len(TASKS)]))
    return ids


def copied(registry: Registry, policy: PolicyRecord) -> str:
    """The id of a policy that is like another, learned by a run like that one's."""
    run = registry.run(policy.run)
    names = ("kind", "method", "task", "scenario", "sources", "seed", "settings", "versions")
    again = registry.add_run(**{name: getattr(run, name) for name in names})
    names = ("task", "domain", "method", "seed", "frames", "program", "metadata")
    figures = ("success_rate", "mean_score", "mean_length", "crispness")
    values = {name: getattr(policy, name) for name in (*names, *figures)}
    kept = registry.add_policy(run=again.id, checkpoint=registry.read_checkpoint(policy), **values)
    ends = {name: getattr(run, name) for name in ("frames", "episodes", "seconds", "results")}
    registry.finish_run(again.id, status="finished", **ends)
    return kept.id


def transfer(folder: Path, sources: list[str], frames: int) -> dict[str, Any]:
    """What one costs, start and evaluation included."""
    scenario = folder / "many.yaml"
    told = {"name": "many", "target": TARGET, "sources": sources or ["BlockedDoor"]}
    scenario.write_text(json.dumps(told), encoding="utf-8")  # JSON is YAML
    by = "--method paddle" if sources else "--method hdm"
    cost = measured(command(f"transfer {scenario} --frames {frames} {by}"))
    with Registry.open(folder / "registry") as registry:
        (run,), _ = registry.newest_runs(1)
    row = {"sources": len(sources), **{name: round(value, 2) for name, value in cost.items()}}
    row |= {"frames_per_second": round(run.frames / run.seconds, 1), "area": run.results["area_under_curve"]}
    print(row)
    return row


if __name__ == "__main__":
    main()
