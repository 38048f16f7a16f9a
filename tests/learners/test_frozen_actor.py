"""A source's actor: as it learned, and in a checkpoint by its digest alone."""

import numpy as np
import pytest

from paddlectl.experiments import snapshot
from paddlectl.learners.base import Learner, LearnerSettings
from paddlectl.learners.frozen import FrozenActor
from paddlectl.learners.ppo import PPOSettings
from paddlectl.learners.td3 import TD3Settings

SIZE, ACTIONS = 160, 3


@pytest.mark.parametrize("settings", [PPOSettings(hidden=(64, 64)), TD3Settings()])
def test_it_acts_as_the_teacher_and_costs_a_checkpoint_nothing(settings: LearnerSettings) -> None:
    learner = settings.learner(SIZE, ACTIONS, 0)
    frozen, seen = FrozenActor(lambda: learner, "a"), np.random.default_rng(0).random((5, SIZE), np.float32)
    one, two = (actor.act(seen, np.random.default_rng(1))[0] for actor in (frozen, learner.teacher_actor()))
    np.testing.assert_array_equal(one, two)
    tree, arrays = snapshot.capture({"it": [frozen]})
    assert len(arrays) < 1000
    snapshot.restore({"it": [FrozenActor(never, "a")]}, tree, arrays)
    with pytest.raises(snapshot.IntegrityError, match="a source isn't what it was"):
        snapshot.restore({"it": [FrozenActor(never, "b")]}, tree, arrays)


def never() -> Learner:
    """Who doesn't act isn't loaded."""
    raise AssertionError
