"""The maze: sources, transfer and scratch over seeds, and each deviation from Table 1 taken back by itself.

Runs go one after the other through `experiments.processes.run_jobs`, which `paddlectl train` and `transfer`
call; each is merged into the JSON result as soon as it is done, with the CPU time of its process beside its
wall time. Success and length are on 200 starts that no training used. The parts:

    sources    both sources
    paddle     the target from the sources of its own seed
    hdm        the target from scratch, with as many frames as a transfer
    scratch    the target from scratch, with as many frames as a source
    ablations  what of the low level's settings deviates from Table 1, on a source
    guided     what deviates when a target is learned from guides, beside `paddle`

    python benchmarks/maze.py --parts sources
    python benchmarks/maze.py --parts paddle hdm
    python benchmarks/maze.py --parts ablations --seeds 10 11 12 --frames 1000000
"""

import argparse
import json
import resource
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from learning import SEEDS, commit, episodes_of, machine, run, scenario_of, sources_of

from paddlectl.experiments.curves import in_order
from paddlectl.experiments.jobs import Job, TrainJob, TransferJob
from paddlectl.hybrid.settings import DEVIATIONS
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

HERE = Path(__file__).parent
PARTS = ("sources", "paddle", "hdm", "scratch", "ablations", "guided")
SOURCES = ("CoffeeMaze", "MailMaze")
SCENARIO = "maze"
FIRST = 50
Result = dict[str, Any]

# What others need: without them there is no hindsight, and by themselves they change nothing.
NEEDED = ("goal_size", "radius", "goal_reward")
# A deviation from Table 1 -> what takes it back (or the nearest that still lets values stay finite).
ABLATIONS: Mapping[str, Mapping[str, Any]] = {
    "nothing": {},
    # The same time in an action's discount, in a rollout, and between updates.
    "action_repeat": {
        "action_repeat": 1,
        "rollout_steps": 160,
        "low_level": {
            "discount": 0.92 ** (1 / 20),
            "span": 1000,
            "goal_exploration_steps": 240.0,
            "update_every": 320,
        },
    },
    **{
        name: {"low_level": {name: paper}}
        for name, (paper, _) in DEVIATIONS.items()
        if name not in ("learning_rate", "hindsight", "other_goals", "cloning", *NEEDED)
    },
    "learning_rate": {"low_level": {"learning_rate": 2e-4, "final_rate": 1.0}},
    "hindsight": {"low_level": {"hindsight": 0.0, "other_goals": 0.0}},
}
# A setting of `methods.paddle.GUIDED`, or one that matters to an heir alone -> the usual one in its place.
GUIDED: Mapping[str, Mapping[str, Any]] = {
    "num_envs": {"num_envs": 8, "rollout_steps": 32},
    "action_repeat": {"action_repeat": 20},
    "reward_unit": {"decisions": {"reward_unit": 100.0}},
    "step_discount": {"clauses": {"step_discount": 0.999}},
    "imitation_margin": {"credit": {"imitation_margin": 0.0}},
    # Learning on by TD3, with its numbers for actions of 5 steps.
    "cloning": {
        "low_level": {
            "cloning": False,
            "learning_rate": 3e-4,
            "discount": 0.98,
            "span": 100,
            "goal_exploration_steps": 40.0,
        }
    },
}


def jobs_of(options: argparse.Namespace, registry: Registry) -> Iterator[tuple[str, Job]]:
    """What is to be run, with the name of its result, one seed after the other."""
    scenario = scenario_of(SCENARIO)
    target, frames = scenario.target, options.frames or scenario.frames
    for seed in options.seeds:
        transfer = partial(TransferJob, scenario, seed=seed, frames=frames)
        if "sources" in options.parts:
            for task in options.tasks:
                yield f"source {task} seed {seed}", TrainJob(task, seed, options.frames)
        if "paddle" in options.parts:
            job = transfer(sources=sources_of(registry, scenario, seed), method="paddle")
            yield f"paddle {target} seed {seed}", job
        if "hdm" in options.parts:
            yield f"hdm {target} seed {seed}", transfer(sources=(), method="hdm")
        if "scratch" in options.parts:
            yield f"scratch {target} seed {seed}", TrainJob(target, seed, options.frames)
        for name in options.ablations if "ablations" in options.parts else ():
            source = TrainJob(options.task, seed, options.frames, ABLATIONS[name])
            yield f"without {name} {options.task} seed {seed}", source
        for name in GUIDED if "guided" in options.parts else ():
            job = transfer(
                sources=sources_of(registry, scenario, seed), method="paddle", changes=GUIDED[name]
            )
            yield f"without {name} {target} seed {seed}", job


def figures(registry: Registry, record: RunRecord) -> Result:
    """All figures of a finished run, from the registry alone."""
    policy = registry.policy(record.policy or "")
    scores = [episode.score for episode in in_order(episodes_of(registry, record))]
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
        "program": (policy.program or "").splitlines(),
        f"success_first_{FIRST}": _mean([score > 0 for score in scores[:FIRST]], FIRST),
        f"score_first_{FIRST}": _mean(scores[:FIRST], FIRST),
        "success_last_100": _mean([score > 0 for score in scores[-100:]], 100),
        "score_last_100": _mean(scores[-100:], 100),
    }


def _mean(values: Sequence[float], count: int) -> float | None:
    return float(np.mean(values)) if len(values) == count else None


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
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
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
