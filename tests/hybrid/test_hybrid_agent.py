"""The hybrid model's training is a function of its seed, and both levels learn by it."""

import numpy as np
import torch

from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.ppo import PPOSettings
from paddlectl.methods.base import Setup
from paddlectl.methods.hdm import HDM
from scripted import TASK, learning

SMALL = HybridSettings(num_envs=4, rollout_steps=16, low_level=PPOSettings(epochs=1))


def train(seed, frames=320):
    made = learning(HDM, Setup(TASK, SMALL, seed, frames))
    rounds = list(made)
    return made.agent.policy().state(), rounds


def test_training_is_a_function_of_its_seed():
    one, rounds = train(3)
    torch.manual_seed(99)
    np.random.seed(99)  # neither global generator plays a part
    same, same_rounds = train(3)
    assert rounds == same_rounds
    assert all(torch.equal(one[name], same[name]) for name in one)
    other, other_rounds = train(4)
    assert rounds != other_rounds
    assert not torch.equal(one["actor.6.weight"], other["actor.6.weight"])


def test_training_stays_within_its_frames():
    _, rounds = train(0, frames=130)
    assert [round_.frames for round_ in rounds] == [64, 128]
    assert sum(len(round_.episodes) for round_ in rounds) >= 2 * 4
    orders = sorted(episode.order for round_ in rounds for episode in round_.episodes)
    assert len(set(orders)) == len(orders)


def test_training_learns_from_both_levels():
    before = HybridPolicy(TASK, 3, SMALL).state()
    after, _ = train(3)
    assert not torch.equal(before["clauses.weights"], after["clauses.weights"])
    assert not torch.equal(before["actor.6.weight"], after["actor.6.weight"])
    assert not torch.equal(before["critic.6.weight"], after["critic.6.weight"])


def test_crispness_is_told_of_the_scenes_that_episodes_came_through():
    _, rounds = train(0)
    assert all(0.0 <= round_.figures["crispness"] <= 1.0 for round_ in rounds)
    first = next(number for number, round_ in enumerate(rounds) if round_.episodes)
    assert [round_.figures["crispness"] for round_ in rounds[:first]] == [0.0] * first
    assert all(round_.figures["crispness"] > 0 for round_ in rounds[first:])
