"""Sources, scratch and transfer, learned as a user would learn them and measured; writes a JSON result.

Every run goes through `experiments.processes.run_jobs`, which `paddlectl train` and `transfer` call, two
processes at a time. The parts can be run one after the other; each is merged into the result file:

    python benchmarks/learning.py --parts sources
    python benchmarks/learning.py --parts paddle hdm --scenarios A B --seeds 10 11 12 --frames 200000
    python benchmarks/learning.py --parts random paper

Seeds are paired: the transfer of a seed reuses the sources of that seed, so that seeds are independent and no
source is picked by the layouts that are reported. No rule and no setting was chosen with the usual seeds,
10 to 15. The part `random` runs scenario A with a random policy of every other source task besides; the area
under the curve that it loses to the part `paddle` is told once both have run with that seed and as many
frames. The part `paper` runs `guidance: paper`, with its defaults and with the letter of the text, on
scenarios A and C with 60,000 frames.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from tables import tables

from paddlectl.errors import PaddlectlError
from paddlectl.experiments.curves import LearningCurve, in_order
from paddlectl.experiments.jobs import Event, Job, Progress, TrainJob, TransferJob
from paddlectl.experiments.sources import resolve
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Guidance, Scenario, TaskSources, load_scenario
from paddlectl.transfer.guidance import GuidanceSettings

HERE = Path(__file__).parent
SOURCES = ("BlockedDoor", "GapBall", "DoorBall", "OpenGoal", "BoxDoor")
SCENARIOS = ("A", "B", "C", "D", "A-place", "B-place", "C-place", "D-place")
PARTS = ("sources", "paddle", "hdm", "led", "random", "paper")
SEEDS = (10, 11, 12, 13, 14, 15)
BUDGETS = {"BlockedBoxUnlockPickup": 60_000, "BlockedBoxPlaceGoal": 100_000}  # of a target, in frames
WITH_RANDOM = "A"
RANDOM = "+random"
LED: dict[str, Literal["guided", "alone"]] = {", always guided": "guided", ", always alone": "alone"}
"""What is added to a scenario's name -> who leads every episode."""
PAPER_SCENARIOS = ("A", "C")
PAPER_FRAMES = 60_000
READINGS: dict[str, Guidance] = {
    ", paper": Guidance(mode="paper"),
    ", letter": Guidance(
        mode="paper",
        initial_performance=1.0,
        normalise="clip",
        failure_cost=0.0,
        values="per_guide",
        source_softness=0.0,
        imitation_margin=0.0,
        num_envs=64,
    ),
}
"""What is added to a scenario's name -> how Eqs. 2 and 3 are read."""

BARS = (0.9, 0.97)
FIRST = 200
Result = dict[str, Any]


def jobs_of(options: argparse.Namespace, registry: Registry) -> Iterator[Job]:
    """What is to be run; `hdm`, which uses no source, once for each target.

    Raises:
        NotFoundError: If a source that a transfer needs has no policy yet.
    """
    changes = {"low_level": {"epochs": options.epochs}} if options.epochs else {}
    if "sources" in options.parts:
        for seed in options.seeds:
            yield from (TrainJob(task, seed, options.frames, changes) for task in options.tasks)
    transfer = partial(TransferJob, changes=changes)
    scratch = set()
    for name in options.scenarios if set(options.parts) & {"paddle", "hdm", "led"} else ():
        scenario = scenario_of(name)
        frames = options.frames or BUDGETS.get(scenario.target, scenario.frames)
        for seed in options.seeds:
            if "paddle" in options.parts:
                yield transfer(scenario, sources_of(registry, scenario, seed), "paddle", seed, frames)
            for added, who in LED.items() if "led" in options.parts else ():
                other = scenario.model_copy(update={"name": scenario.name + added})
                rules = replace(GuidanceSettings(), episodes=who)
                sources = sources_of(registry, scenario, seed)
                yield transfer(other, sources, "paddle", seed, frames, rules)
            if "hdm" in options.parts and (scenario.target, seed) not in scratch:
                scratch.add((scenario.target, seed))
                yield transfer(scenario, (), "hdm", seed, frames)
    if "random" in options.parts:
        yield from (_with_random(registry, seed, options.frames, changes) for seed in options.seeds)
    for name, read in READINGS.items() if "paper" in options.parts else ():
        for plain in map(scenario_of, PAPER_SCENARIOS):
            scenario = plain.model_copy(update={"name": plain.name + name, "guidance": read})
            for seed in options.seeds:
                sources = sources_of(registry, scenario, seed)
                yield transfer(scenario, sources, "paddle", seed, options.frames or PAPER_FRAMES)


