"""How a learner explores: actions that are held, and novelty by hand."""

import numpy as np
import pytest

from paddlectl.learners.exploration import HeldActions, Novelty


def played(share: float, steps: float, count: int = 400) -> np.ndarray:
    """What 50 lanes do that would do nothing by themselves. [T, B, A]"""
    held, rng = HeldActions(2, steps), np.random.default_rng(0)
    idle = np.zeros((50, 2), np.float32)
    return np.stack([held.replace(idle, np.full(50, share), rng) for _ in range(count)])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_so_much_of_the_time_a_random_action_is_held_and_it_is_strong(share):
    actions = played(share, 5.0)
    random = (actions != 0.0).any(-1)
    assert random[50:].mean() == pytest.approx(share, abs=0.05)
    assert (np.abs(actions[random]) >= 0.5).all() and (np.abs(actions) <= 1.0).all()
    assert share == 0.0 or (actions > 0).mean() == pytest.approx(share / 2, abs=0.05), "in every direction"


def test_a_random_action_lasts_as_long_as_was_asked_on_average():
    actions = played(1.0, 5.0)[50:]
    changes = (actions[1:] != actions[:-1]).any(-1).mean()
    assert changes == pytest.approx(1 / 5, abs=0.02)


def test_states_are_paid_by_how_often_their_like_was_seen():
    novelty = Novelty(2)
    seen = np.float32([[[0.1, 2.2], [-0.4, 1.8], [0.3, 2.4]], [[0.0, 2.0], [5.0, 2.0], [0.2, 1.9]]])
    novelty.count(seen)
    states = np.float32([[0.4, 2.4], [5.2, 1.6], [0.0, 3.0], [-5.0, 2.0]])
    np.testing.assert_allclose(novelty.bonus(states), [5**-0.5, 1.0, 1.0, 1.0], rtol=1e-6)
