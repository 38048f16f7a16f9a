"""A task from a file, as a user meets it: learned, then used where the file is gone or another."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import pytest

import paddlectl
from entered import entered
from paddlectl.errors import UsageError
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import run_transfer, train_source
from paddlectl.experiments.sources import resolve
from paddlectl.registry.records import Content
from paddlectl.registry.store import Registry
from paddlectl.scenario import load_scenario
from paddlectl.studies.cells import cells_of
from paddlectl.studies.study import load_study
from paddlectl.studies.sweep import plan
from paddlectl.tasks.naming import content, given
from samples import ROOT, Command
from schemas import misfits, schema_of
from small_transfer import SMALL
from trials.runs import StopAfter, ended, quiet, small

PAGE = (ROOT / "docs" / "tasks.md").read_text(encoding="utf-8").partition("## More rooms\n")[0]
FILES = {name: text for name, text in re.findall(r"```yaml\n# mytasks/(\S+\.yaml).*\n([^`]+)```", PAGE)}
FRAMES = 12 * 256  # rounds of SMALL


def write_files(folder: Path, **changes: str) -> Path:
    """The page's example, with other words in the task where they are given."""
    (folder / "mytasks").mkdir(exist_ok=True)
    for name, text in FILES.items():
        for old, new in changes.items():
            text = text.replace(old, new)
        (folder / "mytasks" / name).write_text(text, encoding="utf-8")
    return folder / "mytasks"


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """policy-1 learned the page's task, policy-2 OpenGoal from it; the files are gone since."""
    place = tmp_path_factory.mktemp("learned")
    mytasks = write_files(place)
    with small():
        one = paddlectl.train(mytasks / "KeyGoal.yaml", frames=1, registry=place / "registry")
        two = paddlectl.transfer(mytasks / "ToGoal.yaml", frames=1, registry=place / "registry")
    assert (one.policy.task, two.policy.task) == ("KeyGoal", "OpenGoal")
    shutil.rmtree(mytasks)
    yield place / "registry"


