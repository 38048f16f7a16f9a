"""Planned returns of small chains, worked by hand."""

import numpy as np
import pytest

from paddlectl.hybrid.semi_markov import SemiMarkovModel


def counted(decisions, shape, discount=0.5, memory=1e12):
    model = SemiMarkovModel(*shape, memory)
    for scene_state, option, reward, following in decisions:
        model.record(scene_state, option, reward, following, discount)
    return model


def planned(decisions, shape, discount=0.5, memory=1e12, sweeps=400):
    """The return of each option when the best of every scene state is taken from then on.

    The discount is of the whole decision, so what the decision itself earned is discounted too.
    """
    model = counted(decisions, shape, discount, memory)
    returns = np.zeros(shape)
    for _ in range(sweeps):
        returns = model.returns(returns.max(-1))
    return returns


def test_a_chain_of_three_scenes_as_worked_by_hand():
    # 0 -> 1 for nothing, 1 -> 2 for 0.2, 2 -> the end for 2; γ = 0.5
    chain = [(0, 0, 0.0, 1), (1, 0, 0.2, 2), (2, 0, 2.0, None)]
    # option 1 gets from 0 to the end for 0.4, and in scene 1 half of the time on, half back
    chain += [(0, 1, 0.4, None), (1, 1, 0.2, 2), (1, 1, 0.0, 0)]
    # V2 = 0.5·2 = 1; V1 = 0.5·(0.2 + 1) = 0.6; V0 = 0.5·0.6 = 0.3; G(1, 1) = 0.5·((0.2 + V2) + V0)/2
    expected = np.array([[0.3, 0.2], [0.6, 0.375], [1.0, 0.0]])
    assert planned(chain, (3, 2)) == pytest.approx(expected)
    assert counted(chain, (3, 2)).count == pytest.approx(np.array([[1, 1], [1, 2], [1, 0]]))


def test_one_sweep_looks_one_decision_ahead():
    model = counted([(0, 0, 0.2, 1), (1, 0, 0.8, None)], (2, 1))
    assert model.returns(np.array([7.0, 2.0])) == pytest.approx(np.array([[0.5 * (0.2 + 2.0)], [0.4]]))


def test_a_longer_decision_is_worth_less():
    model = SemiMarkovModel(2, 2, 1e12)
    model.record(0, 0, 1.0, None, 0.9)
    model.record(0, 1, 1.0, None, 0.6)
    assert model.returns(np.zeros(2))[0] == pytest.approx([0.9, 0.6])


def test_two_guides_that_undo_each_other_are_worth_less_than_going_on():
    # 0 takes the key up, 1 puts it down; going on from scene 1 leads to the end, rarely tried
    loop = [(0, 0, 0.0, 1), (1, 1, 0.0, 0)] * 50
    found = planned([*loop, (1, 0, 0.1, 2), (2, 0, 0.8, None)], (3, 2), discount=0.9)
    # V2 = 0.72; V1 = 0.9·(0.1 + 0.72) = 0.738; V0 = 0.9·V1; back and forth: 0.9·V0
    assert found[1] == pytest.approx([0.738, 0.9**2 * 0.738])
    assert found[1, 0] > found[1, 1]


def test_a_closed_loop_is_worth_nothing_whatever_was_hoped_for():
    model = counted([(0, 0, 0.0, 1), (1, 1, 0.0, 0)] * 5, (2, 2), discount=0.95)
    values = np.ones(2)
    assert model.returns(values)[0, 0] == pytest.approx(0.95)
    for _ in range(400):
        values = model.returns(values).max(-1)
    assert values == pytest.approx(np.zeros(2), abs=1e-6)


def test_the_latest_decisions_count_most():
    # memory 2: a cell keeps half at each new decision: 1·0.5 + 1 = 1.5, then 0.5·1.5 + 1 = 1.75
    model = counted([(0, 0, 1.0, None), (0, 0, 0.0, None), (0, 0, 1.0, None)], (1, 1), 1.0, memory=2.0)
    assert model.count.item() == pytest.approx(1.75)
    assert model.returns(np.zeros(1)).item() == pytest.approx((0.25 + 1.0) / 1.75)


def test_a_cell_weighs_no_more_than_its_memory():
    model = counted([(0, 0, 1.0, None)] * 500 + [(0, 0, 0.0, None)] * 40, (1, 1), 1.0, memory=20.0)
    assert model.count.item() == pytest.approx(20.0)
    assert model.returns(np.zeros(1)).item() < 0.2


def test_options_have_memories_of_their_own():
    model = counted(
        [(0, option, 1.0, None) for option in (0, 1)] * 60, (1, 2), 1.0, memory=np.array([2.0, 10.0])
    )
    assert model.count[0] == pytest.approx([2.0, 10.0], rel=0.01)


def test_the_prior_draws_an_option_towards_its_situation():
    model = counted([(0, 0, 0.6, None)], (1, 2), 1.0)
    # (0.6 + 2·0.3)/(1 + 2); without decisions the scene state's own value
    assert model.returns(np.array([0.3]), prior=2.0)[0] == pytest.approx([0.4, 0.3])
    assert model.returns(np.array([0.3]))[0] == pytest.approx([0.6, 0.0])
