"""What each task's Gymnasium environment promises to whoever makes it by its name."""

import copy
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from paddlectl.tasks import registration, suite
from paddlectl.tasks.maze2d.layouts import PLACES
from paddlectl.tasks.minigrid.grid import Action
from paddlectl.tasks.minigrid.layouts import SPECS, draw_layouts
from paddlectl.tasks.registration import environment_id
from planner import shortest_plan
from samples import ROOT

TASKS = pytest.mark.parametrize("task", registration.ENTRY_POINTS)
ONE_OF_EACH = pytest.mark.parametrize("task", ["BoxDoor", "MailMaze"])
IDLE = {"minigrid": int(Action.DROP), "maze2d": np.zeros(2, np.float32)}


def made(task: str, **kwargs: Any) -> gymnasium.Env:
    return gymnasium.make(environment_id(task), **kwargs)


def idle(task: str) -> Any:
    return IDLE["minigrid" if task in SPECS else "maze2d"]


def flat(value: Any) -> list[Any]:
    """What an observation, or a whole step, consists of."""
    if isinstance(value, dict):
        return [part for key in sorted(value) for part in flat(value[key])]
    if isinstance(value, tuple):
        return [part for item in value for part in flat(item)]
    return [value.tolist() if isinstance(value, np.ndarray) else value]


def played(env: gymnasium.Env, actions: list[Any]) -> list[Any]:
    """All that is seen of these steps; an ended episode is followed by the next."""
    seen = []
    for action in actions:
        step = env.step(action)
        seen.append(flat(step))
        if step[2] or step[3]:
            seen.append(flat(env.reset()))
    return seen


def drawn(env: gymnasium.Env, count: int) -> list[Any]:
    env.action_space.seed(5)
    return [env.action_space.sample() for _ in range(count)]


def in_a_process(code: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    line = [sys.executable, "-c", code]
    return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)


ALL_BY_NAME = """
import sys
import gymnasium
made = [gymnasium.make(f"paddlectl.tasks.registration:paddle/{{task}}-v0") for task in {tasks}]
several = [gymnasium.make_vec(f"paddle/{{task}}-v0", num_envs=2) for task in {tasks}]
for env in made + several:
    env.reset(seed=0)
assert "torch" not in sys.modules
"""
REGISTERED = """
import sys
import paddlectl.tasks.registration
assert not {"torch", "minigrid", "gymnasium_robotics", "mujoco"} & sys.modules.keys()
"""
WITHOUT = """
import sys
class Without:
    def find_spec(name, path=None, target=None):
        if name == {package!r}:
            raise ModuleNotFoundError(name=name)
sys.meta_path.insert(0, Without)
import gymnasium
gymnasium.make("paddlectl.tasks.registration:paddle/BoxDoor-v0")
gymnasium.make("paddle/MailMaze-v0")
"""


def test_gymnasium_makes_all_by_name_and_imports_nothing_of_ours_before() -> None:
    done = in_a_process(ALL_BY_NAME.format(tasks=tuple(registration.ENTRY_POINTS)))
    assert done.returncode == 0, done.stderr


def test_registering_loads_no_environment() -> None:
    done = in_a_process(REGISTERED)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("package", ["gymnasium_robotics", "mujoco"])
def test_without_its_extra_the_maze_says_what_is_missing_in_one_line(package: str) -> None:
    done = in_a_process(WITHOUT.format(package=package))
    assert done.stderr.splitlines()[-1] == (
        f"gymnasium.error.DependencyNotInstalled: the maze needs {package}, which isn't installed; "
        "run: pip install 'paddlectl[maze]'"
    )


@pytest.mark.parametrize("module", ["registration", "minigrid.env", "maze2d.env"])
def test_any_of_our_modules_may_stand_before_a_name(module: str) -> None:
    for task in ("BoxDoor", "MailMaze"):
        assert gymnasium.make(f"paddlectl.tasks.{module}:{environment_id(task)}").spec


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@TASKS
def test_a_copy_goes_on_as_the_original_does(task: str, copied: Callable[[Any], Any]) -> None:
    """In the midst of an episode, over the ends of some; and the original as if there were no copy."""
    one, twin = made(task, max_steps=30), made(task, max_steps=30)
    actions = drawn(one, 120)
    for env in (one, twin):
        env.reset(seed=3)
        played(env, actions[:40])
    other = copied(one)
    expected = played(twin, actions[40:])
    assert played(other, actions[40:]) == expected
    assert played(one, actions[40:]) == expected
    assert other.unwrapped.spec == one.unwrapped.spec