@pytest.fixture
def place(learned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a registry of those two."""
    shutil.copytree(learned, tmp_path / "registry")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_says_what_it_does() -> None:
    assert set(FILES) == {"KeyGoal.yaml", "ToGoal.yaml"}


@pytest.mark.usefixtures("place")
def test_its_policy_is_played_shown_and_explained_without_the_file(command: Command) -> None:
    for line in ("evaluate KeyGoal --episodes 4", "evaluate policy-1 --episodes 4"):
        found = command(*line.split(), "--json").json
        assert (found["policy"], found["task"]) == ("policy-1", "KeyGoal")
    assert command(*["evaluate", "policy-2", "--task", "KeyGoal.yaml"]).code == 4
    moved = command(*["evaluate", "KeyGoal", "--task", "DoorBall", "--episodes", "4", "--json"]).json
    assert moved["task"] == "DoorBall"
    shown = command("show", "KeyGoal", "--json").json
    assert misfits(shown, schema_of("show")) == []
    assert shown["definition"]["success"] == ["gt_goal"]
    assert "near: [key]\n" in command("show", "policy-1").out
    assert command("show", "policy-2", "--json").json["definition"] is None
    told = command("explain", "--json").json
    assert (told["target"], told["source_programs"][0]["task"]) == ("OpenGoal", "KeyGoal")
    assert {match["task"] for scene in told["mapping"]["scenes"] for match in scene["matches"]} == {"KeyGoal"}
    assert command("runs").code == command("policies").code == 0
    assert command("watch", "policy-1", "--gif", "key.gif", "--json").json["task"] == "KeyGoal"
    assert command("watch", "policy-2", "--task", "KeyGoal.yaml", "--gif", "key.gif").code == 4


def test_its_policy_goes_to_another_registry_and_is_mended(command: Command, place: Path) -> None:
    assert command("registry", "export", "KeyGoal", "key.zip").code == 0
    there = place / "there"
    assert command("registry", "import", "key.zip", "--registry", there).code == 0
    for path in there.glob("registry.db*"):
        path.unlink()
    assert command("registry", "repair", "--registry", there).code == 0
    found = [
        command("evaluate", "KeyGoal", "--episodes", 4, "--registry", where, "--json").json
        for where in (there, "registry")
    ]
    assert found[0] == found[1]
    assert (
        Registry.open(there).policy("policy-1").content
        == Registry.open("registry").policy("policy-1").content
    )
    assert paddlectl.load("key.zip").task == "KeyGoal"


def test_a_file_stands_wherever_a_tasks_name_does(command: Command, place: Path) -> None:
    write_files(place)
    file = "mytasks/KeyGoal.yaml"
    assert command("evaluate", file, "--episodes", 4, "--json").json["policy"] == "policy-1"
    other = command("evaluate", "policy-2", "--task", file, "--episodes", 4, "--json").json
    assert (other["policy"], other["task"]) == ("policy-2", "KeyGoal")
    found = command("similarity", "--target", file, "--source", "policy-2", "--json").json
    assert (found["target"], found["sources"]) == ("KeyGoal", ["policy-2"])
    found = command("similarity", "--target", file, "--json").json
    assert found["sources"] == ["policy-2"], "what a transfer learned, but not the target's own policy"
    found = command("similarity", "--target", "BoxDoor", "--source", file, "--json").json
    assert found["sources"] == ["policy-1"]
    found = command("similarity", "--target", "BoxDoor", "--json").json
    assert sorted(found["sources"]) == ["policy-1", "policy-2"]
    (row,) = command("tasks", file, "--json").json["tasks"]
    assert row["definition"] == json.loads(json.dumps(content(given(file)).definition))
    assert command("show", file, "--json").json["policy"] == "policy-1"
    assert command("registry", "export", file, "key.zip").code == 0


def test_what_tasks_tells_of_a_task_is_such_a_file(command: Command, place: Path) -> None:
    text = command("tasks", "BlockedBoxPlaceGoal").out
    lines = text[text.index("name: ") :].replace("BlockedBoxPlaceGoal", "Copy")
    (place / "Copy.yaml").write_text(lines)
    (row,) = command("tasks", "Copy.yaml", "--json").json["tasks"]
    (built_in,) = command("tasks", "BlockedBoxPlaceGoal", "--json").json["tasks"]
    assert row["definition"] == {**built_in["definition"], "name": "Copy"}
    assert {**row, "name": "", "definition": ""} == {**built_in, "name": "", "definition": ""}


def test_it_acts_in_the_files_environment(place: Path) -> None:
    path = write_files(place) / "KeyGoal.yaml"
    policy = paddlectl.load(path, registry="registry")
    env = gymnasium.make("paddlectl.tasks.registration:paddle/File-v0", task=str(path))
    env.reset(seed=0)
    for _ in range(5):
        env.step(policy.act(env))
    assert policy.id == "policy-1"


def test_mistakes_in_files_are_told_with_their_place(command: Command, place: Path) -> None:
    path = write_files(place) / "KeyGoal.yaml"
    path.write_text(path.read_text().replace("near: [key]", "near: []"))
    where = "mytasks/KeyGoal.yaml:5:14: gt_door can't be reached: the passage never opens, as there is no key"
    for line in ("train mytasks/KeyGoal.yaml", "evaluate policy-1 --task mytasks/KeyGoal.yaml"):
        answer = command(*line.split())
        assert (answer.code, answer.err) == (3, f"error: {where}\n")
    answer = command("transfer", "mytasks/ToGoal.yaml")
    assert (answer.code, answer.err) == (3, f"error: mytasks/ToGoal.yaml:3:11: {where}\n")
    path.unlink()
    answer = command("transfer", "mytasks/ToGoal.yaml")
    assert answer.code == 3 and "ToGoal.yaml:3:11: no file mytasks/KeyGoal.yaml" in answer.err
    assert command("train", "mytasks/KeyGoal.yaml").code == 4
    assert (
        "did you mean mytasks/KeyGoal.yaml?" in command("train", write_files(place) and "mytasks/KeyGoal").err
    )


def test_what_to_train_is_told_by_its_file(command: Command, place: Path) -> None:
    write_files(place, gt_door="gt_key")
    answer = command("evaluate", "mytasks/KeyGoal.yaml")
    told = "error: no policy for KeyGoal\nrun: paddlectl train mytasks/KeyGoal.yaml\n"
    assert (answer.code, answer.err) == (4, told)
    answer = command("transfer", "mytasks/ToGoal.yaml")
    assert answer.code == 4
    assert answer.err.endswith("run: paddlectl train mytasks/KeyGoal.yaml\n")


def test_two_tasks_of_one_name_are_kept_apart(command: Command, place: Path) -> None:
    mytasks = write_files(place, gt_door="gt_key")
    registry, other = Registry.open("registry"), given(str(mytasks / "KeyGoal.yaml"))
    with small():
        train_source(TrainJob(other, 0, 1, SMALL), registry, quiet)
    answer = command("evaluate", "KeyGoal")
    assert (answer.code, answer.err) == (
        2,
        "error: KeyGoal is the name of 2 tasks here: policy-1, policy-3 solve one each\n"
        "name a policy, or the task's file\n",
    )
    assert (
        command("evaluate", mytasks / "KeyGoal.yaml", "--episodes", 4, "--json").json["policy"] == "policy-3"
    )
    first = registry.policy("policy-1").content
    assert registry.policy(first).id == "policy-1"
    assert registry.policy(content(other)).id == "policy-3"
    assert [found for found, *_ in registry.learned(first, "hdm")] == ["policy-1"]
    best = {content.identity: policy for content, policy in registry.best_of_each("minigrid", "hdm")}
    assert best == {first.identity: "policy-1", content(other).identity: "policy-3"}
    scenario = load_scenario(mytasks / "ToGoal.yaml")
    assert resolve(registry, scenario, "paddle", [0]).ids == {0: ("policy-3",)}
    with pytest.raises(UsageError, match="name of 2 tasks"):
        registry.policy("KeyGoal")
    write_files(place, gt_door="gt_key", Fetch="Get")
    assert registry.policy(content(given(str(mytasks / "KeyGoal.yaml")))).id == "policy-3", (
        "as before but in words"
    )
    (place / "KeyGoal.yaml").write_text(FILES["KeyGoal.yaml"])
    answer = command("train", "KeyGoal.yaml", mytasks / "KeyGoal.yaml")
    assert (answer.code, answer.err.splitlines()[0]) == (
        2,
        "error: two tasks are called KeyGoal; give one of them another name",
    )
    (place / "both.yaml").write_text("name: b\ntarget: KeyGoal.yaml\nsources: [mytasks/KeyGoal.yaml]\n")
    assert "both.yaml:3:10: two tasks are called KeyGoal" in command("transfer", "both.yaml").err


def test_a_name_that_is_a_built_in_tasks_by_now_means_that(place: Path) -> None:
    """As after an import from where it was free."""
    registry = Registry.open("registry")
    kept = registry.policy("policy-1")
    made = {name: getattr(kept, name) for name in ("run", "domain", "method", "seed", "frames", "program")}
    figures = {"success_rate": 1.0, "mean_score": 1.0, "mean_length": 1.0, "crispness": 1.0}
    strange = {"definition": {**kept.metadata["definition"], "name": "OpenGoal"}}
    checkpoint = registry.read_checkpoint(kept)
    registry.add_policy(**made, **figures, task="OpenGoal", checkpoint=checkpoint, metadata=strange)
    assert registry.policy("OpenGoal").id == registry.policy(Content("OpenGoal")).id == "policy-2"


def test_a_run_goes_on_with_the_task_that_it_began_with(place: Path) -> None:
    mytasks = write_files(place)
    task = given(str(mytasks / "KeyGoal.yaml"))
    registry = Registry.open("registry")
    with small():
        job = TrainJob(task, 3, FRAMES, SMALL)
        whole = train_source(job, registry, quiet)["run"]
        with pytest.raises(KeyboardInterrupt):
            train_source(job, registry, quiet, Checkpointer(0, StopAfter(5)))
        write_files(place, gt_door="gt_key")
        stopped = registry.stopped_runs()[-1].id
        resume(stopped, registry, quiet, Checkpointer())
    assert ended(registry, stopped) == ended(registry, whole)


def test_it_is_a_target_and_a_transfer_to_it_goes_on_without_the_file(place: Path) -> None:
    mytasks = write_files(place)
    (mytasks / "to.yaml").write_text("name: to\ntarget: KeyGoal.yaml\nsources: [policy-2]\n")
    scenario = load_scenario(mytasks / "to.yaml")
    registry = Registry.open("registry")
    job = TransferJob(scenario, ("policy-2",), "paddle", 0, FRAMES, changes=SMALL)
    with small():
        with pytest.raises(KeyboardInterrupt):
            run_transfer(job, registry, quiet, Checkpointer(0, StopAfter(5)))
        shutil.rmtree(mytasks)
        stopped = registry.stopped_runs()[-1]
        resume(stopped.id, registry, quiet, Checkpointer())
    assert stopped.settings["scenario"]["target"] == stopped.task == "KeyGoal"
    kept = registry.policy(str(registry.run(stopped.id).policy))
    assert kept.content.identity == stopped.content.identity == registry.policy("policy-1").content.identity


def test_runs_of_different_tasks_arent_compared_under_one_name(command: Command, place: Path) -> None:
    mytasks = write_files(place)
    scenario = "name: to\ntarget: KeyGoal.yaml\nsources: [policy-2]\nmethod: hdm\n"
    (mytasks / "to.yaml").write_text(scenario)
    registry = Registry.open("registry")
    with small():
        for _ in range(2):
            job = TransferJob(load_scenario(mytasks / "to.yaml"), (), "hdm", 0, 1, changes=SMALL)
            run_transfer(job, registry, quiet)
            write_files(place, gt_door="gt_key")
    answer = command("compare")
    assert answer.code == 2 and "KeyGoal is the name of several tasks here" in answer.err
    alone = command("compare", "--task", "OpenGoal").err
    assert "the name of several tasks" not in alone and "no run is long enough to have figures" in alone


def test_a_cell_of_a_study_is_its_task_not_its_file(tmp_path: Path) -> None:
    mytasks = write_files(tmp_path)
    scenario = "name: to\ntarget: KeyGoal.yaml\nsources: [BoxDoor]\n"
    (mytasks / "to.yaml").write_text(scenario)
    (tmp_path / "study.yaml").write_text(
        "name: mine\nscenarios: [mytasks/to.yaml]\nmethods: [paddle]\nseeds: 0\n"
        "variants: {usual: {}, own: {sources: [mytasks/Copy.yaml]}}\n"
    )
    shutil.copy(mytasks / "KeyGoal.yaml", mytasks / "Copy.yaml")
    registry = Registry.open(tmp_path / "registry")

    def left() -> list[str]:
        return [step.name for step in plan(registry, cells_of(load_study(tmp_path / "study.yaml"))).left()]

    names = ["BoxDoor hdm seed 0", "Copy hdm seed 0", "to paddle usual seed 0", "to paddle own seed 0"]
    assert left() == names
    for _ in range(2):
        for step in plan(registry, cells_of(load_study(tmp_path / "study.yaml"))).steps():
            entered(registry, step.job)
    assert left() == []
    moved = mytasks / "elsewhere"
    moved.mkdir()
    shutil.move(mytasks / "KeyGoal.yaml", moved / "KeyGoal.yaml")
    (mytasks / "to.yaml").write_text(scenario.replace("KeyGoal", "elsewhere/KeyGoal"))
    assert left() == []
    (moved / "KeyGoal.yaml").write_text(FILES["KeyGoal.yaml"].replace("gt_door", "gt_key"))
    assert left() == names[2:]
    (mytasks / "Copy.yaml").write_text("passage: closed\nfar: [goal]\nsuccess: [gt_ball]\n")
    with pytest.raises(
        paddlectl.InvalidFileError, match=r"study\.yaml:5:39: .*Copy\.yaml:3:11: gt_ball needs"
    ):
        left()


def test_a_variant_may_not_give_a_name_to_another_task(tmp_path: Path) -> None:
    mytasks = write_files(tmp_path)
    other = tmp_path / "KeyGoal.yaml"
    other.write_text(FILES["KeyGoal.yaml"].replace("gt_door", "gt_key"))
    (tmp_path / "study.yaml").write_text(
        "name: mine\nscenarios: [mytasks/ToGoal.yaml]\nmethods: [paddle]\nseeds: 0\n"
        "variants: {own: {sources: [KeyGoal.yaml]}}\n"
    )
    with pytest.raises(paddlectl.InvalidFileError, match="two tasks are called KeyGoal"):
        load_study(tmp_path / "study.yaml")
    assert (mytasks / "KeyGoal.yaml").exists()
