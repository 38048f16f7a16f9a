"""The maze: sources, transfer and scratch over seeds, and each deviation from Table 1 switched off by itself.

Runs go one after the other through `experiments.processes.run_jobs`, which `paddlectl train` and `transfer`
call; each is merged into the JSON result as soon as it is done, with the CPU time of its process beside its
wall time. A transfer takes the best policy of each source, as `paddlectl transfer` does.

    python benchmarks/maze.py --parts sources --seeds 0 1 2 3 4 5
    python benchmarks/maze.py --parts paddle hdm
    python benchmarks/maze.py --parts ablations --seeds 0

Success and length are on 200 starts that no training used.
"""

import argparse
import json
import resource
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from learning import best_sources, commit, machine, run, scenario_of

from paddlectl.experiments.jobs import Job, TrainJob, TransferJob
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

HERE = Path(__file__).parent
PARTS = ("sources", "paddle", "hdm", "ablations")
SOURCES = ("CoffeeMaze", "MailMaze")
SCENARIO = "maze"
FIRST = 50
Result = dict[str, Any]

# A deviation from Table 1 -> what takes it back (or the nearest that still lets values stay finite).
ABLATIONS: Mapping[str, Mapping[str, Any]] = {
    "learning_rate": {"learning_rate": 2e-4, "final_rate": 1.0},
    "final_rate": {"final_rate": 1.0},
    "optimiser": {"optimiser": "rmsprop"},
    "discount": {"discount": 0.99},
    "hidden": {"hidden": (400, 400, 400)},
    "normalised": {"normalised": False},
    "tracking": {"tracking": 0.005},
    "update_every": {"update_every": 2},
    "random_actions": {"random_actions": 0.0},
    "errands": {"errands": 0.0},
    "grid": {"grid": ()},
    "hindsight": {"hindsight": 0.0, "other_goals": 0.0},
    "lower_bound": {"lower_bound": False},
    "saturation_cost": {"saturation_cost": 0.0},
}


def jobs_of(options: argparse.Namespace, registry: Registry) -> Iterator[tuple[str, Job]]:
    """What is to be run, with the name of its result, one seed after the other."""
    scenario = scenario_of(SCENARIO)
    frames = options.frames or scenario.frames
    for seed in options.seeds:
        if "sources" in options.parts:
            for task in options.tasks:
                yield f"source {task} seed {seed}", TrainJob(task, seed, options.frames)
        if "paddle" in options.parts:
            sources = best_sources(registry, scenario)
            yield (
                f"paddle {scenario.target} seed {seed}",
                TransferJob(scenario, sources, "paddle", seed, frames),
            )
        if "hdm" in options.parts:
            yield f"hdm {scenario.target} seed {seed}", TransferJob(scenario, (), "hdm", seed, frames)
        for name in options.ablations if "ablations" in options.parts else ():
            changes = {"low_level": ABLATIONS[name]}
            job = TrainJob(options.task, seed, options.frames, changes)
            yield f"without {name} {options.task} seed {seed}", job


def figures(registry: Registry, record: RunRecord) -> Result:
    """All figures of a finished run, from the registry alone."""
    policy = registry.policy(record.policy or "")
    rows = sorted(registry.read_rows(record.id, "episodes"), key=lambda row: row["order"])
    whole = [row for place, row in enumerate(rows) if row["order"] == place]
    last = registry.read_rows(record.id, "episodes")[-100:]
    return {
        "task": record.task,
        "method": record.method,
        "seed": record.seed,
        "sources": record.sources,
        "frames": record.frames,
        "episodes": record.episodes,
        "seconds": record.seconds,
        "unseen_starts": {
            "success": policy.success_rate,
            "mean_score": policy.mean_score,
            "mean_length": policy.mean_length,
        },
        "crispness": policy.crispness,
        f"success_first_{FIRST}": _mean(whole[:FIRST], "success", FIRST),
        f"score_first_{FIRST}": _mean(whole[:FIRST], "score", FIRST),
        "success_last_100": _mean(last, "success", 100),
        "score_last_100": _mean(last, "score", 100),
    }


def _mean(rows: Sequence[Result], field: str, count: int) -> float | None:
    return float(np.mean([row[field] for row in rows])) if len(rows) == count else None


def merge(path: Path, key: str, result: Result) -> None:
    results: Result = json.loads(path.read_text()) if path.exists() else {"runs": {}}
    results["runs"][key] = result
    results["runs"] = dict(sorted(results["runs"].items()))
    results["written"] = datetime.now(UTC).isoformat(timespec="seconds")
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(results, indent=1) + "\n")
    partial.replace(path)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2, 3, 4, 5])
    parser.add_argument("--frames", type=int, help="of every run, instead of its usual budget")
    parser.add_argument("--tasks", nargs="+", choices=SOURCES, default=SOURCES, help="sources to train")
    parser.add_argument("--task", choices=SOURCES, default="MailMaze", help="of the ablations")
    parser.add_argument("--ablations", nargs="+", choices=tuple(ABLATIONS), default=tuple(ABLATIONS))
    parser.add_argument("--registry", default="build/maze", help="where policies and runs are kept")
    parser.add_argument("--output", type=Path, default=HERE / "maze.json", help="the result file")
    return parser.parse_args()


def main() -> None:
    options = parsed()
    ablations = [part for part in options.parts if part == "ablations"]
    others = [part for part in options.parts if part not in ablations]
    # Ablated sources aren't to be anyone's best.
    for location, parts in ((options.registry, others), (f"{options.registry}-ablations", ablations)):
        if parts:
            measure(argparse.Namespace(**{**vars(options), "registry": location, "parts": parts}))


def measure(options: argparse.Namespace) -> None:
    """Runs what was asked for, one after the other, and merges each into the result file."""
    code, registry = commit(), Registry.open(options.registry)
    for key, job in jobs_of(options, registry):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run([job], options.registry, 1)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        record = registry.runs()[0]
        result = figures(registry, record)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        result |= {"cpu_seconds": round(spent, 1), "commit": code, "versions": record.versions}
        merge(options.output, key, {**result, "machine": machine()})
        print(key, json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
