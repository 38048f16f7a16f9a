"""Φ (Eq. 2) and the running mean of a guide's return, against tables worked by hand."""

import math

import numpy as np
import pytest

from paddlectl.transfer.performance import MeanReturns, performance

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