@TASKS
def test_a_copy_of_what_was_never_reset(task: str) -> None:
    env = made(task)
    other = copy.deepcopy(env)
    assert flat(other.reset(seed=4)) == flat(env.reset(seed=4))


def test_a_copy_has_no_window_of_the_original(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = made("BoxDoor", render_mode="human")
    env.reset(seed=0)
    other = copy.deepcopy(env)
    assert (env.unwrapped.window is None, other.unwrapped.window is None) == (False, True)
    other.step(0)
    env.close()
    other.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
@ONE_OF_EACH
def test_several_at_once_see_what_each_sees_alone(task: str, mode: str) -> None:
    several = gymnasium.make_vec(environment_id(task), 2, mode)
    single = [made(task) for _ in range(2)]
    several.action_space.seed(0)

    def lanes(observation: Any) -> list[Any]:
        if isinstance(observation, dict):
            return [[flat(observation[key][i]) for key in sorted(observation)] for i in range(2)]
        return [[flat(observation[i])] for i in range(2)]

    def alone(observations: list[Any]) -> list[Any]:
        return [
            [flat(o[key]) for key in sorted(o)] if isinstance(o, dict) else [flat(o)] for o in observations
        ]

    assert lanes(several.reset(seed=8)[0]) == alone([e.reset(seed=8 + i)[0] for i, e in enumerate(single)])
    for _ in range(20):
        actions = several.action_space.sample()
        observation, reward, *_ = several.step(actions)
        steps = [env.step(action) for env, action in zip(single, actions, strict=True)]
        assert lanes(observation) == alone([step[0] for step in steps])
        assert reward.tolist() == [step[1] for step in steps]
    several.close()


@pytest.mark.parametrize(
    ("kwargs", "limit"),
    [
        ({"max_steps": 7}, 7),
        ({"max_steps": 1}, 1),
        ({"max_steps": np.int64(7)}, 7),
        ({"max_steps": 1100}, 1100),
        ({"max_episode_steps": 7}, 7),
        ({"max_steps": 9, "max_episode_steps": 7}, 7),
        ({}, None),
    ],
)
@ONE_OF_EACH
def test_an_episode_lasts_as_long_as_is_told(task: str, kwargs: dict[str, Any], limit: int | None) -> None:
    env = made(task, **kwargs)
    limit = limit or suite.load(task).horizon
    assert env.spec is not None
    assert env.spec.max_episode_steps == limit
    for again in (env, gymnasium.make(env.spec)):
        again.reset(seed=0)
        ends = [again.step(idle(task))[2:4] for _ in range(limit)]
        assert ends == [(False, False)] * (limit - 1) + [(False, True)]
        assert again.spec.max_episode_steps == limit


@TASKS
def test_every_spec_tells_the_horizon(task: str) -> None:
    assert made(task).spec.max_episode_steps == suite.load(task).horizon


def test_the_last_step_can_still_solve_it() -> None:
    layouts = draw_layouts(SPECS["BoxDoor"], np.random.default_rng(3), 1)
    plan = shortest_plan(SPECS["BoxDoor"], layouts)
    grid, maze = made("BoxDoor", max_steps=len(plan)), made("MailMaze", max_steps=1)
    grid.reset(seed=0)
    grid.unwrapped.place(layouts)
    maze.reset(seed=0)
    maze.unwrapped.place(PLACES[4])
    maze.unwrapped.delivered.add(maze.unwrapped._things[0][0])
    for last in ([grid.step(action) for action in plan][-1], maze.step(idle("MailMaze"))):
        assert last[2:4] == (True, False)
    assert last[4]["score"] == pytest.approx(10.0)  # 100 (1 - 0.9)


@pytest.mark.parametrize("wrong", [0, -1, 2.5, "7", None])
@ONE_OF_EACH
def test_an_episode_without_steps_is_refused(task: str, wrong: Any) -> None:
    with pytest.raises(ValueError, match="max_steps is a whole number from 1 on, not"):
        made(task, max_steps=wrong)


@TASKS
def test_an_unknown_split_is_refused(task: str) -> None:
    told = "a split is training or evaluation, not 'test'"
    with pytest.raises(ValueError, match=told):
        made(task, split="test")
    with pytest.raises(ValueError, match=told):
        suite.load(task).make(1, 0, split="test")


WRONG_ACTIONS = {
    "BoxDoor": (-1, 7, 2**70, 2.0, np.float32(1), np.nan, np.inf, None, "0", True, [1], [[1]], [1, 2]),
    "MailMaze": (
        *([np.nan, 0], [0, np.inf], [0, -np.inf], [1.5, 0], [0, -1.001], [2, 0], [-(2**63), 0]),
        *(0.5, [], [0.5], [0.5] * 3, [[0.5, 0.5]], [[0.5], [0.5, 0.5]], None, "ab", ["a", "b"]),
        *([True, False], [1j, 0]),
    ),
}


@pytest.mark.parametrize(
    ("task", "action"), [(task, action) for task, wrong in WRONG_ACTIONS.items() for action in wrong]
)
def test_a_wrong_action_is_refused_by_both_faces_alike(task: str, action: Any) -> None:
    env, engine = made(task), suite.load(task).make(2, 0)
    env.reset(seed=0)
    told = []
    for step, given in ((env.step, action), (engine.step, [action] * 2)):
        with pytest.raises(ValueError, match="actions are ") as error:
            step(given)
        assert "\n" not in str(error.value)
        told.append(str(error.value).split(" of shape")[0].split(", not")[0])
    assert len(set(told)) == 1
    assert engine.t.tolist() == [0, 0]
    assert (env.unwrapped.step_count if task in SPECS else env.unwrapped.t) == 0


@pytest.mark.parametrize(
    ("task", "actions"),
    [
        ("BoxDoor", np.array([0, 7])),
        ("BoxDoor", np.zeros((2, 1), np.intp)),
        ("BoxDoor", np.zeros(3, np.intp)),
        ("MailMaze", np.array([[0, 0], [0, np.nan]])),
        ("MailMaze", np.zeros((3, 2))),
    ],
)
def test_one_wrong_lane_is_enough(task: str, actions: np.ndarray) -> None:
    engine = suite.load(task).make(2, 0)
    with pytest.raises(ValueError, match="actions are "):
        engine.step(actions)
    assert engine.t.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("task", "action"),
    [
        *(("BoxDoor", action) for action in (1, Action.RIGHT, np.array(1), np.int8(1), np.uint64(1))),
        *(("MailMaze", action) for action in ([1, 0], (1.0, 0.0), np.array([1.0, 0.0]), np.float32([1, 0]))),
    ],
)
def test_a_right_action_may_come_in_any_type(task: str, action: Any) -> None:
    env, plain = made(task), made(task)
    seen = []
    for each, given in ((env, action), (plain, 1 if task in SPECS else np.array([1.0, 0.0], np.float32))):
        each.reset(seed=0)
        seen.append(flat(each.step(given)))
    assert seen[0] == seen[1]


