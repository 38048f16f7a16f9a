"""Stable-Baselines3 on the Gymnasium environments, as its users run it; needs the extra `bench`."""

from functools import partial

import gymnasium
import numpy as np
import pytest
from minigrid.wrappers import FlatObsWrapper

from paddlectl.tasks.registration import environment_id

sb3 = pytest.importorskip("stable_baselines3", reason="the extra `bench` isn't installed")
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv  # noqa: E402  # if it is there


@pytest.mark.parametrize("kind", [DummyVecEnv, SubprocVecEnv])
@pytest.mark.parametrize("task", ["BoxDoor", "MailMaze"])
def test_its_vectors_of_environments(task: str, kind: type) -> None:
    name = f"paddlectl.tasks.registration:{environment_id(task)}"
    several = kind([partial(gymnasium.make, name, max_steps=5)] * 2)
    several.seed(0)
    several.reset()
    several.action_space.seed(0)
    for t in range(1, 11):
        _, reward, done, infos = several.step(np.array([several.action_space.sample() for _ in range(2)]))
        assert done.tolist() == [t % 5 == 0] * 2
        assert [info["TimeLimit.truncated"] for info in infos] == done.tolist()
        assert np.isfinite(reward).all()
    several.close()


def test_ppo_learns_from_flat_observations() -> None:
    env = FlatObsWrapper(gymnasium.make(environment_id("BoxDoor")))
    model = sb3.PPO("MlpPolicy", env, n_steps=128, n_epochs=1, seed=0, device="cpu").learn(256)
    assert model.num_timesteps == 256


def test_td3_learns_the_maze() -> None:
    env = gymnasium.make(environment_id("MailMaze"), max_steps=100)
    model = sb3.TD3("MlpPolicy", env, learning_starts=100, seed=0, device="cpu").learn(250)
    assert model.num_timesteps == 250
