"""An engine that is brought into the states of an environment, beside one that is stepped itself."""

import numpy as np
import pytest

from paddlectl.tasks.maze2d import engine as maze2d
from paddlectl.tasks.maze2d.env import PaddleMazeEnv
from paddlectl.tasks.maze2d.layouts import SPECS as MAZES
from paddlectl.tasks.maze2d.layouts import draw_starts
from paddlectl.tasks.minigrid import engine as minigrid
from paddlectl.tasks.minigrid.env import PaddleEnv
from paddlectl.tasks.minigrid.layouts import SPECS, draw_layouts
from planner import shortest_plan
from walker import Walker

ERRANDS = {"CoffeeMaze": (0, 1, 4), "CoffeeMailMaze": (0, 2, 3, 1, 4)}
REPEAT = 20


def seen(engine, subgoals):
    """All that an engine shows."""
    numbers = np.arange(subgoals)[:, None]
    asked = [getattr(engine, name) for name in ("observe", "reached", "available", "distance")]
    return [engine.t, engine.valuation(), engine.flat_state(), *(ask(n) for n in numbers for ask in asked)]


@pytest.mark.parametrize("task", SPECS)
def test_in_minigrid_it_shows_the_same(task):
    """Along a shortest plan, which meets all that can happen to things, and then at random."""
    spec, rng = SPECS[task], np.random.default_rng(0)
    layouts = draw_layouts(spec, rng, 3)
    env, mirror = PaddleEnv(task), minigrid.Engine(spec, 1, 0)
    for lane in range(3):
        env.place(layouts, lane)
        own = minigrid.Engine(spec, 1, 0)
        own.set_layouts(type(layouts)(*(values[lane : lane + 1] for values in layouts)))
        plan = shortest_plan(spec, layouts, lane)[: -lane or None]
        for action in [*plan, *rng.integers(7, size=60)]:
            env.mirror_in(mirror)
            for ours, theirs in zip(seen(mirror, 10), seen(own, 10), strict=True):
                np.testing.assert_array_equal(ours, theirs)
            *_, terminated, truncated = env.advance(int(action))
            own.step(np.array([action]))
            if terminated or truncated:
                break


@pytest.mark.parametrize("task", ERRANDS)
def test_in_the_maze_it_shows_the_same_whenever_an_action_ends(task):
    start = draw_starts(np.random.default_rng(0), 1)
    env, walker = PaddleMazeEnv(task), Walker(*ERRANDS[task])
    env.reset(seed=0)
    own, mirror = (maze2d.Engine(MAZES[task], 1, 0, action_repeat=REPEAT) for _ in range(2))
    env.place(start[0])
    own.set_starts(start)
    done, touched = False, 0
    while not done:
        env.mirror_in(mirror)
        touched += mirror.touched.any()
        np.testing.assert_array_equal(mirror.touched, own.touched)
        for ours, theirs in zip(seen(mirror, 5), seen(own, 5), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-6)
        forces = walker.act(own)
        own.step(forces)
        for _ in range(REPEAT):
            *_, terminated, truncated = env.advance(forces[0])
            done = terminated or truncated
            if done:
                break
            env.mirror_in(mirror)
    assert touched > 3
