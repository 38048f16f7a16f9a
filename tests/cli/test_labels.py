"""Names and tags of runs: given when they start or later, and used instead of ids."""

import json
from pathlib import Path

import pytest

from paddlectl.errors import UsageError
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import manifests
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from samples import TARGET, Command

LONG = "x" * 65


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
        (["run-2", "--name", "a b"], "name can't be 'a b'"),
        (["run-2", "--tag", LONG], "tags can't be"),
        (["run-2", "--tag", "\x1b[31m"], "tags can't be"),
        (["run-1", "run-2", "--name", "both"], "--name is of one run, and 2 are named"),
        (["run-2"], "nothing to change"),
        (["run-2", *(f"--tag=t{n}" for n in range(33))], "tags can't be"),
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
    registry.label_run("run-3", "first", ["a"])
    after = manifests.read(registry.folder, "run-3")
    assert after.files == before.files
    assert {**after.row, "name": None, "tags": "[]"} == before.row
    assert json.loads(after.row["tags"]) == ["a"]
    with pytest.raises(UsageError):
        registry.add_run(
            kind="train", method="hdm", task="BoxDoor", scenario=None, sources=[], seed=0, settings={},
            versions={}, name="first",
        )  # fmt: skip


def kinds(registry: Registry) -> set[str]:
    """What is found of run-3, none of which is a fault."""
    found = [each for each in check(registry.folder).findings if each.where == "run-3"]
    assert not any(each.fault for each in found)
    return {each.kind for each in found}


def test_a_label_that_was_half_given_is_no_fault_and_is_mended(registry: Registry) -> None:
    registry.label_run("run-3", "first", ["a"])
    with registry.index.writing() as connection:
        connection.execute(runs.update().where(runs.c.id == 3).values(name=None))
    assert kinds(registry) == {"other labels"}
    repair(registry.folder)
    assert Registry.open(registry.folder).run("run-3").name == "first"
    assert not kinds(registry)
