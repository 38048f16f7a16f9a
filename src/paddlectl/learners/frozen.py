"""Actors that learn no more: those of sources."""

from collections.abc import Callable
from typing import Any

import numpy as np

from paddlectl.learners.base import Actor, Learner


class FrozenActor:
    """A learner's actor as a teacher, loaded when it first acts.

    Args:
        load: Gives the learner, whose critics aren't kept.
        digest: Of its tensors. A checkpoint keeps that alone: the registry has them.
    """

    def __init__(self, load: Callable[[], Learner], digest: str) -> None:
        self._load, self._digest = load, digest
        self._actor: Actor | None = None

    def act(self, observations: Any, rng: np.random.Generator) -> tuple[Any, Any]:
        """As `Actor.act`."""
        if self._actor is None:
            self._actor = self._load().teacher_actor()
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