@TASKS
def test_seeds_lead_on_and_nobody_else_s_generator_is_touched(task: str) -> None:
    """Also what comes after a seeded episode is the same; options change nothing."""
    before = np.random.get_state()[1].tolist()
    one, other = made(task), made(task, render_mode="rgb_array")
    assert flat(one.reset(seed=1)) == flat(other.reset(seed=1, options={"anything": 1}))
    follow = [[flat(env.reset()) for _ in range(8)] for env in (one, other)]
    assert follow[0] == follow[1]
    assert len({str(seen) for seen in follow[0]}) > 1
    other.step(idle(task))
    other.render()
    copy.deepcopy(other)
    assert np.random.get_state()[1].tolist() == before


@TASKS
def test_what_is_not_to_be_drawn_is_not(task: str) -> None:
    env, films = made(task), made(task, render_mode="rgb_array_list")
    env.reset(seed=0)
    films.reset(seed=0)
    films.step(idle(task))
    assert env.render() is None
    assert [frame.dtype for frame in films.render()] == [np.uint8] * 2
    for each in (env, films):
        each.close()
        each.close()


def test_nothing_stays_in_the_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    env = made("MailMaze")
    env.reset(seed=0)
    copy.deepcopy(env).close()
    suite.load("MailMaze").make(2, 0)
    assert list(tmp_path.iterdir()) == []
