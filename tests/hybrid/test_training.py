"""Training is a function of its seed; evaluation plays the first layouts once each."""

import tracemalloc
from collections import deque

import numpy as np
import pytest
import torch

from paddlectl.hybrid import training
from paddlectl.hybrid.policy import HybridPolicy, HybridSettings
from paddlectl.hybrid.rollout import Decisions, Episode
from paddlectl.learners.ppo import PPOSettings
from scripted import GT_END, GT_TWO, HORIZON, RIGHT, STAY, TASK, ByScript

SMALL = HybridSettings(lanes=4, block=16, low_level=PPOSettings(epochs=1))


def train(seed, frames=320):
    policy = HybridPolicy(TASK, seed, SMALL)
    rounds = list(training.train(policy, seed, frames))
    return policy.state(), rounds


def plain(rounds):
    """The rounds as values that can be compared."""
    return [
        (round_.frames, [(*e[:5], *(column.tolist() for column in e.decisions)) for e in round_.episodes])
        for round_ in rounds
    ]


def test_training_is_a_function_of_its_seed():
    one, rounds = train(3)
    torch.manual_seed(99)
    np.random.seed(99)  # neither global generator plays a part
    same, same_rounds = train(3)
    assert plain(rounds) == plain(same_rounds)
    assert all(torch.equal(one[name], same[name]) for name in one)
    other, other_rounds = train(4)
    assert plain(rounds) != plain(other_rounds)
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
    result = training.evaluate(walker(), TASK, episodes, 2)
    assert result.episodes == episodes
    assert result.success_rate == pytest.approx(solvable.mean())
    assert result.mean_score == pytest.approx(scores.mean())
    assert result.mean_length == pytest.approx(lengths.mean())


@pytest.mark.parametrize("lanes", [1, 3, 7, 50])
def test_the_layouts_are_the_same_however_many_are_played_side_by_side(lanes, monkeypatch):
    # what happens in a layout is by script here, so that its figures tell which one it was
    together = training.evaluate(walker(), TASK, 50, 2)
    monkeypatch.setattr(training, "LANES", lanes)
    assert training.evaluate(walker(), TASK, 50, 2) == together


def peak(episodes):
    """Bytes in use at most."""
    policy = walker()
    policy.low_level.seen = deque(maxlen=1)
    tracemalloc.start()
    try:
        training.evaluate(policy, TASK, episodes, 2)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_is_that_of_the_episodes_side_by_side(monkeypatch):
    monkeypatch.setattr(training, "LANES", 100)
    peak(1)
    assert peak(6000) < 1.2 * peak(1000)


def test_the_blocks_of_an_evaluation_play_no_part(monkeypatch):
    monkeypatch.setattr(training, "LANES", 7)
    policy, found = HybridPolicy(TASK, 0, SMALL), []
    for steps in (5, 32):
        buffer = training._buffer
        monkeypatch.setattr(
            training, "_buffer", lambda _, environment, s=steps, make=buffer: make(s, environment)
        )
        found.append(training.evaluate(policy, TASK, 40, 1))
    assert found[0] == found[1]


def test_evaluation_gives_the_program_of_the_scenes_that_were_visited():
    everywhere = training.evaluate(walker(), TASK, 5, 0)
    assert [clause.head for clause in everywhere.program.clauses] == [GT_END, GT_TWO, GT_END]
    assert everywhere.program.probabilities == pytest.approx([0.6, 0.35, 0.94])
    assert everywhere.crispness == pytest.approx(0.6)
    at_home = training.evaluate(walker(STAY), TASK, 5, 0)
    assert at_home.program.clauses == everywhere.program.clauses[:2]
    assert (at_home.success_rate, at_home.mean_length) == (0.0, HORIZON)


def test_evaluation_learns_nothing_and_repeats_itself():
    policy = HybridPolicy(TASK, 0, SMALL)
    before = {name: tensor.clone() for name, tensor in policy.state().items()}
    training.evaluate(policy, TASK, 6, 1)
    assert all(torch.equal(before[name], tensor) for name, tensor in policy.state().items())
    fresh = [training.evaluate(HybridPolicy(TASK, 0, SMALL), TASK, 6, 1) for _ in range(2)]
    assert fresh[0] == fresh[1]


def episode(scenes):
    return Episode(0, 0, 9, 0.5, 9, Decisions.empty(len(scenes))._replace(scenes=np.array(scenes)))


def test_visits_count_episodes_not_decisions():
    visits = training.scene_visits([episode([0, 0, 1]), episode([0]), episode([0, 0])], 3)
    assert visits.tolist() == [3, 1, 0]


def test_crispness_is_over_the_scenes_on_the_path():
    policy = walker()
    assert training.crispness(policy, np.array([1.0, 1.0])) == pytest.approx(0.6)
    assert training.crispness(policy, np.array([0.04, 1.0])) == pytest.approx(0.94)
    assert training.crispness(policy, np.array([0.05, 0.0])) == pytest.approx(0.6)
    assert training.crispness(policy, np.array([0.0, 0.0])) == 0.0
