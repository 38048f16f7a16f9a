"""A policy without a program, and the methods that learn such, through every command."""

import shutil
import zipfile
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml
from sqlalchemy import update

import inline
from paddlectl.cli.completion import ended_names, policy_names, source_names
from paddlectl.experiments.jobs import TrainJob
from paddlectl.methods.catalogue import ALONE, METHODS
from paddlectl.registry.schema import policies
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, ROOT, TARGET, Command, add_source, program


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with what `train BoxDoor --method ppo` leaves."""
    place = tmp_path_factory.mktemp("learned") / "registry"
    (row,) = inline.run_jobs([TrainJob("BoxDoor", 0, 2048, method="ppo")], str(place), lambda *_: None)
    assert (row["policy"], row["method"], row["frames"], row["crispness"]) == ("policy-1", "ppo", 2048, None)
    return place


@pytest.fixture
def flat(learned: Path, tmp_path: Path) -> Registry:
    """A copy of it, where `command` works."""
    shutil.copytree(learned, tmp_path / "registry")
    return Registry.open(tmp_path / "registry")


def hybrid(registry: Registry, task: str = "BoxDoor") -> str:
    """Adds a policy of the task that has a program, and solves less than the other; gives its id."""
    add_source(registry, task, program("BlockedDoor", BLOCKED_DOOR))
    with registry.index.writing() as connection:
        connection.execute(update(policies).where(policies.c.id == 1).values(success_rate=1.0))
    return registry.policies()[0].id


def test_it_is_listed_with_dashes(flat: Registry, command: Command) -> None:
    (row,) = command("policies", "--json").json["policies"]
    assert (row["policy"], row["method"], row["crispness"]) == ("policy-1", "ppo", None)
    assert "–" in command("policies").out.splitlines()[3]
    (row,) = command("runs", "--json").json["runs"]
    assert (row["method"], row["policy"], row["results"]["crispness"]) == ("ppo", "policy-1", None)
    assert "ppo" in command("runs").out


def test_it_is_shown_to_have_no_program(flat: Registry, command: Command) -> None:
    found = command("show", "BoxDoor", "--json").json
    program = {name: found[name] for name in ("policy", "task", "clauses", "minimised")}
    assert program == {"policy": "policy-1", "task": "BoxDoor", "clauses": [], "minimised": []}
    assert (found["settings"]["learner"]["entropy_coef"], found["unusual"]) == (0.05, [])
    assert command("show", "policy-1").out == "policy-1 for BoxDoor has no clause program.\n"


def test_it_plays_on_every_task_of_its_domain(flat: Registry, command: Command) -> None:
    for task in ("BoxDoor", "GapBall"):
        line = ("evaluate", "policy-1", "--task", task, "--episodes", 2)
        row = command(*line, "--json").json
        assert (row["policy"], row["task"], row["episodes"]) == ("policy-1", task, 2)
        assert command(*line).out.split().count("policy-1") == 1
    assert command("evaluate", "policy-1", "--task", "CoffeeMaze").code == 5


def test_its_run_is_no_transfer(flat: Registry, command: Command) -> None:
    answer = command("explain", "run-1")
    assert (answer.code, answer.err.splitlines()[1]) == (4, "run: paddlectl evaluate policy-1")


def test_a_transfer_without_clauses_is_explained(flat: Registry, command: Command) -> None:
    run = flat.add_run(
        kind="transfer", method="ppo", task="BoxDoor", scenario="A", sources=(), seed=0, settings={},
        versions={},
    )  # fmt: skip
    old = flat.policy("policy-1")
    shared = {name: getattr(old, name) for name in ("task", "domain", "method", "seed", "frames", "program")}
    figures = {
        name: getattr(old, name) for name in ("success_rate", "mean_score", "mean_length", "crispness")
    }
    flat.add_policy(
        run=run.id, checkpoint=flat.read_checkpoint(old), metadata=old.metadata, **shared, **figures
    )
    flat.finish_run(run.id, status="finished", frames=1, episodes=0, seconds=1.0, results={})
    told = command("explain", "--full").out
    assert "policy-2 for BoxDoor has no clause program." in told
    assert "ppo learns from scratch: there were no guides" in told
    assert told.endswith("paddlectl evaluate policy-2\n")
    assert "No policy" not in told
    assert command("explain", "--json").json["program"]["clauses"] == []


def test_it_has_no_clauses_to_compare(flat: Registry, command: Command) -> None:
    for name in ("policy-1", "BoxDoor"):
        answer = command("similarity", "--target", "GapBall", "--source", name)
        assert (answer.code, answer.out) == (2, "")
        message, hint = answer.err.splitlines()
        assert message == "error: policy-1 was learned by ppo, which has no clauses to compare"
        assert hint == "name BoxDoor instead, and run: paddlectl train BoxDoor"
    answer = command("similarity", "--target", "CoffeeMaze", "--source", "policy-1")
    assert (answer.code, answer.err.splitlines()[1]) == (2, "run: paddlectl policies")
    assert "is of maze2d" in answer.err
    answer = command("similarity", "--target", "GapBall")
    assert (answer.code, answer.err.splitlines()[1]) == (4, "run: paddlectl train BlockedDoor")


def test_once_the_hint_was_followed_the_task_has_clauses(flat: Registry, command: Command) -> None:
    new = hybrid(flat)
    answer = command("similarity", "--target", "GapBall", "--source", "policy-1")
    assert answer.err.splitlines()[1] == f"name {new} instead"
    assert flat.policy("BoxDoor").id == "policy-1"
    for more in ((), ("--source", "BoxDoor")):
        assert command("similarity", "--target", "GapBall", "--json", *more).json["sources"] == [new]


def test_only_what_has_clauses_is_offered_to_compare(flat: Registry) -> None:
    assert [name for name, _ in policy_names(flat.location)] == ["BoxDoor", "policy-1"]
    assert [name for name, _ in ended_names(flat.location)] == ["BoxDoor", "policy-1", "run-1"]
    assert source_names(flat.location, "GapBall") == []
    new = hybrid(flat)
    assert [name for name, _ in source_names(flat.location, "GapBall")] == ["BoxDoor", new]


@pytest.mark.parametrize("name", ["BoxDoor", "run-1"])
def test_it_goes_through_a_bundle(
    flat: Registry, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    bundle = tmp_path / "x.zip"
    assert command("registry", "export", name, bundle, "--json").json["bytes"] == bundle.stat().st_size
    with zipfile.ZipFile(bundle) as archive:
        assert not {"program.txt", "program.pl"} & set(archive.namelist())
        card = archive.read("README.md").decode()
    front = yaml.safe_load(card.split("---")[1])
    assert front["tags"] == ["reinforcement-learning", "ppo", "BoxDoor"]
    assert "Prolog" not in card and "crispness" not in card and "`model.safetensors`" in card
    monkeypatch.setenv("PADDLECTL_REGISTRY", str(tmp_path / "there"))
    for known in (False, True):
        told = command("registry", "import", bundle, "--json").json
        assert told == {"run": "run-1", "policy": "policy-1", "known": known}
    there = Registry.open(tmp_path / "there")
    assert there.policy("policy-1") == flat.policy("policy-1")
    assert there.read_checkpoint(there.policy("BoxDoor")) == flat.read_checkpoint(flat.policy("BoxDoor"))
    again = tmp_path / "again.zip"
    assert command("registry", "export", name, again).code == 0
    assert again.read_bytes() == bundle.read_bytes()
    assert command("registry", "check", "--read-data").code == 0


def test_it_is_checked_mended_and_cleaned(flat: Registry, command: Command) -> None:
    before = flat.policy("policy-1")
    assert command("registry", "check", "--read-data", "--json").json["findings"] == []
    (flat.folder / "registry.db").unlink()
    assert command("registry", "check").code == 5
    assert command("registry", "repair").code == 0
    mended = Registry.open(flat.folder)
    assert mended.policy("policy-1") == before
    with mended.index.writing() as connection:
        connection.execute(update(policies).values(program="", crispness=0.5))
    assert "other row" in command("registry", "check").out
    assert command("registry", "repair").code == 0
    assert mended.policy("policy-1") == before
    assert command("registry", "gc").out == "0 files removed, 0 bytes\n"
    assert mended.read_checkpoint(before)


def test_what_is_lost_is_learned_again_by_its_own_method(flat: Registry, command: Command) -> None:
    hybrid(flat, "GapBall")
    for path in (flat.folder / "objects").iterdir():
        path.unlink()
    for task, by in (("BoxDoor", " --method ppo"), ("GapBall", "")):
        answer = command("evaluate", task)
        assert answer.code == 5
        assert answer.err.splitlines()[1] == f"train it again: paddlectl train {task}{by}"


def test_a_method_of_another_version_is_told(flat: Registry, command: Command) -> None:
    with flat.index.writing() as connection:
        connection.execute(update(policies).values(method="tomorrow"))
    answer = command("evaluate", "policy-1")
    assert answer.code == 5
    assert answer.err.splitlines() == [
        "error: policy-1 was learned by tomorrow, which this version doesn't have",
        "use the version of paddlectl that learned it, or install the plug-in",
    ]


# Methods at the command line

SOURCES = f"one of: {', '.join(ALONE)}"
EVERY = f"one of: {', '.join(METHODS)}"
A = f"transfer {ROOT}/scenarios/A.yaml"


def able(kind: str, offered: Iterable[str] = METHODS) -> str:
    return f"take another method: {', '.join(name for name in offered if kind in METHODS[name].actions)}"


@pytest.mark.parametrize(
    "line, message, hint",
    [
        ("train BoxDoor --method pppo", "unknown method pppo", f"did you mean ppo? or {SOURCES}"),
        ("train BoxDoor --method padle", "unknown method padle", SOURCES),
        ("train BoxDoor --method random", "unknown method random", SOURCES),
        ("train BoxDoor --method PPO", "unknown method PPO", f"did you mean ppo? or {SOURCES}"),
        ("train BoxDoor --method paddle", "paddle reuses sources, so it trains none", SOURCES),
        ("train BoxDoor --method finetune", "finetune reuses sources, so it trains none", SOURCES),
        (
            "train GapBall --method td3",
            "td3 chooses continuous actions; those of GapBall are discrete",
            able("discrete", ALONE),
        ),
        (
            "train CoffeeMaze --method ppo",
            "ppo chooses discrete actions; those of CoffeeMaze are continuous",
            able("continuous", ALONE),
        ),
        (f"{A} --method padle", "unknown method padle", f"did you mean paddle? or {EVERY}"),
        (
            f"{A} --method td3",
            f"td3 chooses continuous actions; those of {TARGET} are discrete",
            able("discrete"),
        ),
    ],
)
def test_a_method_that_cant_do_it_is_refused_with_those_that_can(
    command: Command, tmp_path: Path, line: str, message: str, hint: str
) -> None:
    answer = command(*line.split())
    told, way = answer.err.splitlines()
    assert (answer.code, answer.out, told) == (2, "", f"error: {message}")
    assert way == hint
    assert not (tmp_path / "registry").exists()


@pytest.mark.parametrize("line, names", [("train", ALONE), ("transfer", tuple(METHODS))])
def test_the_help_knows_every_method(
    command: Command, monkeypatch: pytest.MonkeyPatch, line: str, names: tuple[str, ...]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert f": {', '.join(names)}." in command(line, "--help").out
