"""Both faces of the maze tasks, step by step from the same starts with the same forces.

Half of the forces bring the ball on its way through the task, half are random and drive it into walls.
"""

import numpy as np
import pytest

from paddlectl.tasks.maze2d.engine import Engine
from paddlectl.tasks.maze2d.env import PaddleMazeEnv
from paddlectl.tasks.maze2d.layouts import HORIZON, SPECS, draw_starts
from walker import Walker

EPISODES = 4
ERRANDS = {"CoffeeMaze": (0, 1, 4), "MailMaze": (2, 3, 4), "CoffeeMailMaze": (0, 2, 3, 1, 4)}


def touches_a_wall(env: PaddleMazeEnv) -> bool:
    """More than the one contact with the ground that there always is."""
    return env._point.data.ncon > 1


@pytest.mark.parametrize("task", SPECS)
def test_both_faces_agree(task):
    """4 episodes, a good 10,000 steps over the three tasks."""
    rng = np.random.default_rng(0)
    env = PaddleMazeEnv(task)
    env.reset(seed=0)
    contacts, ends = 0, []
    for episode in range(EPISODES):
        engine = Engine(SPECS[task], 1, 0, action_repeat=1)
        start = draw_starts(rng, 1)
        engine.set_starts(start)
        env.place(start[0])
        walker = Walker(*ERRANDS[task])
        for t in range(HORIZON):
            if t % 25 == 0:
                push = rng.uniform(-1.5, 1.5, (1, 2)).clip(-1.0, 1.0).astype(np.float32)
            forces = push if episode % 2 else walker.act(engine)
            step = engine.step(forces)
            reward, score, terminated, truncated = env.advance(forces[0])
            contacts += touches_a_wall(env)
            assert env.observation() in env.observation_space
            np.testing.assert_allclose(engine.masses.position[0], env.position, rtol=0, atol=1e-9)
            assert (engine.t[0], bool(step.terminated[0]), bool(step.truncated[0])) == (
                env.t,
                terminated,
                truncated,
            )
            assert step.reward[0] == pytest.approx(reward)
            assert step.score[0] == pytest.approx(score)
            np.testing.assert_array_equal(
                env.observation()[4:], [(engine.facts[0] >> bit) & 1 for bit in range(4)]
            )
            if terminated or truncated:
                break
        ends.append(env.t)
        assert terminated or truncated
    assert contacts > 500, "hardly any wall was touched"
    assert min(ends) < HORIZON, "the task was never solved"