def scenario_of(name: str) -> Scenario:
    """The scenario of a file, but with paired seeds."""
    plain = load_scenario(HERE.parent / "scenarios" / f"{name}.yaml")
    sources = TaskSources(tasks=plain.source_names, seed="paired")
    return plain.model_copy(update={"sources": sources})


def sources_of(registry: Registry, scenario: Scenario, seed: int) -> tuple[str, ...]:
    """Ids of the policies that a transfer by `paddle` with this seed reuses.

    Raises:
        NotFoundError: If one is missing.
    """
    return resolve(registry, scenario, "paddle", [seed]).required()[seed]


def _with_random(registry: Registry, seed: int, frames: int | None, changes: Result) -> TransferJob:
    """Scenario A with new random policies of the other source tasks, no two of one seed, after its own."""
    from paddlectl.experiments.runner import random_source

    plain = scenario_of(WITH_RANDOM)
    sources = sources_of(registry, plain, seed)
    others = [task for task in SOURCES if task not in plain.source_names]
    seeds = {task: 1000 + seed * len(SOURCES) + SOURCES.index(task) for task in others}
    sources += tuple(random_source(task, seeds[task], registry).id for task in others)
    scenario = plain.model_copy(update={"name": plain.name + RANDOM, "sources": sources})
    return TransferJob(scenario, sources, "paddle", seed, frames or BUDGETS[plain.target], changes=changes)


