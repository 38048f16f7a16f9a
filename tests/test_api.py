"""Python's interface: what it loads, plays, learns and lists."""

import gzip
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from inspect import getdoc, signature
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

import paddlectl
from paddlectl.agents.interaction import Interaction
from paddlectl.agents.playing import Playing
from paddlectl.experiments import runner
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.policies import revive
from paddlectl.hybrid.rollout import Rollout
from paddlectl.methods.base import method_of
from paddlectl.registry.bundles import bundles
from paddlectl.registry.store import Registry
from paddlectl.tasks.minigrid.layouts import SPECS, Layouts, draw_layouts
from paddlectl.tasks.registration import environment_id
from paddlectl.tasks.suite import load as load_task
from released import BUNDLES
from samples import ROOT, TARGET
from trials.runs import small

HEAVY = {
    "torch",
    "numpy",
    "gymnasium",
    "minigrid",
    "mujoco",
    "pydantic",
    "sqlalchemy",
    "typer",
    "rich",
    "yaml",
}
LAYOUTS = 20
MADE = "paddlectl.tasks.registration:paddle/"
SCENARIO = {"name": "A", "target": TARGET, "sources": ["BlockedDoor", "GapBall"], "frames": 1}


def python(code: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy that has learned BoxDoor, as `registry export` wrote it."""
    path = tmp_path_factory.mktemp("bundle") / "BoxDoor.zip"
    path.write_bytes(gzip.decompress((BUNDLES / "BoxDoor-0002.zip.gz").read_bytes()))
    return path


@pytest.fixture
def place(bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry that holds it, and is found without being named."""
    location = tmp_path / "registry"
    bundles.import_(lambda: Registry.open(location), bundle)
    monkeypatch.setenv("PADDLECTL_REGISTRY", str(location))
    return location


def test_importing_it_loads_nothing_heavy() -> None:
    told = python("import sys, paddlectl; paddlectl.__version__; dir(paddlectl); print(*sys.modules)")
    assert not {name.split(".")[0] for name in told.split()} & HEAVY


def test_its_functions_stay_functions_whatever_is_imported() -> None:
    """One bears the name of a package."""
    code = "import paddlectl\nfrom paddlectl.transfer import guidance\nfrom paddlectl.methods import paddle\n"
    assert python(f"{code}print(paddlectl.transfer.__module__, guidance.__name__)").split() == [
        "paddlectl.api", "paddlectl.transfer.guidance",
    ]  # fmt: skip


def test_every_name_is_there_with_its_docstring() -> None:
    for name in set(paddlectl.__all__) - {"__version__"}:
        found = getattr(paddlectl, name)
        assert getdoc(found) and name in dir(paddlectl)
        if callable(found) and not isinstance(found, type):
            assert all(f"    {each}: " in str(found.__doc__) for each in signature(found).parameters), name
    with pytest.raises(AttributeError, match="no attribute 'lod'"):
        paddlectl.lod  # noqa: B018


# Playing


def play(policy: paddlectl.Policy, env: gymnasium.Env, layouts: Layouts) -> list[tuple[int, float]]:
    """Steps and score of each layout's episode."""
    ended = []
    for index in range(len(layouts.agent)):
        env.reset()
        env.unwrapped.place(layouts, index)
        done = False
        while not done:
            *_, terminated, truncated, info = env.step(policy.act(env))
            done = terminated or truncated
        ended.append((env.unwrapped.step_count, info["score"]))
    return ended


def alone(layouts: Layouts, index: int) -> Layouts:
    return Layouts(*(values[index : index + 1] for values in layouts))


def evaluated(location: Path, layouts: Layouts, seed: int) -> list[tuple[int, float]]:
    """The same by the loop that evaluates."""
    task, ended = load_task("BoxDoor"), []
    with Registry.open(location) as registry:
        policy = revive(registry, registry.policy(task.name))
    for index in range(len(layouts.agent)):
        engine: Any = task.make(1, 0, policy.action_repeat, "evaluation")
        engine.set_layouts(Layouts(*(values[index : index + 1] for values in layouts)))
        player = policy.player(task, 1, np.random.SeedSequence((seed, index)))
        interaction, ended_now = Interaction(engine, player), []
        while not ended_now:
            ended_now = interaction.run(1)
        (episode,) = ended_now
        ended.append((episode.length, pytest.approx(episode.score)))
    return ended


def test_act_earns_what_an_evaluation_earns(place: Path) -> None:
    layouts = draw_layouts(SPECS["BoxDoor"], np.random.default_rng(5), LAYOUTS, "evaluation")
    env = gymnasium.make(MADE + "BoxDoor-v0", split="evaluation")
    played = play(paddlectl.load("BoxDoor", seed=7), env, layouts)
    assert played == evaluated(place, layouts, seed=7)
    assert sum(score > 0.9 for _, score in played) == LAYOUTS


def test_the_example_of_the_documents_runs(place: Path) -> None:
    (code,) = {
        found
        for page in ("README.md", "docs/python.md")
        for found in re.findall(r"```python\n(.*?)```", (ROOT / page).read_text("utf-8"), re.DOTALL)
    }
    names: dict[str, Any] = {}
    exec(code, names)
    assert names["env"].unwrapped.step_count == 1


def test_act_is_told_by_its_seed_whoever_takes_turns(bundle: Path) -> None:
    layouts = draw_layouts(SPECS["BoxDoor"], np.random.default_rng(5), 5)
    one, other = (gymnasium.make(MADE + "BoxDoor-v0") for _ in range(2))
    policy, again = (paddlectl.load(bundle, seed=3) for _ in range(2))
    actions: dict[str, list[int]] = {"one": [], "other": [], "alone": []}
    for env in (one, other):
        env.reset(seed=4)
    for _ in range(12):
        for name, env in (("one", one), ("other", other)):
            action = policy.act(env)
            assert policy.act(env) == action, "asked twice, it stays with its decision"
            actions[name].append(action)
            env.step(action)
    one.reset(seed=4)
    for _ in range(12):
        actions["alone"].append(again.act(one))
        one.step(actions["alone"][-1])
    assert actions["one"] == actions["other"] == actions["alone"]
    assert play(policy, one, layouts) == play(policy, other, layouts)


def test_a_decision_ends_with_the_episode(bundle: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    decide = Rollout._decide
    monkeypatch.setattr(
        Rollout, "_decide", lambda self, env: (asked.append(int(self._pending[0])), decide(self, env))
    )
    policy, env = paddlectl.load(bundle), gymnasium.make(MADE + "BoxDoor-v0")
    env.reset(seed=0)
    for _ in range(3):
        env.step(policy.act(env))
    assert asked[:2] == [1, 0], "the first decision goes on in the second step"
    env.reset(seed=0)
    policy.act(env)
    assert asked[-1] == 1
    env.step(0)
    env.step(0)
    policy.act(env)
    assert asked[-1] == 1, "steps that it wasn't asked for may have ended it"


@pytest.mark.parametrize(
    ("task", "method"),
    [("BoxDoor", "hdm"), ("GapBall", "ppo"), ("BoxDoor", "hdqn"), ("CoffeeMaze", "hdm"), ("MailMaze", "td3")],
)
def test_policies_of_every_kind_act_as_in_the_engine(task: str, method: str) -> None:
    loaded, by = load_task(task), method_of(method)
    policy = by.policy(loaded, 0, by.settings_for(loaded, None))
    env: Any = gymnasium.make(environment_id(task)).unwrapped
    env.reset(seed=0)
    engine: Any = loaded.make(1, 0, policy.action_repeat)
    env.mirror_in(engine)
    player = policy.player(loaded, 1, np.random.SeedSequence((0, 0)))
    playing = Playing(policy, loaded, env, 0)
    for _ in range(15):
        chosen = player.act(engine)
        player.observe(engine, engine.step(chosen))
        for _ in range(policy.action_repeat):
            action = playing.act(env)
            np.testing.assert_allclose(action, chosen[0], atol=1e-4)
            assert env.action_space.contains(action)
            env.step(action)


def test_it_plays_other_tasks_of_its_domain_behind_wrappers(bundle: Path) -> None:
    policy = paddlectl.load(bundle)
    env = TimeLimit(gymnasium.make(MADE + "DoorBall-v0", max_steps=50), 40)
    env.reset(seed=0)
    assert env.action_space.contains(policy.act(env))


@pytest.mark.parametrize(
    ("made", "kind", "told"),
    [
        (
            lambda: gymnasium.make("CartPole-v1"),
            paddlectl.UsageError,
            "CartPoleEnv is no environment of a task",
        ),
        (
            lambda: gymnasium.make_vec(environment_id("BoxDoor"), 2),
            paddlectl.UsageError,
            "is no environment of",
        ),
        (lambda: gymnasium.make(environment_id("BoxDoor")), paddlectl.UsageError, "call its reset"),
        (lambda: gymnasium.make(environment_id("MailMaze")), paddlectl.IntegrityError, "minigrid policy"),
    ],
)
def test_what_it_cant_play(bundle: Path, made: Any, kind: Any, told: str) -> None:
    env = made()
    if "reset" not in told:
        env.reset(seed=0)
    with pytest.raises(kind, match=told) as caught:
        paddlectl.load(bundle).act(env)
    assert caught.value.hint


# Loading


def test_a_policy_by_task_id_or_file_is_the_same(place: Path, bundle: Path) -> None:
    found = [paddlectl.load(name) for name in ("BoxDoor", "policy-1", str(bundle), bundle)]
    assert len({(policy.task, policy.method, policy.program) for policy in found}) == 1
    assert found[0].figures["success_rate"] == 1.0
    assert "gt_box() :-" in str(found[0].program)
    assert repr(found[0]) == "<policy-1: BoxDoor by hdm, solves 100 %>"
    with Registry.open(place) as registry:
        assert len(registry.policies()) == 1, "a file isn't imported"


@pytest.mark.parametrize(
    ("name", "kind", "hint"),
    [
        ("BoxDor", paddlectl.NotFoundError, "did you mean BoxDoor"),
        ("policy-9", paddlectl.NotFoundError, "policy-1"),
        ("nowhere.zip", paddlectl.NotFoundError, ""),
        (Path("BoxDoor"), paddlectl.NotFoundError, ""),
    ],
)
def test_what_cant_be_loaded_tells_what_to_do(place: Path, name: Any, kind: Any, hint: str) -> None:
    with pytest.raises(kind) as caught:
        paddlectl.load(name)
    assert hint in caught.value.hint


def test_a_place_without_registry_isnt_made_by_looking(tmp_path: Path) -> None:
    for look in (lambda where: paddlectl.load("BoxDoor", registry=where), paddlectl.runs):
        with pytest.raises(paddlectl.NotFoundError):
            look(tmp_path / "none")
    assert not (tmp_path / "none").exists()


# Learning


class Learned(NamedTuple):
    """Two sources and what came of transfers, in a registry of their own."""

    place: Path
    sources: list[paddlectl.Result]
    transfers: list[paddlectl.Result]


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Learned]:
    place = tmp_path_factory.mktemp("learned") / "registry"
    with small(), mock.patch.object(runner, "budget_of", lambda job: job.frames or 1):
        first = paddlectl.train("BlockedDoor", frames=1, registry=place)
        transfers = [
            paddlectl.transfer(SCENARIO, frames=1, seed=2, registry=place, train_missing=True),
            paddlectl.transfer(ROOT / "scenarios" / "A.yaml", "hdm", frames=1, registry=str(place)),
        ]
        yield Learned(place, [first], transfers)


def test_a_result_tells_the_run_its_policy_and_figures(learned: Learned) -> None:
    with Registry.open(learned.place, create=False) as registry:
        for result in (*learned.sources, *learned.transfers):
            run = registry.run(result.run)
            assert (run.policy, run.frames, run.episodes) == (
                result.policy.id,
                result.frames,
                result.episodes,
            )
            assert result.figures == {name: run.results[name] for name in result.figures}
            assert result.figures["success_rate"] == registry.policy(result.policy.id).success_rate
            assert result.policy.program is not None
    own = {"jump_start", "final_score", "final_success", "area_under_curve"}
    assert learned.transfers[0].figures.keys() - learned.sources[0].figures.keys() == own


def test_a_transfer_trains_what_is_missing_and_nothing_else(learned: Learned) -> None:
    told = [(row["kind"], row["method"], row["task"], row["seed"]) for row in paddlectl.runs(learned.place)]
    assert told[::-1] == [
        ("train", "hdm", "BlockedDoor", 0),
        ("train", "hdm", "GapBall", 0),
        ("transfer", "paddle", TARGET, 2),
        ("transfer", "hdm", TARGET, 0),
    ]
    assert paddlectl.runs(learned.place)[1]["sources"] == "policy-1 policy-2"


def test_rows_of_runs_are_plain_and_alike(learned: Learned) -> None:
    found = paddlectl.runs(registry=learned.place)
    assert len({tuple(row) for row in found}) == 1
    assert {type(value) for row in found for value in row.values()} <= {str, int, float, type(None)}
    assert (
        found.to_dict()["run"] == [row["run"] for row in found.rows] == ["run-4", "run-3", "run-2", "run-1"]
    )
    assert paddlectl.runs(learned.place, limit=1).rows == found.rows[:1]
    assert type(found.rows) is list and json.dumps(found.rows)


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_rows_of_runs_are_a_table_elsewhere(learned: Learned, package: str) -> None:
    library, found = pytest.importorskip(package), paddlectl.runs(learned.place)
    for given in (found, found.rows, found.to_dict()):
        table = library.DataFrame(given)
        assert (len(table), list(table.columns)) == (len(found), list(found[0]))
        assert list(table["final_success"])[:2] == [row["final_success"] for row in found[:2]]


def test_progress_is_a_line_now_and_then(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with small():
        paddlectl.train("GapBall", frames=1, method="ppo", registry=tmp_path / "registry")
    out, err = capsys.readouterr()
    assert out == ""
    first, *_, last = err.splitlines()
    assert "are run instead of 1" in first and last.startswith("GapBall seed 0 (run-1): ")
    assert len(err.splitlines()) <= 3


def test_a_run_that_is_interrupted_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Checkpointer, "tell_of_rounds", interrupted)
    with pytest.raises(KeyboardInterrupt):
        paddlectl.train("GapBall", registry=tmp_path / "registry")
    assert "go on with: paddlectl resume run-1" in capsys.readouterr().err
    assert [row["status"] for row in paddlectl.runs(tmp_path / "registry")] == ["interrupted"]


@pytest.mark.parametrize(
    ("asked", "kind", "told"),
    [
        (lambda: paddlectl.train("BoxDor"), paddlectl.NotFoundError, "did you mean BoxDoor"),
        (lambda: paddlectl.train("BoxDoor", method="paddle"), paddlectl.UsageError, "reuses sources"),
        (lambda: paddlectl.train("BoxDoor", seed=-1), paddlectl.UsageError, "whole number"),
        (lambda: paddlectl.train("BoxDoor", frames=0), paddlectl.UsageError, "whole number"),
        (lambda: paddlectl.train("BoxDoor", frames=1.5), paddlectl.UsageError, "whole number"),  # type: ignore[arg-type]
        (
            lambda: paddlectl.transfer(SCENARIO),
            paddlectl.NotFoundError,
            "paddlectl train BlockedDoor GapBall",
        ),
        (lambda: paddlectl.transfer(SCENARIO, "padle"), paddlectl.UsageError, "paddle"),
        (lambda: paddlectl.transfer(SCENARIO, seed="0"), paddlectl.UsageError, "whole number"),  # type: ignore[arg-type]
        (lambda: paddlectl.transfer("nowhere.yaml"), paddlectl.NotFoundError, "no file"),
        (lambda: paddlectl.transfer({}), paddlectl.InvalidFileError, "the scenario: missing key 'name'"),
        (
            lambda: paddlectl.transfer(SCENARIO | {"target": "BoxDor"}),
            paddlectl.InvalidFileError,
            "the scenario: unknown task 'BoxDor'; did you mean 'BoxDoor'?",
        ),
        (
            lambda: paddlectl.transfer(SCENARIO | {"frames": float("nan")}),
            paddlectl.InvalidFileError,
            "the scenario: ",
        ),
        (lambda: paddlectl.transfer(SCENARIO | {"seeds": {1}}), paddlectl.InvalidFileError, "the scenario: "),
        (lambda: paddlectl.load("BoxDoor", seed=2**32), paddlectl.UsageError, "whole number"),
        (lambda: paddlectl.runs(limit=0), paddlectl.UsageError, "limit"),
    ],
)
def test_mistakes_are_told_before_anything_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: Any, kind: Any, told: str
) -> None:
    monkeypatch.setenv("PADDLECTL_REGISTRY", str(tmp_path / "registry"))
    with pytest.raises(kind) as caught:
        asked()
    assert told in str(caught.value)
    assert not (tmp_path / "registry").exists()
