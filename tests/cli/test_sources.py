"""What `transfer` does for the sources of its scenario: looks them up, trains them, refuses them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from paddlectl.experiments.jobs import Job, TrainJob, TransferJob
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, SCENARIO, Answer, Command, add_source, program

PAIRED = "{tasks: [BlockedDoor, GapBall], seed: paired}"
PROGRAM = program("BlockedDoor", BLOCKED_DOOR)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """The jobs that would have been run. What trainings would have learned is made by hand."""
    found: list[Job] = []

    def run_jobs(jobs: Sequence[Job], registry: str, *_: object, **__: object) -> list[dict[str, Any]]:
        found.extend(jobs)
        rows = []
        with Registry.open(registry) as opened:
            for job in jobs:
                row: dict[str, Any] = {"run": "run-9", "policy": "policy-9", "crispness": 1.0}
                match job:
                    case TrainJob():
                        row["policy"] = add_source(
                            opened, job.task, PROGRAM, method=job.method, seed=job.seed
                        )
                    case TransferJob():
                        row |= {"seed": job.seed, "sources": list(job.sources)}
                rows.append(row)
        return rows

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    return found


@pytest.fixture
def transfer(command: Command, tmp_path: Path) -> Command:
    """Runs `transfer` with a file of these sources."""

    def run(sources: str, *options: object) -> Answer:
        file = tmp_path / "x.yaml"
        file.write_text(SCENARIO.replace("[BlockedDoor, GapBall]", sources))
        return command("transfer", file, *options)

    return run


def reused(jobs: Sequence[Job]) -> dict[int, tuple[str, ...]]:
    return {job.seed: job.sources for job in jobs if isinstance(job, TransferJob)}


def test_a_named_policy_stands_beside_a_task(registry: Registry, transfer: Command, asked: list[Job]) -> None:
    worse = add_source(registry, "GapBall", PROGRAM, success_rate=0.1)
    answer = transfer(f"[{worse}, BlockedDoor]", "--seeds", "0,5")
    assert answer.code == 0
    assert reused(asked) == {0: (worse, "policy-1"), 5: (worse, "policy-1")}
    plan = answer.err.splitlines()
    assert plan[0] == f"sources: {worse}, policy-1"
    assert plan[1].startswith("2 runs × 400,000 frames")


def test_each_paired_seed_has_sources_of_its_own_in_jobs_plan_and_json(
    registry: Registry, transfer: Command, asked: list[Job]
) -> None:
    ids = {0: ("policy-1", "policy-2")}
    for seed in (1, 2):
        ids[seed] = tuple(add_source(registry, t, PROGRAM, seed=seed) for t in ("BlockedDoor", "GapBall"))
    answer = transfer(PAIRED, "--json")
    assert answer.code == 0
    assert reused(asked) == ids
    assert answer.err.splitlines()[0] == (
        "sources: policy-1, policy-2 (seed 0); policy-4, policy-5 (seed 1); policy-6, policy-7 (seed 2)"
    )
    assert [row["sources"] for row in answer.json["runs"]] == [list(ids[seed]) for seed in (0, 1, 2)]


def test_the_plan_of_many_paired_seeds_is_short(
    registry: Registry, transfer: Command, asked: list[Job]
) -> None:
    for seed in range(1, 30):
        add_source(registry, "GapBall", PROGRAM, seed=seed)
    answer = transfer("{tasks: [GapBall], seed: paired}", "--seeds", "0-29")
    assert answer.err.splitlines()[0].endswith("policy-22 (seed 19); and 10 more")
    assert len(reused(asked)) == 30


@pytest.mark.parametrize(
    ("sources", "options", "told", "hint"),
    [
        (PAIRED, "", "BlockedDoor, GapBall with seeds 1-2", "BlockedDoor GapBall --seeds 1-2"),
        (PAIRED, "--seeds 7,0,9", "BlockedDoor, GapBall with seeds 7,9", "BlockedDoor GapBall --seeds 7,9"),
        (PAIRED, "--seed 7", "BlockedDoor, GapBall with seed 7", "BlockedDoor GapBall --seed 7"),
        ("{tasks: [OpenGoal]}", "", "OpenGoal", "OpenGoal"),
        ("[policy-1, OpenGoal, BoxDoor]", "--method finetune", "OpenGoal, BoxDoor", "OpenGoal BoxDoor"),
    ],
)
def test_what_is_missing_is_told_and_its_hint_mends_it(
    registry: Registry, transfer: Command, command: Command, asked: list[Job], sources: str, options: str,
    told: str, hint: str,
) -> None:  # fmt: skip
    answer = transfer(sources, *options.split())
    assert (answer.code, answer.out, asked) == (4, "", [])
    assert answer.err.splitlines() == [f"error: no policy for {told} by hdm", f"run: paddlectl train {hint}"]
    assert command("train", *hint.split()).code == 0
    assert transfer(sources, *options.split()).code == 0


def test_train_missing_learns_what_each_seed_lacks(
    registry: Registry, transfer: Command, asked: list[Job]
) -> None:
    add_source(registry, "GapBall", PROGRAM, seed=2)
    add_source(registry, "BlockedDoor", PROGRAM, method="random", seed=1)
    answer = transfer(PAIRED, "--train-missing")
    assert answer.code == 0
    trained = [job for job in asked if isinstance(job, TrainJob)]
    lacking = [("BlockedDoor", 1), ("GapBall", 1), ("BlockedDoor", 2)]
    assert trained == [TrainJob(task, seed) for task, seed in lacking]
    assert reused(asked) == {
        0: ("policy-1", "policy-2"),
        1: ("policy-6", "policy-7"),
        2: ("policy-8", "policy-4"),
    }


def test_an_empty_method_is_none(registry: Registry, transfer: Command, asked: list[Job]) -> None:
    answer = transfer(PAIRED, "--method", "")
    assert (answer.code, asked) == (2, []) and "unknown method" in answer.err


WRONG = [
    ("[policy-77, OpenGoal]", 4, "no policy policy-77", "run: paddlectl policies"),
    ("[policy-4, OpenGoal]", 2, "policy-4 was learned by hdqn; paddle reuses what hdm", "name policy-2"),
    ("[policy-5, OpenGoal]", 2, "policy-5 solves MailMaze of maze2d; ", "run: paddlectl policies"),
    ("[policy-1, BlockedDoor, OpenGoal]", 2, "policy-1 is the best policy for BlockedDoor", "name policy-1"),
]


@pytest.mark.parametrize(("sources", "code", "told", "hint"), WRONG, ids=[each[0] for each in WRONG])
def test_a_named_policy_that_cant_serve_is_refused_before_anything_is_trained(
    registry: Registry, transfer: Command, asked: list[Job], sources: str, code: int, told: str, hint: str
) -> None:
    add_source(registry, "GapBall", PROGRAM, method="hdqn")
    add_source(registry, "MailMaze", PROGRAM, domain="maze2d")
    answer = transfer(sources, "--train-missing")
    assert (answer.code, answer.out, asked) == (code, "", [])
    message, *hints = answer.err.splitlines()
    assert message.startswith(f"error: {told}")
    assert len(hints) == 1 and hint in hints[0]


def test_where_no_registry_is_the_hint_trains_the_scenarios_tasks(
    transfer: Command, asked: list[Job], tmp_path: Path
) -> None:
    for sources, options, hint in (
        (PAIRED, "", "run: paddlectl train BlockedDoor GapBall --seeds 0-2"),
        ("[GapBall]", "", "run: paddlectl train GapBall"),
        ("[policy-3, GapBall]", "--train-missing", "run: paddlectl train GapBall"),
        ("[policy-3]", "--train-missing", "run: paddlectl train BoxDoor"),
    ):
        answer = transfer(sources, *options.split())
        told = answer.err.splitlines()
        assert (answer.code, told) == (4, [f"error: no registry at {tmp_path / 'registry'}", hint])
    assert not (tmp_path / "registry").exists() and asked == []
    assert transfer(PAIRED, "--train-missing").code == 0
    assert set(reused(asked)) == {0, 1, 2}


def test_a_method_that_reuses_nothing_needs_no_sources(
    transfer: Command, asked: list[Job], tmp_path: Path
) -> None:
    for sources in (PAIRED, "[policy-77]"):
        answer = transfer(sources, "--method", "hdm", "--seed", "0")
        assert answer.code == 0 and "sources:" not in answer.err
    assert reused(asked) == {0: ()}