def run(jobs: Sequence[Job], registry: str, workers: int) -> None:
    """Does the jobs; tells on stderr how far each one is, a line for every tenth of it."""
    from paddlectl.experiments.processes import rows_of, run_jobs

    told: dict[int, int] = {}

    def tell(index: int, event: Event) -> None:
        if isinstance(event, Progress) and told.get(index) != (tenth := 10 * event.frames // event.total):
            told[index] = tenth
            print(f"{_name(jobs[index])}: {_told(event)}", file=sys.stderr)

    rows_of(run_jobs(jobs, registry, tell, workers))


def _name(job: Job) -> str:
    what = job.task if isinstance(job, TrainJob) else f"{job.scenario.name} {job.method}"
    return f"{what} seed {job.seed}"


def _told(progress: Progress) -> str:
    if progress.latest_success is None:
        return f"{progress.frames:,} frames"
    rates = f"success {progress.latest_success:.2f}, score {progress.latest_score:.3f}"
    return f"{progress.frames:,} frames, {rates}"


def key_of(record: RunRecord) -> str:
    """`source BoxDoor seed 0`, `paddle A BlockedBoxUnlockPickup seed 0`, `hdm BlockedBoxUnlockPickup ...`."""
    if record.kind == "train":
        return f"source {record.task} seed {record.seed}"
    scenario = f" {record.scenario}" if record.sources else ""
    return f"{record.method}{scenario} {record.task} seed {record.seed}"


def figures(registry: Registry, record: RunRecord, shortest: float) -> Result:
    """All figures of a finished run, from the registry alone."""
    episodes = episodes_of(registry, record)
    progress = registry.files.read_rows(record.id, "progress")
    policy = registry.policy(record.policy or "")
    curve = LearningCurve(episodes, record.frames).figures()
    known = in_order(episodes)
    return {
        "kind": "source" if record.kind == "train" else "transfer",
        "task": record.task,
        "method": record.method,
        "scenario": record.scenario if record.sources else None,
        "guidance": record.settings["scenario"]["guidance"]["mode"] if record.method == "paddle" else None,
        "seed": record.seed,
        "frames": record.frames,
        "episodes": record.episodes,
        "seconds": record.seconds,
        "unseen_layouts": {
            "success": policy.success_rate,
            "mean_score": policy.mean_score,
            "mean_length": policy.mean_length,
            "shortest_mean_length": shortest,
            "length_ratio": policy.mean_length / shortest,
        },
        "crispness": policy.crispness,
        "jump_start": _mean_of_first(100, [e.score for e in known]),
        f"success_first_{FIRST}": _mean_of_first(FIRST, [e.score > 0 for e in known]),
        "final_score": curve["final_score"],
        "final_success": curve["final_success"],
        "area_under_curve": curve["area_under_curve"],
        "to_success": {str(bar): _reached(known, progress, bar) for bar in BARS},
        "led_by_target": _led_by_target(registry.files.read_rows(record.id, "weights")),
        "finished": record.finished,
    }


class Ended(NamedTuple):
    """An episode that ended, as a run's table has it."""

    order: int
    started: int
    finished: int
    score: float


def episodes_of(registry: Registry, record: RunRecord) -> list[Ended]:
    """In the order in which they ended."""
    rows = registry.files.read_rows(record.id, "episodes")
    return [Ended(row["order"], row["started"], row["frames"], row["score"]) for row in rows]


def _mean_of_first(count: int, values: Sequence[float]) -> float | None:
    """Over the first so many episodes started; None if they hadn't all ended."""
    return float(np.mean(values[:count])) if len(values) >= count else None


def _led_by_target(weights: Sequence[Result]) -> float | None:
    """Share of the decisions that the target led at the end: in the last tenth, or a little more."""
    late = [row for row in weights if row["phase"] == "late"]
    led = sum(row["chosen"] for row in late if row["policy"] == "target")
    everyone = sum(row["chosen"] for row in late)
    return led / everyone if everyone else None


def _reached(episodes: Sequence[Ended], progress: Sequence[Result], bar: float) -> Result | None:
    """When 100 episodes that started one after another had all ended, this share of them solved.

    Counted by their start: those that end early are the lucky ones.
    """
    frames = LearningCurve(episodes, 0).frames_to(bar)
    if frames is None:
        return None
    seconds = next((row["seconds"] for row in progress if row["frames"] >= frames), None)
    return {"frames": frames, "seconds": seconds}


def shortest_mean_length(task: str) -> Result:
    """Mean length of the shortest plans on the very layouts that policies are evaluated on."""
    from paddlectl.experiments.policies import EVALUATION_EPISODES, EVALUATION_SEED
    from paddlectl.tasks import suite
    from paddlectl.tasks.minigrid.layouts import SPECS, Layouts

    sys.path.append(str(HERE.parent / "tests"))
    from planner import shortest_plan

    state = suite.load(task).make(EVALUATION_EPISODES, EVALUATION_SEED, 1, "evaluation").state
    layouts = Layouts(state.agent, state.facing, state.where)
    lengths = [len(shortest_plan(SPECS[task], layouts, lane)) for lane in range(EVALUATION_EPISODES)]
    return {"layouts": len(lengths), "seed": EVALUATION_SEED, "mean_length": float(np.mean(lengths))}


def machine() -> Result:
    cpus = Path("/proc/cpuinfo")
    lines = cpus.read_text().splitlines() if cpus.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": models[0] if models else platform.processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
    }


