"""DQN: its targets worked by hand, its choices, and that it learns."""

import numpy as np
import pytest
import torch

from paddlectl.learners.dqn import DQN, Batch, DQNSettings, StepDQNSettings


def tabular(values, slow=None):
    """A DQN over one-hot states with these Q-values. [S, A]"""
    learner = DQN(len(values), len(values[0]), 0, DQNSettings())
    for network, table in ((learner.online, values), (learner.slow, slow or values)):
        for layer in network:
            if isinstance(layer, torch.nn.Linear):
                torch.nn.init.zeros_(layer.weight)
        with torch.no_grad():
            for layer in network[:-1]:
                if isinstance(layer, torch.nn.Linear):
                    layer.weight.fill_diagonal_(1.0)
            network[-1].weight[:, : len(values)] = torch.tensor(table).T
    return learner


def test_targets_worked_by_hand():
    online, slow = [[1.0, 2.0], [5.0, 3.0]], [[10.0, 20.0], [30.0, 70.0]]
    learner = tabular(online, slow)
    states = np.eye(2, dtype=np.float32)
    batch = Batch(
        states[[0, 0, 1]],
        np.array([0, 1, 0]),
        np.float32([0.5, 1.0, 2.0]),
        np.float32([0.9, 0.81, 0.0]),
        states[[1, 0, 0]],
    )
    # the online network chooses action 0 in state 1 and action 1 in state 0; the slow one says their worth
    assert learner.targets(batch).tolist() == pytest.approx([0.5 + 0.9 * 30, 1.0 + 0.81 * 20, 2.0])


def test_one_step_moves_the_value_towards_its_target():
    learner = DQN(2, 2, 0, DQNSettings())
    states = np.eye(2, dtype=np.float32)
    before = learner.values(states)
    batch = Batch(states[:1], np.array([1]), np.float32([3.0]), np.float32([0.0]), states[1:])
    for _ in range(200):
        learner.improve(batch)
    after = learner.values(states)
    assert after[0, 1] == pytest.approx(3.0, abs=0.1)
    assert abs(after[0, 0] - before[0, 0]) < 0.5


def test_it_chooses_the_best_that_is_allowed_and_explores_by_its_rate():
    learner = tabular([[1.0, 2.0, 3.0]])
    states = np.ones((2000, 1), np.float32)
    allowed = np.array([[True, True, False]] * 2000)
    learner.exploration = 0.0
    assert set(learner.act(states, np.random.default_rng(0))) == {2}
    assert set(learner.act(states, np.random.default_rng(0), allowed)) == {1}
    learner.exploration = 0.5
    chosen = learner.act(states, np.random.default_rng(0), allowed)
    assert set(chosen) == {0, 1}
    assert np.mean(chosen == 0) == pytest.approx(0.25, abs=0.04)
    assert (chosen == learner.act(states, np.random.default_rng(0), allowed)).all()


def test_exploration_falls_in_a_straight_line():
    learner = DQN(1, 2, 0, DQNSettings(exploration=1.0, final_exploration=0.05, exploration_share=0.1))
    for progress, rate in ((0.0, 1.0), (0.05, 0.525), (0.1, 0.05), (1.0, 0.05)):
        learner.anneal(progress)
        assert learner.exploration == pytest.approx(rate)


def test_a_chain_is_learned_from_what_is_kept():
    """Three states in a row; only a step right from the last one pays."""
    learner = DQN(
        3, 2, 0, DQNSettings(warm_up=64, update_every=1, refresh_every=20, batch=32, learning_rate=1e-3)
    )
    rng, states = np.random.default_rng(0), np.eye(3, dtype=np.float32)
    for _ in range(40):
        place, action = rng.integers(3, size=16), rng.integers(2, size=16)
        solved = (place == 2) & (action == 1)
        after = np.clip(place + np.where(action == 1, 1, -1), 0, 2)
        learner.learn(
            Batch(states[place], action, np.float32(solved), np.float32(0.9 * ~solved), states[after])
        )
    assert learner.values(states).argmax(-1).tolist() == [1, 1, 1]
    assert learner.values(states)[:, 1] == pytest.approx([0.81, 0.9, 1.0], abs=0.15)


def test_its_tensors_are_kept_and_taken():
    one, other = DQN(3, 2, 0, DQNSettings()), DQN(3, 2, 1, DQNSettings())
    states = np.eye(3, dtype=np.float32)
    assert (one.values(states) != other.values(states)).any()
    other.load({**one.state(), "actor.0.weight": torch.zeros(1)})
    assert (one.values(states) == other.values(states)).all()


def test_at_every_step_it_explores_by_its_rate_and_less_once_it_has_learned():
    learner = StepDQNSettings(noise=0.25).learner(1, 2, 0)
    states = np.ones((2000, 1), np.float32)
    best = learner.dqn.values(states[:1]).argmax()
    learner.dqn.exploration = 0.5
    for actor, rate in ((learner, 0.5), (learner.eval_actor(), 0.25), (learner.teacher_actor(), 0.25)):
        actions, log_probs = actor.act(states, np.random.default_rng(0))
        assert np.mean(actions != best) == pytest.approx(rate / 2, abs=0.03)
        assert log_probs.tolist() == [0.0] * 2000
    seen, actions = torch.from_numpy(states[:2]), torch.tensor([1, 0])
    assert learner.values_of(seen, actions).numpy() == pytest.approx(learner.dqn.values(states[:1])[0, ::-1])


def test_at_every_step_the_learning_rate_falls_in_a_straight_line():
    learner = StepDQNSettings(learning_rate=1e-3, final_rate=0.2, exploration_share=0.5).learner(1, 2, 0)
    for progress, rate, exploration in ((0.0, 1e-3, 1.0), (0.25, 8e-4, 0.525), (1.0, 2e-4, 0.05)):
        learner.anneal(progress)
        assert learner.dqn.optimiser.param_groups[0]["lr"] == pytest.approx(rate)
        assert learner.dqn.exploration == pytest.approx(exploration)
