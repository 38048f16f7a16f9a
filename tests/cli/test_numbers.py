"""`--set` on the command line, sources that it chooses, and what `show` tells of numbers and of runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli.app import COMMANDS
from paddlectl.experiments.jobs import Job, TrainJob, TransferJob
from paddlectl.experiments.runner import rules_of, settings_of
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, SCENARIO, TARGET, Command, add_source, program


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The jobs that would have been run."""
    found: list[Any] = []

    def run_jobs(jobs: Sequence[Job], *_: object, **__: object) -> list[dict[str, Any]]:
        found.extend(jobs)
        return [{"run": "run-1", "policy": "policy-1", "crispness": None} for _ in jobs]

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    return found


def test_train_learns_by_what_is_set(command: Command, asked: list[Any]) -> None:
    numbers = ("--set", "low_level.learning_rate=1e-3", "--set", "low_level.hidden=[64, 64]")
    assert command("train", "BoxDoor", "GapBall", "--seeds", "0-1", *numbers).code == 0
    changes = {"low_level": {"learning_rate": 1e-3, "hidden": [64, 64]}}
    assert asked == [
        TrainJob(task, seed, changes=changes) for seed in (0, 1) for task in ("BoxDoor", "GapBall")
    ]
    assert settings_of(asked[0]).low_level.hidden == (64, 64)


def test_over_a_preset_too(command: Command, asked: list[Any]) -> None:
    line = ("train", "MailMaze", "--preset", "paper", "--set")
    assert command(*line, "low_level.batch=64").code == 0
    assert settings_of(asked[0]).low_level.batch == 64 and settings_of(asked[0]).action_repeat == 1
    assert command(*line, "low_level.batch=0").code == 2 and len(asked) == 1


