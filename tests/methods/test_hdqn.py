"""What the meta-controller learns from, as worked by hand."""

import numpy as np
import pytest

from paddlectl.agents.interaction import Learning
from paddlectl.hybrid.rollout import PROGRESS, DecisionSettings, Outcome
from paddlectl.learners.clauses import ClauseSettings
from paddlectl.methods.hdqn import HDQNAgent, HDQNPolicy, HDQNSettings, MetaController
from scripted import END, HORIZON, RIGHT, STAY, TASK, TWO, ByScript, Corridor

HALF = ClauseSettings(discount=0.5, step_discount=1.0)


def policy(monkeypatch, *subgoals, discounts=HALF, **settings):
    """Picks these of the task's subgoals in turn, the last for ever; gives the batches it learns from."""
    made, batches, left = (
        HDQNPolicy(TASK, 0, HDQNSettings(discounts=discounts, **settings)),
        [],
        list(subgoals),
    )

    def act(states, rng):
        return np.full(len(states), left.pop(0) if len(left) > 1 else left[0])

    monkeypatch.setattr(made.meta, "act", act)
    monkeypatch.setattr(made.meta, "learn", batches.append)
    return made, batches


def test_a_batch_of_three_lanes_of_four(monkeypatch):
    discounts = ClauseSettings(discount=0.5, step_discount=0.8)
    made, batches = policy(monkeypatch, 0, discounts=discounts)
    meta = MetaController(made, 4, np.random.default_rng(0))
    began = np.arange(16, dtype=np.float32).reshape(4, 4)
    meta.state = began
    meta.select(np.arange(4), np.zeros(4, np.intp))
    meta.state = 100 + began
    # going on after one step, solved after two, cut off by the horizon after one; lane 1 hasn't ended
    meta.on_decision_end(
        Outcome(
            lanes=np.array([0, 2, 3]),
            scene_states=np.zeros(3, np.intp),
            subgoals=np.array([END, TWO, END]),
            guides=np.zeros(3, np.intp),
            steps=np.array([1, 2, 1]),
            rewards=np.float32([0.1, 0.9, 0.0]),
            reached=np.array([False, True, False]),
            cut=np.array([False, False, True]),
            terminated=np.array([False, True, False]),
            solved=np.array([False, True, False]),
            truncated=np.array([False, False, True]),
            next_scene_states=np.full(3, PROGRESS),
        )
    )
    (batch,) = batches
    assert batch.states.tolist() == began[[0, 2, 3]].tolist()
    assert batch.actions.tolist() == [0, 1, 0], "gt_end and gt_two by the task's own order"
    # γ is 0.5 · 0.8 for one step, 0.5 · 0.64 for two
    assert batch.rewards == pytest.approx(np.array([0.04, 0.288, 0.0]))
    assert batch.discounts == pytest.approx(np.array([0.4, 0.0, 0.4]))
    assert batch.following.tolist() == (100 + began[[0, 2, 3]]).tolist()
    assert {column.dtype for column in (batch.rewards, batch.discounts)} == {np.dtype(np.float32)}


def states(batches, name):
    """place/10, layout, paid, time: of the only lane."""
    return np.concatenate([getattr(batch, name) for batch in batches])


def learn(monkeypatch, subgoals, actions, frames):
    settings = {"num_envs": 1, "rollout_steps": frames, "decisions": DecisionSettings(max_steps=5)}
    made, batches = policy(monkeypatch, *subgoals, **settings)
    made.low_level = ByScript(*actions)
    list(Learning(Corridor(1, 0), HDQNAgent(made, 0), frames))
    return batches


def test_decisions_follow_each_other_to_the_end_of_an_episode(monkeypatch):
    """gt_two is reached at cell 2; with gt_end the scene changes at cell 3, and cell 5 solves."""
    batches = learn(monkeypatch, [1, 0], [RIGHT], 5)
    assert [batch.actions.tolist() for batch in batches] == [[1], [0], [0]]
    places = np.array([[0, 0, 0, 0], [0.2, 0, 1, 2 / 12], [0.3, 0, 1, 3 / 12], [0.5, 0, 1, 5 / 12]])
    assert states(batches, "states") == pytest.approx(places[:3])
    assert states(batches, "following") == pytest.approx(places[1:]), "as it ended, not the next layout"
    assert states(batches, "rewards") == pytest.approx(np.array([0.05, 0.0, 0.25]))
    assert states(batches, "discounts") == pytest.approx(np.array([0.5, 0.5, 0.0]))


def test_the_horizon_is_no_end(monkeypatch):
    batches = learn(monkeypatch, [0], [STAY], HORIZON)
    assert states(batches, "following")[:, 3] == pytest.approx(np.array([5, 10, 12]) / 12)
    assert states(batches, "discounts") == pytest.approx(np.full(3, 0.5))


def test_a_player_picks_the_best_and_learns_nothing(monkeypatch):
    made, batches = policy(monkeypatch, 0)
    values = np.float32([[0.1, 0.3, 0.2], [0.9, 0.3, 0.2]])
    monkeypatch.setattr(made.meta, "values", lambda states: values[states[:, 0].astype(int)])
    meta = MetaController(made, 2, np.random.default_rng(0), learns=False)
    meta.state = np.float32([[1], [0]])
    assert meta.select(np.array([0, 1]), np.zeros(2, np.intp))[1].tolist() == [END, TWO]
    made.low_level = ByScript(RIGHT)
    player = made.player(TASK, 1, np.random.SeedSequence(0))
    environment = Corridor(1, 0)
    for _ in range(5):
        player.observe(environment, environment.step(player.act(environment)))
    assert environment.place.tolist() == [5]
    assert batches == []
