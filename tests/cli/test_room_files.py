"""A task of many rooms from a file, as a user meets it: learned, then used where the file is gone."""

import json
import re
import shutil
from pathlib import Path

import gymnasium
import pytest

import paddlectl
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import train_source
from paddlectl.registry.store import Registry
from paddlectl.studies.cells import cells_of
from paddlectl.studies.study import load_study
from paddlectl.tasks.naming import content, given
from samples import ROOT, Command
from schemas import misfits, schema_of
from small_transfer import SMALL
from trials.runs import StopAfter, ended, quiet, small

PAGE = (ROOT / "docs" / "tasks.md").read_text(encoding="utf-8").partition("## More rooms\n")[2]
FILES = dict(re.findall(r"```yaml\n# mytasks/(\S+\.yaml).*\n([^`]+)```", PAGE))
SCENARIO = "name: ToHall\ntarget: KeyHall.yaml\nsources: [TwoLocks.yaml, MiniGrid-DoorKey-5x5-v0]\n"


def write_files(folder: Path) -> Path:
    """The page's examples, and a scenario of them."""
    (folder / "mytasks").mkdir(exist_ok=True)
    for name, text in {**FILES, "ToHall.yaml": SCENARIO}.items():
        (folder / "mytasks" / name).write_text(text, encoding="utf-8")
    return folder / "mytasks"


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """policy-1 learned TwoLocks, policy-2 MiniGrid's DoorKey, policy-3 KeyHall from both; no file is left."""
    place = tmp_path_factory.mktemp("learned")
    mytasks = write_files(place)
    registry = place / "registry"
    with small():
        paddlectl.train(mytasks / "TwoLocks.yaml", frames=1, registry=registry)
        paddlectl.train("MiniGrid-DoorKey-5x5-v0", frames=1, registry=registry)
        paddlectl.transfer(mytasks / "ToHall.yaml", frames=1, registry=registry)
    shutil.rmtree(mytasks)
    return registry


@pytest.fixture
def place(learned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a registry of those three."""
    shutil.copytree(learned, tmp_path / "registry")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_its_policies_are_used_without_the_files(command: Command, place: Path) -> None:
    for name, policy in (("TwoLocks", "policy-1"), ("KeyHall", "policy-3"), ("policy-3", "policy-3")):
        found = command("evaluate", name, "--episodes", 4, "--json").json
        assert (found["policy"], found["task"]) == (policy, command("show", policy, "--json").json["task"])
    moved = command("evaluate", "KeyHall", "--task", "MiniGrid-DoorKey-5x5-v0", "--episodes", 4, "--json")
    assert moved.json["task"] == "MiniGrid-DoorKey-5x5-v0"
    shown = command("show", "TwoLocks", "--json").json
    assert misfits(shown, schema_of("show")) == []
    assert shown["definition"]["rooms"] == [["start", "middle"], ["end", "middle"]]
    assert "  - [start, middle]\n" in command("show", "policy-1").out
    told = command("explain", "--json").json
    assert told["target"] == "KeyHall"
    assert [each["task"] for each in told["source_programs"]] == ["TwoLocks", "MiniGrid-DoorKey-5x5-v0"]
    assert command("watch", "policy-3", "--gif", "hall.gif", "--json").json["task"] == "KeyHall"
    found = command("similarity", "--target", "MiniGrid-UnlockPickup-v0", "--json").json
    assert set(found["sources"]) >= {"policy-1", "policy-2"}


def test_its_policy_goes_to_another_registry(command: Command, place: Path) -> None:
    assert command("registry", "export", "TwoLocks", "locks.zip").code == 0
    there = place / "there"
    assert command("registry", "import", "locks.zip", "--registry", there).code == 0
    found = [
        command("evaluate", "TwoLocks", "--episodes", 4, "--registry", where, "--json").json
        for where in (there, "registry")
    ]
    assert found[0] == found[1]
    assert paddlectl.load("locks.zip").task == "TwoLocks"


def test_a_file_stands_wherever_a_tasks_name_does(command: Command, place: Path) -> None:
    mytasks = write_files(place)
    file = "mytasks/TwoLocks.yaml"
    assert command("evaluate", file, "--episodes", 4, "--json").json["policy"] == "policy-1"
    other = command("evaluate", "policy-2", "--task", "mytasks/BoxMaze.yaml", "--episodes", 4, "--json").json
    assert (other["policy"], other["task"]) == ("policy-2", "BoxMaze")
    found = command("similarity", "--target", "mytasks/BoxMaze.yaml", "--source", file, "--json").json
    assert (found["target"], found["sources"]) == ("BoxMaze", ["policy-1"])
    assert command("show", file, "--json").json["policy"] == "policy-1"
    (row,) = command("tasks", file, "--json").json["tasks"]
    assert row["definition"] == json.loads(json.dumps(content(given(file)).definition))
    (place / "study.yaml").write_text(
        "name: mine\nscenarios: [mytasks/ToHall.yaml]\nmethods: [paddle]\nseeds: 0\n"
        "variants: {usual: {}, own: {sources: [mytasks/BoxMaze.yaml]}}\n"
    )
    cells = cells_of(load_study(place / "study.yaml"))
    assert {str(source) for cell in cells for source in cell.scenario.source_names} >= {"TwoLocks", "BoxMaze"}
    (mytasks / "BoxMaze.yaml").write_text(FILES["BoxMaze.yaml"].replace("room: upper", "room: attic"))
    answer = command("train", "mytasks/BoxMaze.yaml")
    where = "mytasks/BoxMaze.yaml:14:9: blue ball can't be reached: no way leads there from the agent"
    assert (answer.code, answer.err) == (3, f"error: {where}\n")


@pytest.mark.parametrize("name", FILES)
def test_what_tasks_tells_of_a_task_is_such_a_file(name: str, command: Command, place: Path) -> None:
    file = write_files(place) / name
    text = command("tasks", file).out
    lines = text[text.index("name: ") :].replace(f'"{file.stem}"', '"Copy"')
    (place / "Copy.yaml").write_text(lines)
    copied, own = given("Copy.yaml"), given(str(file))
    assert content(copied).definition == {**(content(own).definition or {}), "name": "Copy"}


def test_it_acts_in_the_files_environment(place: Path) -> None:
    path = write_files(place) / "TwoLocks.yaml"
    policy = paddlectl.load(path, registry="registry")
    env = gymnasium.make("paddlectl.tasks.registration:paddle/File-v0", task=str(path), split="evaluation")
    env.reset(seed=0)
    for _ in range(30):
        *_, told = env.step(policy.act(env))
    assert policy.id == "policy-1" and told["score"] >= 0
    assert env.unwrapped.asked == given(str(path))  # type: ignore[attr-defined]


def test_a_run_goes_on_with_the_task_that_it_began_with(place: Path) -> None:
    mytasks = write_files(place)
    task = given(str(mytasks / "TwoLocks.yaml"))
    registry = Registry.open("registry")
    with small():
        job = TrainJob(task, 3, 12 * 256, SMALL)
        whole = train_source(job, registry, quiet)["run"]
        with pytest.raises(KeyboardInterrupt):
            train_source(job, registry, quiet, Checkpointer(0, StopAfter(5)))
        shutil.rmtree(mytasks)
        stopped = registry.stopped_runs()[-1].id
        resume(stopped, registry, quiet, Checkpointer())
    assert ended(registry, stopped) == ended(registry, whole)
