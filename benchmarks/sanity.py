"""Whether every method does what it is for: it learns, and what reuses is better with a source than without.

The checks, with three seeds each; a method that fails its own is a bug, not a result:

    ppo       learns BoxDoor
    td3       learns MailMaze
    hdqn      learns BoxDoor
    finetune  learns BlockedBoxUnlockPickup from DoorBall
    cup, ptf, qmp, componet
              learn BoxDoor from a policy of BoxDoor by `ppo`, of the same seed; beside each, its base
              learner with as many frames: `ppo`, and for `qmp` the same DQN without a source

Runs go through `experiments.processes.run_jobs`, as those of `paddlectl train` and `transfer` do; each part
is merged into the JSON result, and `python benchmarks/tables.py` puts it into docs/methods.md:

    python benchmarks/sanity.py
    python benchmarks/sanity.py --methods ppo cup --seeds 10 11 12
"""

import argparse
import json
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from learning import BARS, commit, episodes_of, machine, run
from learning import _reached as reached

from paddlectl.errors import NotFoundError
from paddlectl.experiments.curves import LearningCurve, in_order
from paddlectl.experiments.jobs import Job, TrainJob, TransferJob
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario

HERE = Path(__file__).parent
SEEDS = (10, 11, 12)
Result = dict[str, Any]


class Check(NamedTuple):
    """What a method has to learn, and from what.

    Attributes:
        task: To learn.
        frames: The budget.
        source: Task of the source; none is used if it is empty.
        teacher: Method of the source.
        base: Method that learns the same without the source, to compare with.
    """

    task: str
    frames: int
    source: str = ""
    teacher: str = ""
    base: str = ""


_AGAIN = Check("BoxDoor", 60_000, "BoxDoor", "ppo", "ppo")
CHECKS: dict[str, Check] = {
    "ppo": Check("BoxDoor", 150_000),
    "td3": Check("MailMaze", 1_000_000),
    "hdqn": Check("BoxDoor", 100_000),
    "finetune": Check("BlockedBoxUnlockPickup", 100_000, "DoorBall", "hdm"),
    "cup": _AGAIN,
    "ptf": _AGAIN,
    "qmp": Check("BoxDoor", 100_000, "BoxDoor", "ppo", "qmp"),
    "componet": _AGAIN,
}


def sources_of(options: argparse.Namespace) -> Iterator[Job]:
    """Those that the chosen checks need, each once for each seed; a `ppo` of BoxDoor is a check itself."""
    checks = [CHECKS[name] for name in options.methods]
    needed = {(check.source, check.teacher) for check in checks if check.source}
    for task, method in sorted(needed):
        for seed in options.seeds:
            frames = CHECKS["ppo"].frames if method == "ppo" else None
            yield TrainJob(task, seed, frames, method=method)


def jobs_of(options: argparse.Namespace, registry: Registry) -> Iterator[Job]:
    """The checks and their base learners."""
    asked = set()
    for name in options.methods:
        check = CHECKS[name]
        for seed in options.seeds:
            if not check.source:
                asked.add((name, check, False, seed))
                continue
            asked.add((name, check, True, seed))
            if check.base:
                asked.add((check.base, check, False, seed))
    for name, check, reuses, seed in sorted(asked, key=lambda each: (each[3], each[0], each[2])):
        sources = (source_of(registry, check, seed),) if reuses else ()
        if check.source:
            yield TransferJob(scenario_of(check), sources, name, seed, check.frames)
        else:
            yield TrainJob(check.task, seed, check.frames, method=name)


def scenario_of(check: Check) -> Scenario:
    """The check as a scenario; a target that is its own source is none that a file could ask for."""
    return Scenario.model_construct(
        name=f"check {check.frames}", target=check.task, sources=(check.source,), frames=check.frames
    )


def source_of(registry: Registry, check: Check, seed: int) -> str:
    """The newest policy of the source that was learned with this seed.

    Raises:
        NotFoundError: If there is none.
    """
    for policy in registry.policies():
        if (policy.task, policy.method, policy.seed) == (check.source, check.teacher, seed):
            return policy.id
    raise NotFoundError(f"no policy of {check.source} by {check.teacher} with seed {seed}")


def figures(registry: Registry, record: RunRecord) -> Result:
    """All figures of a finished run, from the registry alone."""
    episodes = episodes_of(registry, record)
    policy = registry.policy(record.policy or "")
    known = in_order(episodes)
    progress = registry.files.read_rows(record.id, "progress")
    return {
        "method": record.method,
        "task": record.task,
        "sources": [registry.policy(source).task for source in record.sources],
        "seed": record.seed,
        "budget": record.settings["frames"],
        "frames": record.frames,
        "seconds": record.seconds,
        **LearningCurve(episodes, record.frames).figures(),
        "to_success": {str(bar): reached(known, progress, bar) for bar in BARS},
        "unseen": policy.success_rate,
        "mean_length": policy.mean_length,
        "versions": record.versions,
        "machine": machine(),
    }


def key_of(run: Result) -> str:
    """`cup BoxDoor from BoxDoor seed 10`."""
    source = f" from {', '.join(run['sources'])}" if run["sources"] else ""
    return f"{run['method']} {run['task']}{source} {run['budget']:,} seed {run['seed']}"


def _missing(registry: Registry, jobs: Iterable[Job]) -> list[Job]:
    """Those whose policy isn't there yet: what a part before has trained is used again."""
    trained = {(p.task, p.method, p.seed) for p in registry.policies()}
    return [
        job for job in jobs if not (isinstance(job, TrainJob) and (job.task, job.method, job.seed) in trained)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", nargs="+", choices=tuple(CHECKS), default=tuple(CHECKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--workers", type=int, default=2, help="processes at a time")
    parser.add_argument("--registry", default="build/sanity", help="where policies and runs are kept")
    parser.add_argument("--output", type=Path, default=HERE / "sanity.json", help="the result file")
    options = parser.parse_args()
    registry, code = Registry.open(options.registry), commit()
    known = {record.id for record in registry.runs()}
    try:
        run(_missing(registry, sources_of(options)), options.registry, options.workers)
        run(_missing(registry, jobs_of(options, registry)), options.registry, options.workers)
    finally:
        results: Result = json.loads(options.output.read_text()) if options.output.exists() else {"runs": {}}
        for record in registry.runs()[::-1]:
            if record.id not in known and record.status == "finished":
                found = figures(registry, record) | {"commit": code}
                results["runs"][key_of(found)] = found
        results["runs"] = dict(sorted(results["runs"].items()))
        results["written"] = datetime.now(UTC).isoformat(timespec="seconds")
        options.output.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
