"""The maze through the same doors as MiniGrid: train, show, similarity, evaluate, transfer, explain."""

import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import IntegrityError, InvalidFileError, NotFoundError
from paddlectl.experiments import policies
from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.policies import evaluate, revive
from paddlectl.experiments.resuming import job_of
from paddlectl.experiments.runner import run_transfer, train_source
from paddlectl.hybrid.settings import DEVIATIONS, presets, settings_for, settings_from
from paddlectl.learners.td3 import TD3Settings
from paddlectl.methods.paddle import PADDLE
from paddlectl.registry.store import Registry
from paddlectl.report.explanation import explanation_document
from paddlectl.scenario import load_scenario
from paddlectl.tasks.suite import load

ROOT = Path(__file__).parents[2]
FRAMES = 5120  # one rollout of 32 environments by 8 actions of 20 steps


@pytest.fixture(scope="module")
def maze(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Registry]:
    """Both sources, hardly trained, and a transfer from them."""
    patch = pytest.MonkeyPatch()
    patch.setattr(policies, "EVALUATION_EPISODES", 2)
    with Registry.open(tmp_path_factory.mktemp("maze")) as registry:
        for task in ("CoffeeMaze", "MailMaze"):
            train_source(TrainJob(task, 0, FRAMES), registry, lambda _: None)
        job = TransferJob(
            load_scenario(ROOT / "scenarios" / "maze.yaml"), ("policy-1", "policy-2"), "paddle", 0, 3000
        )
        run_transfer(job, registry, lambda _: None)
        yield registry
    patch.undo()


@pytest.fixture
def copy(maze: Registry, tmp_path: Path) -> Iterator[Registry]:
    """The same, to be added to."""
    shutil.copytree(maze.location, tmp_path / "copy")
    with Registry.open(tmp_path / "copy") as registry:
        yield registry


def test_sources_and_target_are_kept_with_their_domain(maze: Registry) -> None:
    kept = maze.policies()[::-1]
    assert [policy.task for policy in kept] == ["CoffeeMaze", "MailMaze", "CoffeeMailMaze"]
    assert {policy.domain for policy in kept} == {"maze2d"}
    assert "gt_coffee_office()" in kept[0].program
    runs = maze.runs()[::-1]
    assert [run.frames for run in runs[:2]] == [FRAMES, FRAMES]
    assert 0 < runs[2].frames <= 3000
    assert {"mujoco", "gymnasium-robotics"} <= set(runs[0].versions)


def test_a_policy_is_revived_and_plays_any_task_of_its_domain(maze: Registry) -> None:
    row = evaluate(maze, maze.policy("CoffeeMaze"), "CoffeeMailMaze", 2, 0)
    assert (row["task"], row["episodes"]) == ("CoffeeMailMaze", 2)
    with pytest.raises(IntegrityError, match="maze2d policy; BoxDoor is a minigrid task"):
        evaluate(maze, maze.policy("CoffeeMaze"), "BoxDoor", 2, 0)


def test_the_transfer_can_be_explained(maze: Registry) -> None:
    document = explanation_document(maze, maze.runs()[0])
    assert document["target"] == "CoffeeMailMaze"
    assert len(document["mapping"]["scenes"]) == 9
    assert document["trace"]
    assert {row["policy"] for row in document["weights"]} == {"target", "policy-1", "policy-2"}


def test_sources_of_another_domain_are_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "mixed.yaml"
    path.write_text("name: mixed\ntarget: CoffeeMailMaze\nsources: [CoffeeMaze, BoxDoor]\n")
    with pytest.raises(InvalidFileError, match=r"3:23: BoxDoor is a task of minigrid, .* of maze2d") as told:
        load_scenario(path)
    assert "\n" not in told.value.message


def test_what_is_missing_is_told_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    task = load("CoffeeMaze")  # listed and compared without it
    with pytest.raises(NotFoundError, match="needs mujoco") as told:
        task.make(1, 0)
    assert told.value.hint == "run: pip install 'paddlectl[maze]'"