def commit() -> str | None:
    """The commit of the code, with a `+` if files of the package were changed since."""
    try:
        said = [
            subprocess.run(["git", *words], cwd=HERE, capture_output=True, text=True, check=True).stdout
            for words in (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "../src"])
        ]
    except (OSError, subprocess.CalledProcessError):
        return None
    return said[0].strip() + ("+" if said[1] else "")


def merge(path: Path, registry: Registry, records: Sequence[RunRecord], code: str | None) -> Result:
    """Adds the runs to the result file, in place of earlier ones of the same name."""
    results: Result = json.loads(path.read_text()) if path.exists() else {"shortest": {}, "runs": {}}
    for record in records:
        if record.task not in results["shortest"]:
            results["shortest"][record.task] = shortest_mean_length(record.task)
        shortest = results["shortest"][record.task]["mean_length"]
        results["runs"][key_of(record)] = {
            **figures(registry, record, shortest),
            "commit": code,
            "versions": record.versions,
            "machine": machine(),
        }
    runs = results["runs"] = dict(sorted(results["runs"].items()))
    for key in runs:
        if RANDOM in key:
            runs[key]["area_lost"] = _area_lost(runs[key], runs.get(key.replace(RANDOM, "")))
    results["written"] = datetime.now(UTC).isoformat(timespec="seconds")
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(results, indent=1) + "\n")
    partial.replace(path)
    return results


def _area_lost(run: Result, plain: Result | None) -> float | None:
    """As a share; None if no run of as many frames is there to compare with, or it earned nothing."""
    if plain is None or plain["frames"] != run["frames"] or not plain["area_under_curve"]:
        return None
    return float(1.0 - run["area_under_curve"] / plain["area_under_curve"])


@contextmanager
def collected(
    options: argparse.Namespace,
    registry: Registry,
    ours: Callable[[RunRecord], bool],
    shown: Callable[[Result], str],
) -> Iterator[None]:
    """Merges our runs that the block finished, however it is left, into the result file; prints it."""
    code = commit()
    before = set() if options.collect else {record.id for record in registry.runs()}
    try:
        yield
    except PaddlectlError as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        # Oldest first, so that the newest of a name stays.
        ended = [r for r in registry.runs()[::-1] if r.status == "finished" and r.id not in before]
        print(shown(merge(options.output, registry, [r for r in ended if ours(r)], code)))


def _ours(record: RunRecord) -> bool:
    """No random source, and no run of another benchmark in the same registry."""
    known = {path.stem for path in (HERE.parent / "scenarios").glob("*.yaml")}
    scenario = (record.scenario or "").removesuffix(RANDOM)
    for name in READINGS:
        scenario = scenario.removesuffix(name)
    return record.method != "random" and (record.kind == "train" or scenario in known)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--parts", nargs="*", choices=PARTS, default=PARTS, help="none: only collect and print"
    )
    parser.add_argument("--tasks", nargs="+", choices=SOURCES, default=SOURCES, help="sources to train")
    parser.add_argument(
        "--scenarios", nargs="+", default=SCENARIOS, help="of paddle and hdm: names of files in scenarios/"
    )
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--frames", type=int, help="of every run, instead of its usual budget")
    parser.add_argument("--epochs", type=int, help="PPO's passes over each block, instead of its usual")
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--registry", default="build/bench", help="where policies and runs are kept")
    parser.add_argument("--output", type=Path, default=HERE / "learning.json", help="the result file")
    parser.add_argument("--collect", action="store_true", help="take in the registry's earlier runs too")
    return parser.parse_args()


def main() -> None:
    options = parsed()
    registry = Registry.open(options.registry)
    with collected(options, registry, _ours, tables):
        # Sources first: a transfer's job names their policies.
        for parts in (PARTS[:1], PARTS[1:]):  # the sources have to be there
            chosen = [part for part in parts if part in options.parts]
            jobs = list(jobs_of(argparse.Namespace(**{**vars(options), "parts": chosen}), registry))
            run(jobs, options.registry, options.workers)


if __name__ == "__main__":
    main()
