"""What options and arguments take: whole numbers in any decimal form, and home folders."""

from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli.options import place
from paddlectl.cli.texts import here
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import Progress, TrainJob
from paddlectl.experiments.runner import train_source
from paddlectl.registry.store import Registry
from samples import SCENARIO, Command


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The jobs and the registry that would have been run."""
    found: list[Any] = []

    def run_jobs(jobs: list[Any], registry: str, *_: object, **__: object) -> list[dict[str, str]]:
        found.extend([*jobs, registry])
        return [{"run": "run-1", "policy": "policy-1", "crispness": None} for _ in jobs]

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    return found


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_whole_numbers(command: Command, asked: list[Any]) -> None:
    assert command("train", "BoxDoor", "--frames", "4e5", "--seed", "1e1").code == 0
    assert asked[0] == TrainJob(task="BoxDoor", seed=10, frames=400_000)
    assert command("train", "BoxDoor", "--seeds", "1e0-3.0").code == 0
    assert [job.seed for job in asked[2:5]] == [1, 2, 3]


def test_several_seeds_are_told_their_option(command: Command, asked: list[Any]) -> None:
    for text in ("0,1", "0-5"):
        answer = command("train", "BoxDoor", "--seed", text)
        assert answer.code == 2 and f"write --seeds {text}" in answer.err
    assert asked == []


def test_the_default_numbers_stay(
    registry: Registry, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def play(_: object, __: object, task: str, episodes: int, seed: int) -> dict[str, Any]:
        return {"policy": "policy-2", "task": task, "episodes": episodes, "seed": seed}

    monkeypatch.setattr("paddlectl.experiments.policies.evaluate", play)
    for more, numbers in (("", (200, 12345)), ("--episodes 1e3 --seed 5e0", (1000, 5))):
        row = command("evaluate", "GapBall", *more.split(), "--json").json
        assert (row["episodes"], row["seed"]) == numbers
    assert "12345" in command("evaluate", "GapBall").out


def test_home_folders(
    home: Path, command: Command, registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command("runs", "--registry=~/registry").code == 0
    assert command("runs", "--registry=sqlite:///~/registry").code == 0
    monkeypatch.setenv("PADDLECTL_REGISTRY", "~/registry")
    assert command("runs").code == 0
    assert command("registry", "export", "policy-1", "~/one.zip").code == 0 and (home / "one.zip").is_file()
    assert command("registry", "import", "~/one.zip").code == 0
    (home / "bad.yaml").write_text("name: 3")
    assert f"{home}/bad.yaml:1:7: name" in command("transfer", "~/bad.yaml").err
    assert not (home / "~").exists()


def test_a_scenario_in_a_home_folder(
    home: Path, command: Command, registry: Registry, asked: list[Any]
) -> None:
    (home / "good.yaml").write_text(SCENARIO)
    assert command("transfer", "~/good.yaml", "--registry=~/registry", "--seed", "0").code == 0
    assert asked[-1] == str(home / "registry")


def test_places(home: Path) -> None:
    user = "~" + Path("~root").expanduser().owner()
    for given, meant in (
        ("~", f"{home}"),
        ("~/a b", f"{home}/a b"),
        (f"{user}/x", f"{Path(user).expanduser()}/x"),
        ("./~/x", "./~/x"),
        ("x~", "x~"),
        ("sqlite:///~/x", f"{home}/x"),
        ("sqlite:///x", "x"),
        ("postgresql://me@host/db?files=~/x", f"postgresql://me@host/db?files={home}/x"),
        ("postgresql://me@host/db?a=~&files=%7E/x&b=~", f"postgresql://me@host/db?a=~&files={home}/x&b=~"),
        ("postgresql://me@host/db?files=/~x", "postgresql://me@host/db?files=/~x"),
    ):
        assert place(given) == meant


@pytest.mark.parametrize(
    "where", ["~nosuchuser/x", "sqlite:///~nosuchuser/x", "postgresql://h/d?files=~nosuchuser"]
)
def test_a_home_folder_that_is_not_there(home: Path, command: Command, where: str) -> None:
    answer = command("train", "BoxDoor", f"--registry={where}")
    assert answer.code == 2 and "there is no home folder ~nosuchuser" in answer.err
    assert not list(home.iterdir())


def test_a_budget_below_a_round_is_told_before_it_starts(tmp_path: Path) -> None:
    told: list[str] = []
    with Registry.open(tmp_path / "registry") as opened:

        def report(progress: Progress) -> None:
            assert told == ["2,048 frames are run instead of 1: whole rounds of 2,048"]
            assert (progress.frames, progress.total) == (2048, 2048)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            train_source(
                TrainJob(task="BoxDoor", seed=0, frames=1), opened, report, Checkpointer(tell=told.append)
            )
    told.clear()
    Checkpointer(tell=told.append).tell_of_rounds(2048, 2048)
    Checkpointer(tell=told.append, resumed="run-1").tell_of_rounds(1, 2048)
    assert told == []


def test_a_hint_with_seeds_apart_names_the_registry_after_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["paddlectl", "transfer", "x.yaml", "--registry", "r"])
    told = here("run: paddlectl train BoxDoor --seeds 0-2,7, then paddlectl train GapBall --seed 1")
    first = "paddlectl train BoxDoor --seeds 0-2,7 --registry r"
    assert told == f"run: {first}, then paddlectl train GapBall --seed 1 --registry r"


@pytest.mark.parametrize(
    "given, told",
    [
        ([], "run: paddlectl registry check, then paddlectl registry repair"),
        (
            ["--registry", "a b"],
            "run: paddlectl registry check --registry 'a b', then paddlectl registry repair --registry 'a b'",
        ),
        (
            ["--registry=postgresql://me:s3cret@h/d"],
            "run: paddlectl registry check --registry 'postgresql://…@h/d',"
            " then paddlectl registry repair --registry 'postgresql://…@h/d'",
        ),
    ],
)
def test_a_hint_names_the_registry_that_was_named(
    given: list[str], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["paddlectl", "registry", "gc", *given])
    assert here("run: paddlectl registry check, then paddlectl registry repair") == told
    assert here("run: paddlectl train --help") == "run: paddlectl train --help"
    assert here("use the version of paddlectl that wrote it last").endswith("wrote it last")
