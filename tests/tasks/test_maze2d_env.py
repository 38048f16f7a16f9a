"""The maze as Gymnasium environments: registered, well-behaved, drawn without a display."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from paddlectl.tasks.maze2d.env import PaddleMazeEnv
from paddlectl.tasks.maze2d.layouts import PLACES, SPECS
from paddlectl.tasks.registration import environment_id

TASKS = pytest.mark.parametrize("task", SPECS)


@TASKS
def test_gymnasium_s_own_checker_has_nothing_to_say(task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(environment_id(task), render_mode="rgb_array").unwrapped)


def test_equal_seeds_give_equal_starts():
    env = PaddleMazeEnv("CoffeeMaze")
    starts = [env.reset(seed=seed)[0] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(starts[0], starts[1])
    assert (starts[0] != starts[2]).any()


def test_the_picture_shows_the_ball_where_it_is():
    env = PaddleMazeEnv("MailMaze", render_mode="rgb_array")
    env.reset(seed=0)
    env.place(np.array([4.5, 3.0]))  # the upper right corner
    picture = env.render()
    assert picture.shape == (288, 384, 3)
    green = np.argwhere((picture == (40, 150, 70)).all(-1))
    np.testing.assert_allclose(green.mean(0), [1.5 * 32, 10.5 * 32], atol=1)


def test_what_is_carried_is_drawn_on_the_ball_and_no_more_where_it_lay():
    env = PaddleMazeEnv("CoffeeMaze", render_mode="rgb_array")
    env.reset(seed=0)
    brown = [(env.render() == (121, 72, 32)).all(-1).sum()]
    env.place(PLACES[0])
    env.advance(np.zeros(2))
    assert env.held
    brown.append((env.render() == (121, 72, 32)).all(-1).sum())
    assert 0 < brown[1] < brown[0]
