"""Names and tags of runs: given when they start or later, and used instead of ids."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from paddlectl import plugins
from paddlectl.errors import PaddlectlError, UsageError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import manifests
from paddlectl.registry.records import RunRecord
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite
from samples import TARGET, Command, add_source

LONG = "x" * 65
KEY_GOAL = """\
summary: Fetch the key, open the locked door, go to the goal.
passage: locked
near: [key]
far: [goal]
milestones: [gt_door]
success: [gt_goal]
"""
LIKE_IDS = ("RUN-1", "Run-77", "run-01", "policy-01", "POLICY-3", "run7", "run_7")


def test_a_run_is_called_by_its_name(registry: Registry, command: Command, tmp_path: Path) -> None:
    told = command("label", "run-3", "--name", "first", "--tag", "paper", "--tag", "good", "--json")
    assert told.json["runs"][0]["name"] == "first" and told.json["runs"][0]["tags"] == ["paper", "good"]
    assert command("label", "run-2", "--tag", "paper").code == 0
    assert command("show", "first").out.startswith("run-3: ")
    assert "name: first\ntags: paper, good\n" in command("show", "first").out
    assert command("explain", "first", "--json").json["run"] == "run-3"
    assert command("export", "first", "--json").json["run"]["run"] == "run-3"
    exported = command("registry", "export", "first", tmp_path / "run.zip", "--json")
    assert exported.json["exported"] == "run-3"
    tagged = [row["run"] for row in command("runs", "--tag", "paper", "--json").json["runs"]]
    assert tagged == ["run-3", "run-2"]
    assert not command("runs", "--tag", "pape", "--json").json["runs"]
    assert " first " in command("runs").out and " name " not in command("runs", "--tag", "x").out
    assert command("label", "first", "--untag", "good", "--name", "", "--json").json["runs"][0] | {} == {
        **command("runs", "--tag", "paper", "--json").json["runs"][0],
        "name": None,
        "tags": ["paper"],
    }
    assert command("show", "first").code == 4


def test_what_can_not_be_a_label_is_refused(registry: Registry, command: Command) -> None:
    command("label", "run-1", "--name", "first")
    for words, told in (
        (["run-2", "--name", "first"], "run-1 is called first"),
        (["run-2", "--name", "run-7"], "no run can be called run-7"),
        (["run-2", "--name", "latest"], "no run can be called latest"),
        (["run-2", "--name", TARGET], f"{TARGET} is a task"),
        (["run-2", "--name", "Latest"], "no run can be called Latest"),
        *((["run-2", "--name", each], f"no run can be called {each}") for each in LIKE_IDS),
        (["run-2", "--name", "a b"], "name can't be 'a b'"),
        (["run-2", "--tag", LONG], "tags can't be"),
        (["run-2", "--tag", "\x1b[31m"], "tags can't be"),
        (["run-1", "run-2", "--name", "both"], "--name is of one run, and 2 are named"),
        (["run-2"], "nothing to change"),
        (["run-2", *(f"--tag=t{n}" for n in range(33))], "run-2 would have 33 tags; 32 at most"),
    ):
        answer = command("label", *words)
        assert answer.code == 2 and told in answer.err and len(answer.err.splitlines()) == 2, answer
    assert registry.run("run-2").name is None and registry.run("run-2").tags == ()
    near = command("show", "frist")
    assert near.code == 4
    for words in (["BoxDoor", "--name", "first"], ["BoxDoor", "GapBall", "--name", "two"]):
        assert command("train", *words).code == 2
    assert len(registry.runs()) == 3


def test_a_label_changes_nothing_else(registry: Registry) -> None:
    """The files of a run stay sealed as they were: a label doesn't bless what was damaged meanwhile."""
    before = manifests.read(registry.folder, "run-3")
    registry.label_runs(["run-3"], name="first", tags=["a"])
    after = manifests.read(registry.folder, "run-3")
    assert after.files == before.files
    assert {**after.row, "name": None, "tags": "[]"} == before.row
    assert json.loads(after.row["tags"]) == ["a"]
    with pytest.raises(UsageError):
        registry.add_run(
            kind="train", method="hdm", task="BoxDoor", scenario=None, sources=[], seed=0, settings={},
            versions={}, name="first",
        )  # fmt: skip


def test_all_of_the_runs_are_labelled_or_none(registry: Registry, command: Command) -> None:
    registry.label_runs(["run-2"], tags=[f"t{n}" for n in range(32)])
    before = [manifests.read(registry.folder, f"run-{n}") for n in (1, 2, 3)]
    told = command("label", "run-1", "run-2", "run-3", "--tag", "new")
    assert told.code == 2 and "run-2 would have 33 tags; 32 at most" in told.err
    assert command("label", "run-1", "run-9", "--tag", "new").code == 4
    manifests.path_of(registry.folder, "run-3").unlink()
    assert command("label", "run-1", "run-3", "--tag", "new").code == 5
    manifests.write(registry.folder, before[2])
    assert registry.run("run-1").tags == registry.run("run-3").tags == ()
    assert [manifests.read(registry.folder, f"run-{n}") for n in (1, 2, 3)] == before
    assert command("label", "run-2", "run-1", "run-2", "--tag", "new", "--untag", "t7").code == 0
    assert registry.run("run-1").tags == ("new",) and len(registry.run("run-2").tags) == 32


