"""The MiniGrid face under Gymnasium."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from paddlectl.tasks.minigrid.env import PaddleEnv
from paddlectl.tasks.minigrid.grid import Action, Thing
from paddlectl.tasks.minigrid.layouts import HORIZON, SPECS, draw_layouts
from paddlectl.tasks.registration import environment_id
from planner import shortest_plan

TASKS = tuple(SPECS)


@pytest.mark.parametrize("task", TASKS)
def test_gymnasium_finds_nothing_wrong(task):
    env = gymnasium.make(environment_id(task), render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
        env.reset(seed=0)
        assert env.render().shape == (8 * 32, 15 * 32, 3)
    assert env.action_space == gymnasium.spaces.Discrete(7)


@pytest.mark.parametrize("task", TASKS)
def test_a_plan_solves_it(task):
    env = gymnasium.make(environment_id(task))
    env.reset(seed=3)
    layouts = draw_layouts(SPECS[task], np.random.default_rng(3), 1)
    env.unwrapped.place(layouts)
    plan = shortest_plan(SPECS[task], layouts)
    steps = [env.step(action) for action in plan]
    assert [terminated for _, _, terminated, _, _ in steps] == [False] * (len(plan) - 1) + [True]
    assert steps[-1][4]["score"] == pytest.approx(1 - 0.9 * len(plan) / HORIZON)
    milestones = sum(reward for _, reward, *_ in steps) - steps[-1][4]["score"]
    assert milestones == pytest.approx(0.1 * len(SPECS[task].milestones))


@pytest.mark.parametrize("task", TASKS)
def test_equal_seeds_draw_equal_layouts(task):
    one, two = PaddleEnv(task), PaddleEnv(task)
    pictures = []
    for env in (one, two):
        env.reset(seed=11)
        pictures.append((env.grid.encode().tobytes(), env.agent_pos, env.agent_dir))
    assert pictures[0] == pictures[1]
    two.reset(seed=12)
    assert (two.grid.encode().tobytes(), two.agent_pos, two.agent_dir) != pictures[0]


def test_idle_hands_run_out_of_time():
    env = gymnasium.make(environment_id("BoxDoor"))
    env.reset(seed=0)
    ends = [env.step(Action.DROP)[2:4] for _ in range(HORIZON)]
    assert ends == [(False, False)] * (HORIZON - 1) + [(False, True)]


def test_sparse_variant_pays_success_alone():
    env = PaddleEnv("DoorBall", milestone_reward=0.0)
    layouts = draw_layouts(SPECS["DoorBall"], np.random.default_rng(0), 1)
    env.reset(seed=0)
    env.place(layouts)
    plan = shortest_plan(SPECS["DoorBall"], layouts)
    rewards = [env.step(action)[1] for action in plan]
    assert rewards[:-1] == [0.0] * (len(plan) - 1)
    assert rewards[-1] > 0.9


def test_a_tile_with_its_ball_looks_different():
    env = PaddleEnv("BlockedBoxPlaceGoal", render_mode="rgb_array")
    env.reset(seed=0)
    tile, ball = env._objects[Thing.YELLOW_TILE], env._objects[Thing.BLOCKAGE]
    before, seen = env.render(), tile.encode()
    tile.contains = ball
    assert tile.encode() != seen
    assert not np.array_equal(env.render(), before)
