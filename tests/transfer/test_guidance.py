"""Λ (Eq. 3), its faded form, and who leads of those that tie."""

import numpy as np
import pytest

from paddlectl.transfer.guidance import faded_weight, guidance_weight, select_guide

NEVER = -np.inf


def test_the_weight_is_the_sum_of_both_similarities():
    found = guidance_weight(np.array([[0.5, NEVER, 0.25]]), np.array([[0.125, 1.0, 0.0]]))
    assert found.tolist() == [[0.625, NEVER, 0.25]]


# ψ, Φ, decisions, decay, Λ = f·ψ + (1 - f)·Φ with f = decay^decisions
FADED = [
    (0.8, 0.0, 0.0, 0.5, 0.8),
    (0.8, 0.4, 1.0, 0.5, 0.6),
    (0.8, 0.4, 2.0, 0.5, 0.5),  # 0.25·0.8 + 0.75·0.4
    (0.8, 0.4, 200.0, 0.5, 0.4),
    (0.2, 1.0, 3.0, 0.5, 0.9),  # 0.125·0.2 + 0.875
    (0.8, 0.4, 5.0, 1.0, 0.8),
    (0.8, 0.4, 1.0, 0.0, 0.4),
]


@pytest.mark.parametrize(("similarity", "phi", "count", "decay", "weight"), FADED)
def test_faded_weight_as_worked_by_hand(similarity, phi, count, decay, weight):
    found = faded_weight(np.array([similarity]), np.array([phi]), np.array([count]), decay)
    assert found.item() == pytest.approx(weight)


def choose(weights, times=400):
    """Which candidates lead, over many draws of one row."""
    rows = np.repeat(np.array([weights], float), times, axis=0)
    return np.bincount(select_guide(rows, np.random.default_rng(0)), minlength=len(weights)) / times


def test_the_largest_weight_leads():
    assert choose([0.1, 0.7, 0.6]).tolist() == [0, 1, 0]
    assert choose([0.8, 0.7, 0.6]).tolist() == [1, 0, 0]
    assert choose([-0.3, -0.2, -0.1]).tolist() == [0, 0, 1]
    assert choose([0.5, 0.0, 0.0]).tolist() == [1, 0, 0]


def test_of_a_source_and_the_target_that_tie_the_source_leads():
    assert choose([0.7, 0.7, 0.6]).tolist() == [0, 1, 0]
    assert choose([0.0, 0.0, NEVER]).tolist() == [0, 1, 0]


def test_of_tied_sources_or_scenes_each_leads_as_often():
    found = choose([0.2, 0.7, 0.7, 0.1, 0.7], times=6000)
    assert found == pytest.approx([0, 1 / 3, 1 / 3, 0, 1 / 3], abs=0.03)
    assert choose([0.7, 0.7, 0.7], times=6000) == pytest.approx([0, 0.5, 0.5], abs=0.03)


def test_who_has_no_match_never_leads():
    assert choose([0.1, NEVER, 0.05, NEVER]).tolist() == [1, 0, 0, 0]
    assert choose([0.05, NEVER, 0.1, NEVER]).tolist() == [0, 0, 1, 0]
    assert choose([0.1, NEVER, NEVER]).tolist() == [1, 0, 0]
    assert choose([-5.0, NEVER]).tolist() == [1, 0]


def test_without_sources_the_target_leads():
    assert choose([0.0]).tolist() == [1]


def test_rows_choose_for_themselves():
    weights = np.array([[0.1, 0.2, 0.0], [0.3, 0.2, 0.0], [0.1, 0.2, 0.3]])
    assert select_guide(weights, np.random.default_rng(0)).tolist() == [1, 0, 2]
