"""Evaluation plays the first layouts once each, and learns nothing."""

import tracemalloc
from collections import deque

import numpy as np
import pytest
import torch

from paddlectl.agents import evaluation
from paddlectl.agents.evaluation import evaluate
from paddlectl.agents.flat import FlatPolicy, FlatSettings
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.ppo import PPOSettings
from scripted import GT_END, GT_TWO, HORIZON, RIGHT, STAY, TASK, ByScript

SMALL = HybridSettings(num_envs=4, rollout_steps=16, low_level=PPOSettings(epochs=1))


def walker(action=RIGHT):
    policy = HybridPolicy(TASK, 0, SMALL)
    with torch.no_grad():
        policy.clauses.weights.copy_(torch.tensor([[0.6, 0.35, 0.05], [0.94, 0.03, 0.03]]).log())
    policy.low_level = ByScript(action)
    return policy


@pytest.mark.parametrize("episodes", [1, 7, 20])
def test_evaluation_plays_the_first_layouts_once_each(episodes):
    # layouts 2000, 2001, …: they end at cell 5 + n % 3, score 0.5 + (n % 100) / 200; 2009 can't be solved
    layouts = 2000 + np.arange(episodes)
    solvable = layouts % 10 != 9
    scores = np.where(solvable, 0.5 + layouts % 100 / 200, 0.0)
    lengths = np.where(solvable, 5 + layouts % 3, HORIZON)
    result = evaluate(walker(), TASK, episodes, 2)
    assert result.episodes == episodes
    assert result.success_rate == pytest.approx(solvable.mean())
    assert result.mean_score == pytest.approx(scores.mean())
    assert result.mean_length == pytest.approx(lengths.mean())


@pytest.mark.parametrize("num_envs", [1, 3, 7, 50])
def test_the_layouts_are_the_same_however_many_are_played_side_by_side(num_envs, monkeypatch):
    # what happens in a layout is by script here, so that its figures tell which one it was
    together = evaluate(walker(), TASK, 50, 2)
    monkeypatch.setattr(evaluation, "MOST_ENVS", num_envs)
    assert evaluate(walker(), TASK, 50, 2) == together


def peak(episodes):
    """Bytes in use at most."""
    policy = walker()
    policy.low_level.seen = deque(maxlen=1)
    tracemalloc.start()
    try:
        evaluate(policy, TASK, episodes, 2)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_is_that_of_the_episodes_side_by_side(monkeypatch):
    monkeypatch.setattr(evaluation, "MOST_ENVS", 100)
    peak(1)
    assert peak(6000) < peak(1000) + 250_000  # 5,000 episodes more are a million bytes


def test_the_buffer_of_a_player_plays_no_part(monkeypatch):
    monkeypatch.setattr(evaluation, "MOST_ENVS", 7)
    policy, found = HybridPolicy(TASK, 0, SMALL), []
    buffer = policy.buffer
    for steps in (1, 5, 32):
        monkeypatch.setattr(policy, "buffer", lambda _, num_envs, steps=steps: buffer(steps, num_envs))
        found.append(evaluate(policy, TASK, 40, 1))
    assert found[0] == found[1] == found[2]


def test_evaluation_gives_the_program_of_the_scenes_that_were_visited():
    everywhere = evaluate(walker(), TASK, 5, 0)
    assert [clause.head for clause in everywhere.program.clauses] == [GT_END, GT_TWO, GT_END]
    assert everywhere.program.probabilities == pytest.approx([0.6, 0.35, 0.94])
    assert everywhere.crispness == pytest.approx(0.6)
    at_home = evaluate(walker(STAY), TASK, 5, 0)
    assert at_home.program.clauses == everywhere.program.clauses[:2]
    assert (at_home.success_rate, at_home.mean_length) == (0.0, HORIZON)


def test_evaluation_learns_nothing_and_repeats_itself():
    policy = HybridPolicy(TASK, 0, SMALL)
    before = {name: tensor.clone() for name, tensor in policy.state().items()}
    evaluate(policy, TASK, 6, 1)
    assert all(torch.equal(before[name], tensor) for name, tensor in policy.state().items())
    fresh = [evaluate(HybridPolicy(TASK, 0, SMALL), TASK, 6, 1) for _ in range(2)]
    assert fresh[0] == fresh[1]


def test_crispness_is_over_the_scenes_on_the_path():
    policy = walker()
    assert policy.crispness(np.array([1.0, 1.0])) == pytest.approx(0.6)
    assert policy.crispness(np.array([0.04, 1.0])) == pytest.approx(0.94)
    assert policy.crispness(np.array([0.05, 0.0])) == pytest.approx(0.6)
    assert policy.crispness(np.array([0.0, 0.0])) == 0.0


def test_scenes_are_counted_by_the_episodes_that_came_through_them(monkeypatch):
    policy, told = walker(), []
    monkeypatch.setattr(policy, "played_program", lambda *given: told.append(given) or (None, None))
    evaluate(policy, TASK, 7, 2)
    policy.low_level = ByScript(STAY)
    evaluate(policy, TASK, 7, 2)  # many a decision, but in one scene
    assert [(passed.tolist(), episodes) for passed, episodes in told] == [([7, 7], 7), ([7, 0], 7)]


def test_a_policy_without_clauses_has_figures_but_no_program():
    policy = FlatPolicy(TASK, 0, FlatSettings())
    policy.learner = ByScript(RIGHT)
    found = evaluate(policy, TASK, 3, 2)
    assert (found.program, found.crispness) == (None, None)
    assert (found.success_rate, found.mean_length) == (1.0, 6.0)  # layouts 2000 to 2002
