"""Φ (Eq. 2) and both estimates of a guide's return, against tables worked by hand."""

import math

import numpy as np
import pytest

from paddlectl.transfer.performance import MeanReturns, PlannedReturns, performance

LN2 = math.log(2.0)

# G, H, Φ = G + max(0, min(-G, 0.05))·H, within [0, 1]
EQUATION_2 = [
    (0.6, 0.0, 0.6),
    (0.6, LN2, 0.6),  # a return that is positive gets no bonus
    (0.0, LN2, 0.0),
    (1.0, LN2, 1.0),
    (1.7, LN2, 1.0),  # clipped
    (-0.01, 2.0, 0.01),  # -0.01 + 0.01·2
    (-0.04, 2.0, 0.04),  # -0.04 + 0.04·2
    (-0.05, 2.0, 0.05),  # -0.05 + 0.05·2, the most that exploration brings
    (-0.06, 2.0, 0.04),  # -0.06 + 0.05·2: beyond -ε the bonus grows no more
    (-0.10, 2.0, 0.0),  # -0.10 + 0.05·2
    (-0.20, 2.0, 0.0),  # -0.20 + 0.05·2 < 0, clipped
    (-0.01, 0.5, 0.0),  # -0.01 + 0.01·0.5 < 0, clipped
    (-0.05, 0.0, 0.0),
]


@pytest.mark.parametrize(("return_", "entropy", "phi"), EQUATION_2)
def test_performance_as_worked_by_hand(return_, entropy, phi):
    assert performance(np.array([[return_]]), np.array([[entropy]])).item() == pytest.approx(phi, abs=1e-12)


def test_the_bonus_has_its_own_limit():
    assert performance(np.array([-0.2]), np.array([2.0]), epsilon=0.15).item() == pytest.approx(0.1)


def test_performance_is_by_cell():
    found = performance(np.array([[0.5, -0.05], [0.2, 2.0]]), np.array([[1.0, 2.0], [3.0, 0.0]]))
    assert found == pytest.approx(np.array([[0.5, 0.05], [0.2, 1.0]]))


def test_running_mean_as_worked_by_hand():
    returns = MeanReturns((2, 3), initial=0.9)
    assert (returns.mean == 0.9).all()
    for sample, mean in [(0.4, 0.4), (0.8, 0.6), (0.0, 0.4), (0.8, 0.5)]:  # the constant counts for nothing
        returns.record(1, 2, sample)
        assert returns.mean[1, 2] == pytest.approx(mean)
    returns.record(0, 0, 0.7)
    assert returns.mean == pytest.approx(np.array([[0.7, 0.9, 0.9], [0.9, 0.9, 0.5]]))
    assert returns.count.tolist() == [[1, 0, 0], [0, 0, 4]]


def planned(decisions, shape, discount=0.5, memory=1e12, sweeps=60):
    """The return of each candidate after planning with the best of every scene."""
    returns = PlannedReturns(shape, discount, np.full(shape[1], memory))
    for scene, candidate, reward, next_scene in decisions:
        returns.record(scene, candidate, reward, next_scene)
    for _ in range(sweeps):
        returns.sweep(returns.mean.max(-1))
    return returns


def test_a_chain_of_three_scenes_as_worked_by_hand():
    # 0 -> 1 for nothing, 1 -> 2 for 0.1, 2 -> the end for 1; γ = 0.5
    chain = [(0, 0, 0.0, 1), (1, 0, 0.1, 2), (2, 0, 1.0, None)]
    # candidate 1 gets from 0 to the end for 0.2, and in scene 1 half of the time on, half back
    chain += [(0, 1, 0.2, None), (1, 1, 0.1, 2), (1, 1, 0.0, 0)]
    found = planned(chain, (3, 2))
    # V2 = 1; V1 = 0.1 + 0.5·1 = 0.6; V0 = 0.5·0.6 = 0.3; G(1, 1) = (0.1 + 0)/2 + 0.5·(V2 + V0)/2
    assert found.mean == pytest.approx(np.array([[0.3, 0.2], [0.6, 0.375], [1.0, 0.0]]))
    assert found.count == pytest.approx(np.array([[1, 1], [1, 2], [1, 0]]))


def test_one_sweep_looks_one_decision_ahead():
    returns = planned([(0, 0, 0.1, 1), (1, 0, 0.4, None)], (2, 1), sweeps=0)
    returns.sweep(np.array([7.0, 2.0]))
    assert returns.mean == pytest.approx(np.array([[0.1 + 0.5 * 2.0], [0.4]]))


def test_two_guides_that_undo_each_other_are_worth_less_than_going_on():
    # 0 takes the key up, 1 puts it down; going on from scene 1 leads to the end, rarely tried
    loop = [(0, 0, 0.0, 1), (1, 1, 0.0, 0)] * 50
    found = planned([*loop, (1, 0, 0.1, 2), (2, 0, 0.8, None)], (3, 2), discount=0.95)
    # V2 = 0.8; V1 = 0.1 + 0.95·0.8 = 0.86; V0 = 0.95·0.86; back and forth: 0.95²·0.86
    assert found.mean[1] == pytest.approx([0.86, 0.95**2 * 0.86])
    assert found.mean[1, 0] > found.mean[1, 1]


def test_a_closed_loop_is_worth_nothing():
    found = planned([(0, 0, 0.0, 1), (1, 1, 0.0, 0)] * 5, (2, 2), discount=0.95, sweeps=400)
    assert found.mean == pytest.approx(np.zeros((2, 2)), abs=1e-6)


def test_a_loop_forgets_the_hopes_it_started_with():
    returns = planned([(0, 0, 0.0, 1), (1, 0, 0.0, 0)], (2, 1), discount=0.95, sweeps=0)
    returns.sweep(np.array([1.0, 1.0]))
    assert returns.mean[0, 0] == pytest.approx(0.95)
    for _ in range(200):
        returns.sweep(returns.mean.max(-1))
    assert returns.mean.max() < 0.01


def test_the_latest_decisions_count_most():
    # memory 2: a cell keeps half at each new decision: 1·0.5 + 1 = 1.5, then 0.5·1.5 + 1 = 1.75
    found = planned([(0, 0, 1.0, None), (0, 0, 0.0, None), (0, 0, 1.0, None)], (1, 1), memory=2.0)
    assert found.count.item() == pytest.approx(1.75)
    assert found.mean.item() == pytest.approx((0.25 + 1.0) / 1.75)


def test_a_cell_weighs_no_more_than_its_memory():
    found = planned([(0, 0, 1.0, None)] * 500 + [(0, 0, 0.0, None)] * 40, (1, 1), memory=20.0)
    assert found.count.item() == pytest.approx(20.0)
    assert found.mean.item() < 0.2