def test_transfer_learns_by_what_is_set_over_the_file(
    registry: Registry, command: Command, asked: list[Any], tmp_path: Path
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(f"{SCENARIO}settings: {{num_envs: 8, rollout_steps: 16}}\nrules: {{source_memory: 3}}\n")
    assert command("transfer", file, "--seed", "0").code == 0
    assert (
        command("transfer", file, "--seed", "0", "--set", "num_envs=4", "--set", "rules.target_floor=0").code
        == 0
    )
    for job, envs, floor in zip(asked, (8, 4), (0.05, 0.0), strict=True):
        assert (settings_of(job).num_envs, settings_of(job).rollout_steps) == (envs, 16)
        assert (rules_of(job).source_memory, rules_of(job).target_floor) == (3, floor)


def test_sources_that_are_missing_are_learned_by_the_usual_numbers(
    command: Command, asked: list[Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, registry: Registry
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(SCENARIO.replace("[BlockedDoor, GapBall]", "[OpenGoal]"))
    command("transfer", file, "--seed", "0", "--train-missing", "--set", "num_envs=4")
    assert asked == [TrainJob("OpenGoal", 0)]


WRONG = [
    (
        "train BoxDoor --set num_envs=0",
        "hdm on BoxDoor: --set num_envs: num_envs is from 1 to 4096, usually 64",
        "",
    ),
    ("train BoxDoor --set clip=1", "no setting clip", "did you mean low_level.clip?"),
    ("train BoxDoor --set rules.source_memory=1", "only a transfer has rules: a source reuses nothing", ""),
    ("train BoxDoor --set low_level.clip", "--set low_level.clip: not NAME=VALUE", "write low_level."),
    (
        "train BoxDoor GapBall MailMaze --set low_level.clip=1",
        "hdm on MailMaze: --set low_level.clip: no",
        "",
    ),
    ("train BoxDoor --method ppo --set learner.clip=0", "learner.clip: clip is above 0, usually 0.2", ""),
    (
        "transfer FILE --set rules.episodes=x",
        "episodes is one of bandit, guided, alone, usually 'bandit'",
        "",
    ),
    ("transfer FILE --set frames=9", "frames is of sources alone; a transfer's are beside its settings", ""),
    (
        "transfer FILE --method cup --set rules.source_memory=9",
        "cup on BlockedBoxUnlockPickup: --set rules.source_memory: ",
        "",
    ),
    ("transfer FILE --method componet --set learner.modules=9", "modules is 2, by the scenario", ""),
    (
        "transfer OWN --method cup",
        "A sets settings.low_level for paddle: cup: no setting low_level",
        "leave out --",
    ),
]


@pytest.mark.parametrize(("line", "told", "hint"), WRONG, ids=[line for line, _, _ in WRONG])
def test_what_cant_be_set_is_told_before_anything_is_learned(
    registry: Registry, command: Command, asked: list[Any], tmp_path: Path, line: str, told: str, hint: str
) -> None:
    files = {"FILE": SCENARIO, "OWN": f"{SCENARIO}settings: {{low_level: {{clip: 0.1}}}}\n"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    answer = command(*(tmp_path / word if word in files else word for word in line.split()))
    assert (answer.code, answer.out, asked) == (2, "", [])
    lines = answer.err.splitlines()
    assert told.partition("; ")[0] in lines[0] and len(lines) <= 2
    assert not hint or hint in lines[1]


def test_only_what_learns_takes_numbers(command: Command) -> None:
    for name in COMMANDS:
        assert ("--set" in command(name, "--help").out) == (name in ("train", "transfer")), name
    assert "not for its sources" in " ".join(command("transfer", "--help").out.replace("│", "").split())


def test_chosen_sources_are_told_and_are_those_of_similarity(
    registry: Registry, command: Command, asked: list[Any], tmp_path: Path
) -> None:
    add_source(registry, "BoxDoor", program("BoxDoor", [(t, h, p) for t, h, p in BLOCKED_DOOR if t in "EK"]))
    file = tmp_path / "x.yaml"
    file.write_text(SCENARIO.replace("[BlockedDoor, GapBall]", "{auto: 2}"))
    answer = command("transfer", file, "--seeds", "0-1", "--json")
    similar = command("similarity", "--target", TARGET, "--json").json["overall"]
    assert [each["similarity"] for each in similar] == sorted(
        (e["similarity"] for e in similar), reverse=True
    )
    assert answer.json["chosen"] == [{"seed": seed, **each} for seed in (0, 1) for each in similar[:2]]
    told = ", ".join(f"{e['policy']} ({e['task']}, ψ {e['similarity']:.3f})" for e in similar[:2])
    assert answer.err.splitlines()[0] == f"sources: {told}"
    ids = tuple(each["policy"] for each in similar[:2])
    assert [job.sources for job in asked if isinstance(job, TransferJob)] == [ids, ids]
    assert f"{similar[0]['similarity']:.3f}" in command("similarity", "--target", TARGET).out.split()


def test_too_few_to_choose_from_are_told_and_none_is_learned(
    registry: Registry, command: Command, asked: list[Any], tmp_path: Path
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(SCENARIO.replace("[BlockedDoor, GapBall]", "{auto: 3}"))
    answer = command("transfer", file, "--train-missing")
    assert (answer.code, answer.out, asked) == (4, "", [])
    assert answer.err.splitlines() == [
        "error: auto: 3 policies by hdm are to be chosen of 2",
        "run: paddlectl train DoorBall",
    ]
    nowhere = command("transfer", file, "--train-missing", "--registry", tmp_path / "none")
    assert nowhere.code == 4 and not (tmp_path / "none").exists()
    assert "run: paddlectl train BlockedDoor GapBall DoorBall" in nowhere.err


SETTINGS = {
    "frames": 5000,
    "learning": {"num_envs": 64, "low_level": {"clip": 0.1, "hidden": [64]}},
    "rules": {"target_floor": 0.0},
    "unusual": {"low_level.clip": 0.2, "rules.target_floor": 0.05},
}
DIFFERS = [
    {"name": "low_level.clip", "value": 0.1, "usual": 0.2},
    {"name": "rules.target_floor", "value": 0.0, "usual": 0.05},
]


def add(registry: Registry, **settings: Any) -> str:
    return registry.add_run(
        kind="transfer", method="paddle", task=TARGET, scenario="A", sources=("policy-1", "policy-2"), seed=3,
        settings=settings, versions={},
    ).id  # fmt: skip


def test_a_run_is_shown_with_what_is_unusual_in_it(registry: Registry, command: Command) -> None:
    run = add(registry, **SETTINGS)
    found = command("show", run, "--json").json
    assert (found["run"], found["status"], found["budget"]) == (run, "running", 5000)
    assert (found["settings"], found["rules"]) == (SETTINGS["learning"], SETTINGS["rules"])
    assert found["unusual"] == DIFFERS
    told = command("show", run).out
    assert told.startswith(f"{run}: paddle on {TARGET}, seed 3, running\n0 of 5,000 frames")
    assert "sources: BlockedDoor (policy-1), GapBall (policy-2)" in told
    assert "low_level.clip      0.1   0.2" in told
    assert "Its numbers are the usual ones of paddle." in command("show", add(registry, unusual={})).out
    for older in ("run-1", add(registry), add(registry, unusual=3, learning=[1], rules="x")):
        answer = command("show", older)
        assert answer.code == 0 and "usual" not in answer.out
        assert command("show", older, "--json").json["unusual"] is None
    assert command("show", "run-77").code == 4


def test_a_policy_is_shown_with_the_numbers_of_its_run(registry: Registry, command: Command) -> None:
    assert command("show", "GapBall", "--json").json["unusual"] is None
    run, old = add(registry, **SETTINGS), registry.policy("policy-3")
    shared = {name: getattr(old, name) for name in ("task", "domain", "method", "seed", "frames", "program")}
    figures = {
        name: getattr(old, name) for name in ("success_rate", "mean_score", "mean_length", "crispness")
    }
    policy = registry.add_policy(
        run=run, checkpoint=registry.read_checkpoint(old), metadata={}, **shared, **figures
    ).id
    assert command("show", policy, "--json").json["unusual"] == DIFFERS
    assert "Numbers that differ from the usual ones of hdm" in command("show", policy).out
