"""Actors that learn no more: those of sources."""

import hashlib
from typing import Any

import numpy as np

from paddlectl.learners.base import Actor, Learner


class FrozenActor:
    """A learner's actor as a teacher. Of its tensors a checkpoint keeps the digest: the registry has them.

    Args:
        learner: Whose critics aren't kept.
    """

    def __init__(self, learner: Learner) -> None:
        self._actor: Actor = learner.teacher_actor()
        told = hashlib.sha256()
        for name, tensor in sorted(learner.state().items()):
            told.update(name.encode())
            told.update(tensor.detach().numpy().tobytes())
        self._digest = told.hexdigest()

    def act(self, observations: Any, rng: np.random.Generator) -> tuple[Any, Any]:
        """As `Actor.act`."""
        return self._actor.act(observations, rng)

    def snapshot(self) -> str:
        """What tells it from others."""
        return self._digest

    def restore(self, value: str) -> None:
        """Nothing is to be done: it doesn't change.

        Raises:
            ValueError: If it was another.
        """
        if value != self._digest:
            raise ValueError("a source isn't what it was")