def test_a_disk_that_fills_up_amid_it_leaves_all_as_it_was(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = [manifests.read(registry.folder, f"run-{n}") for n in (1, 2)]
    write, left = manifests.write, [0, 28]

    def full(folder: Path, manifest: manifests.Manifest) -> None:
        if left and (number := left.pop(0)):
            raise OSError(number, "No space left on device")
        write(folder, manifest)

    monkeypatch.setattr(manifests, "write", full)
    with pytest.raises(PaddlectlError, match="the disk is full"):
        registry.label_runs(["run-1", "run-2"], tags=["new"])
    assert [manifests.read(registry.folder, f"run-{n}") for n in (1, 2)] == before
    assert check(registry.folder).findings == []


def test_what_another_process_did_meanwhile_stays(registry: Registry) -> None:
    """None of many at once loses its tag, nor the name that another gave."""

    def tagged(number: int) -> None:
        with Registry.open(registry.folder) as own:
            own.label_runs(["run-1"], name="first" if number == 4 else None, tags=[f"t{number}"])

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(tagged, range(16)))
    run = registry.run("first")
    assert run.id == "run-1" and set(run.tags) == {f"t{n}" for n in range(16)}


def add(registry: Registry, **given: Any) -> RunRecord:
    plain = {"kind": "train", "method": "hdm", "task": "Own", "scenario": None, "sources": [], "seed": 0}
    return registry.add_run(**plain | {"settings": {}, "versions": {}} | given)


def test_a_task_that_only_the_registry_knows_is_no_name(
    registry: Registry, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plugins, "_files", {})
    monkeypatch.setattr(suite.PLUGINS, "_of_files", {})
    add_source(registry, "KeyGoal", None)
    add(registry, task="Begun")
    for task in ("KeyGoal", "Begun"):
        for words in (["label", "run-2", "--name", task], ["train", "BoxDoor", "--name", task]):
            told = command(*words)
            assert told.code == 2 and f"{task} is a task" in told.err
    with pytest.raises(UsageError, match="Own is a task"):
        add(registry, name="Own")
    file = tmp_path / "Mine.yaml"
    file.write_text(KEY_GOAL)
    assert "Mine is a task" in command("train", file, "--name", "Mine").err
    python = tmp_path / "own.py"
    python.write_text("TASKS = {'Ours': lambda name: None}\n")
    assert "Ours is a task" in command("train", "BoxDoor", "--tasks", python, "--name", "Ours").err


def test_a_task_that_is_called_as_a_run_is_refused_before_it_begins(
    registry: Registry, command: Command, tmp_path: Path
) -> None:
    other = Registry.open(tmp_path / "other")
    add_source(other, "Mine", None)
    bundles.export(other, "run-1", tmp_path / "mine.zip")
    command("label", "run-2", "--name", "Mine")
    (tmp_path / "Mine.yaml").write_text(KEY_GOAL)
    (tmp_path / "to.yaml").write_text("name: to\ntarget: Mine.yaml\nsources: [GapBall]\n")
    (tmp_path / "from.yaml").write_text("name: from\ntarget: BoxDoor\nsources: [Mine.yaml]\n")
    (tmp_path / "study.yaml").write_text("name: s\nscenarios: [from.yaml]\nmethods: [paddle]\nseeds: 0\n")
    before = len(registry.runs())
    for words in (
        ["train", "BoxDoor", tmp_path / "Mine.yaml"],
        ["transfer", tmp_path / "to.yaml", "--seed", "0"],
        ["transfer", tmp_path / "from.yaml", "--seed", "0", "--train-missing"],
        ["sweep", tmp_path / "study.yaml"],
        ["registry", "import", tmp_path / "mine.zip"],
    ):
        told = command(*words)
        assert told.code == 2 and "run-2 is called Mine, as the task is" in told.err, told
    with pytest.raises(UsageError, match="run-2 is called Mine"):
        add(registry, task="Mine")
    assert len(registry.runs()) == before and check(registry.folder).faults == []
    assert command("label", "run-2", "--name", "").code == 0
    assert command("registry", "import", tmp_path / "mine.zip").code == 0


def kinds(registry: Registry) -> set[str]:
    """What is found of run-3, none of which is a fault."""
    found = [each for each in check(registry.folder).findings if each.where == "run-3"]
    assert not any(each.fault for each in found)
    return {each.kind for each in found}


def test_a_label_that_was_half_given_is_no_fault_and_is_mended(registry: Registry) -> None:
    registry.label_runs(["run-3"], name="first", tags=["a"])
    with registry.index.writing() as connection:
        connection.execute(runs.update().where(runs.c.id == 3).values(name=None))
    assert kinds(registry) == {"other labels"}
    repair(registry.folder)
    assert Registry.open(registry.folder).run("run-3").name == "first"
    assert not kinds(registry)
