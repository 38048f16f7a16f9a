"""Names and tags of runs: given when they start or later, and used instead of ids."""

import json
import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from paddlectl import plugins
from paddlectl.cli.completion import ended_names, plotted_names, run_names, stopped_names, transfer_names
from paddlectl.cli.named import learned
from paddlectl.cli.resume import resumable
from paddlectl.errors import NotFoundError, PaddlectlError, UsageError
from paddlectl.experiments.jobs import ResumeJob
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import manifests
from paddlectl.registry.names import quoted
from paddlectl.registry.records import RunRecord
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite
from samples import TARGET, Command, add_source, reseal

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
    untagged = command("runs", "--task", registry.run("run-1").task).out
    assert "run-1" in untagged and "tags" not in untagged and "tags" in command("runs").out
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


TAKING_A_RUN = [
    (["show"], ["--json"], "run"),
    (["label"], ["--tag", "x", "--json"], "runs"),
    (["explain"], ["--json"], "run"),
    (["export"], ["--json"], "run"),
    (["registry", "export"], ["run.zip", "--json"], "exported"),
    (["plot"], ["--json"], "figure"),
    (["registry", "delete"], ["--yes", "--json"], "deleted"),
]


@pytest.mark.parametrize(
    ("before", "after", "where"), TAKING_A_RUN, ids=[" ".join(words) for words, _, _ in TAKING_A_RUN]
)
def test_wherever_a_runs_id_stands_its_name_and_latest_do(
    registry: Registry, command: Command, before: list[str], after: list[str], where: str,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    registry.files.append_rows("run-3", "episodes", [{"order": 0, "started": 0, "frames": 9, "score": 1.0}])
    reseal(registry, "run-3")
    registry.label_runs(["run-3"], name="A-paddle")
    near = command(*before, "A-PADDLE", *after)
    assert near.code == 4 and "did you mean A-paddle? or " in near.err, near
    answers = []
    for name in ("run-3", "A-paddle", "latest"):
        shutil.copytree(registry.folder, tmp_path / name)
        told = command(*before, name, *after, "--registry", tmp_path / name)
        (tmp_path / "run.zip").unlink(missing_ok=True)
        assert told.code == 0, told
        answers.append(told.json[where])
    assert answers[0] == answers[1] == answers[2] and "3" in str(answers[0])


def test_a_run_is_watched_by_its_name(registry: Registry) -> None:
    registry.label_runs(["run-3"], name="A-paddle")
    assert [learned(registry, name).id for name in ("A-paddle", "latest")] == ["policy-3", "policy-3"]
    with pytest.raises(NotFoundError, match="did you mean A-paddle"):
        learned(registry, "A-PADDLE")


def test_a_run_is_resumed_by_its_name(registry: Registry) -> None:
    run = add(registry, task="BoxDoor", name="mine").id
    registry.finish_run(run, status="interrupted", frames=0, episodes=0, seconds=0.0, results={})
    for name in ("mine", "latest"):
        assert [asked.job for asked in resumable(registry, [name], False)[0]] == [ResumeJob(run)]
    with pytest.raises(NotFoundError, match="did you mean mine"):
        resumable(registry, ["MINE"], False)


def test_the_shell_is_offered_names(registry: Registry) -> None:
    registry.label_runs(["run-3"], name="A-paddle")
    place = str(registry.folder)
    for offered in (run_names, plotted_names, ended_names, transfer_names):
        assert ("A-paddle", f"run-3: paddle on {TARGET}") in offered(place)
    add(registry, task="BoxDoor", name="mine")
    assert ("mine", "run-4: hdm on BoxDoor") in stopped_names(place)


def test_a_study_goes_before_a_run_of_its_name(
    registry: Registry, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    registry.label_runs(["run-3"], name="mine")
    (tmp_path / "mine").write_text("")
    assert "neither a study" in command("plot", "mine").err


def test_what_matches_nothing_is_told(registry: Registry, command: Command) -> None:
    registry.label_runs(["run-3"], tags=["paper"])
    for words, note in (
        (["--tag", "Paper"], "note: no run has the tag Paper; did you mean paper?\n"),
        (["--tag", "q1"], "note: no run has the tag q1\n"),
        (["--scenario", "zz"], "note: no run has the scenario zz\n"),
        (["--tag", "paper", "--scenario", "A"], ""),
        (["--tag", "paper", "--method", "hdm"], ""),
    ):
        assert command("runs", *words).err == note
    for words, told in (
        (["--since", ""], "error: '' is no date\nuse 2d"),
        (["--tag", ""], "error: --tag can't be ''\nleave out --tag"),
        (["--all", "--limit", "3"], "exclude each other\nleave one of them out"),
    ):
        answer = command("runs", *words)
        assert answer.code == 2 and told in answer.err


def test_folders_and_nothing_are_no_scenarios(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("paper", "A"):
        (tmp_path / name).mkdir()
    (tmp_path / "A.yaml").write_text("")
    for words, told in (
        (["transfer", ""], "no scenario is named\nthere are A, "),
        (["transfer", "."], ". is a folder, no scenario\nthere are A, "),
        (["transfer", "A/"], "A/ is a folder, no scenario\ndid you mean A.yaml?"),
        (["sweep", "paper", "--dry-run"], "paper is a folder, no study\ndid you mean paper/"),
        (["plot", "paper"], "paper is a folder, no study\ndid you mean paper/"),
    ):
        answer = command(*words)
        assert answer.code == 4 and told in answer.err, answer


def test_what_a_run_lacks_comes_by_going_on(registry: Registry, command: Command) -> None:
    run = add(registry, task="BoxDoor").id
    for status in ("running", "interrupted"):
        if status != "running":
            registry.finish_run(run, status=status, frames=0, episodes=0, seconds=0.0, results={})
        with pytest.raises(NotFoundError, match=f"run: paddlectl resume {run}"):
            learned(registry, run)
        assert f"\nrun: paddlectl resume {run}" in command("plot", run).err
    with registry.files.hold(registry.resume_run(run).id), pytest.raises(NotFoundError, match="wait for it"):
        learned(registry, run)


@pytest.mark.parametrize("name", ["a b", "it's", "a\x1b[31m\\b'c\nd", "\u202eé", "\udcff x"])
def test_what_is_quoted_can_be_pasted(name: str) -> None:
    assert quoted(name).isprintable()
    done = subprocess.run(["bash", "-c", f"printf %s {quoted(name)}"], capture_output=True, check=True)
    assert done.stdout == os.fsencode(name)


def test_an_imported_run_is_labelled_as_it_comes(
    command: Command, registry: Registry, tmp_path: Path
) -> None:
    command("label", "run-1", "--name", "mine", "--tag", "old")
    assert command("registry", "export", "mine", tmp_path / "a.zip").code == 0
    elsewhere = ("--registry", tmp_path / "elsewhere")
    refused = command("registry", "import", tmp_path / "a.zip", "--name", "latest", *elsewhere)
    assert refused.code == 2 and not (tmp_path / "elsewhere").exists()
    given = ("--name", "theirs", "--tag", "a", "--tag", "b")
    assert command("registry", "import", tmp_path / "a.zip", *given, *elsewhere).code == 0
    (run,) = command("runs", "--json", *elsewhere).json["runs"]
    assert (run["name"], run["tags"]) == ("theirs", ["a", "b"])


def test_the_tag_that_can_not_be_one_is_told(registry: Registry, command: Command) -> None:
    registry.label_runs(["run-1"], tags=[f"tag{n}" for n in range(20)])
    answer = command("label", "run-1", "--tag", "a b")
    assert answer.code == 2 and "tags can't be 'a b'" in answer.err