@pytest.mark.parametrize("name", ["CoffeeMaze", "MailMaze"])
def test_the_preset_of_the_paper_takes_every_deviation_back(name: str) -> None:
    task = load(name)
    usual, paper = settings_for(task), presets(task)["paper"]
    assert paper.low_level == TD3Settings() != usual.low_level
    assert (paper.action_repeat, usual.action_repeat) == (1, 20)
    assert all(theirs != ours for theirs, ours in DEVIATIONS.values())
    for which, learned_by in enumerate((paper, usual)):
        values = {name: values[which] for name, values in DEVIATIONS.items()}
        assert dataclasses.replace(usual.low_level, **values) == learned_by.low_level


def test_a_policy_is_revived_by_the_preset_that_it_was_learned_with(maze: Registry, tmp_path: Path) -> None:
    task = load("MailMaze")
    with Registry.open(tmp_path) as registry:
        job = TrainJob(task.name, 0, 256, preset="paper")
        train_source(job, registry, lambda _: None)
        assert job_of(registry.runs()[0]).preset == "paper"
        revived = revive(registry, registry.policy("policy-1"))
        assert revived.settings == presets(task)["paper"]
    target = load("CoffeeMailMaze")
    assert revive(maze, maze.policy("MailMaze")).settings == settings_for(task)
    guided = PADDLE.presets(target)["guided"]
    assert revive(maze, maze.policy("CoffeeMailMaze")).settings == guided
    assert (guided.action_repeat, guided.num_envs) == (5, 1)


@pytest.mark.parametrize("preset", [None, "paper", "guided"])
def test_an_older_policy_has_what_it_lacks_from_its_preset(maze: Registry, preset: str | None) -> None:
    """Of when policies were kept with the name of their preset, and runs with `hybrid`, by hdm and paddle."""
    task = load("CoffeeMailMaze")
    kept = maze.policy(task.name)
    known: dict[str, Any] = maze.run(kept.run).settings["learning"]
    written = {name: known[name] for name in ("num_envs", "low_level")}
    today = {
        None: settings_for(task),
        "paper": presets(task)["paper"],
        "guided": PADDLE.presets(task)["guided"],
    }
    for method in ("paddle", "hdm"):
        record = dataclasses.replace(kept, method=method, metadata={"preset": preset} if preset else {})
        with pytest.MonkeyPatch.context() as patch:
            older = dataclasses.replace(maze.run(kept.run), settings={"hybrid": written})
            patch.setattr(Registry, "run", lambda *_, older=older: older)
            revived = revive(maze, record).settings
        assert revived == settings_from(task, written, today[preset])


@pytest.mark.parametrize("preset", ["papr", ["paper"]])
def test_a_preset_that_is_not_known_is_told(maze: Registry, preset: object) -> None:
    record = dataclasses.replace(maze.policy("MailMaze"), metadata={"preset": preset})
    with pytest.raises(IntegrityError, match="doesn't fit MailMaze"):
        revive(maze, record)


@pytest.mark.parametrize("method, mode", [("hdm", "default"), ("paddle", "paper")])
def test_who_inherits_nothing_learns_as_a_source_does(copy: Registry, method: str, mode: str) -> None:
    scenario = load_scenario(ROOT / "scenarios" / "maze.yaml")
    scenario = scenario.model_copy(update={"guidance": scenario.guidance.model_copy(update={"mode": mode})})
    given = ("policy-1", "policy-2") if method == "paddle" else ()
    row = run_transfer(TransferJob(scenario, given, method, 0, FRAMES), copy, lambda _: None)
    told = copy.run(row["run"]).settings["learning"]
    num_envs, steps = (8, 32) if mode == "paper" else (32, 8)
    assert (told["num_envs"], told["rollout_steps"], told["action_repeat"]) == (num_envs, steps, 20)


def test_a_source_of_other_networks_guides_and_hands_on_nothing(copy: Registry) -> None:
    """Learned by the preset `paper` it has three layers of 400; the target has two of 256."""
    train_source(TrainJob("MailMaze", 1, 256, preset="paper"), copy, lambda _: None)
    other = copy.policies()[0].id
    scenario = load_scenario(ROOT / "scenarios" / "maze.yaml")
    for given in (("policy-1", other), (other,)):
        row = run_transfer(TransferJob(scenario, given, "paddle", 0, 1280), copy, lambda _: None)
        assert copy.run(row["run"]).status == "finished"
