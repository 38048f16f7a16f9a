"""What the hybrid model asks of a low-level learner; PPO and TD3 are alike to it."""

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.learners.buffers import RolloutBuffer


class Actor(Protocol):
    """Acts, and can't learn from it."""

    def act(
        self, observations: NDArray[np.float32], rng: np.random.Generator
    ) -> tuple[NDArray[Any], NDArray[np.float32]]:
        """Actions [B, ...] for observations [B, D], and their log-probabilities [B]: 0 if they have none.

        All chance comes from `rng`, so that what is done depends on the networks and the caller's seed alone.
        """


class Learner(Actor, Protocol):
    """An actor with an update rule and tensors to keep."""

    def update(self, buffer: RolloutBuffer) -> None:
        """Learns from one block of experience."""

    def anneal(self, done: float) -> None:
        """Told which share of the budget is used up, in [0, 1]."""

    def eval_actor(self) -> Actor:
        """The same actor for evaluation: it explores less."""

    def teacher_actor(self) -> Actor:
        """The same actor as the teacher of another policy."""

    def state(self) -> dict[str, torch.Tensor]:
        """The networks' tensors by name."""

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the networks' tensors from `state`."""

    def warm_start(self, state: dict[str, torch.Tensor], logit_scale: float) -> None:
        """Starts from another's tensors, the actor's logits times `logit_scale`, so that it explores."""


class LearnerSettings(Protocol):
    """The numbers of a learner, and how to make one of them.

    Attributes:
        discount: γ per action.
    """

    @property
    def discount(self) -> float: ...

    def learner(self, observation_size: int, actions: int, seed: int) -> Learner:
        """A new learner.

        Args:
            observation_size: Numbers in an observation.
            actions: To choose from, or numbers in one.
            seed: Of its networks, and of its draws while it learns.
        """
