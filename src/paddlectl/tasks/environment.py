"""What the tasks' Gymnasium environments have in common."""

from abc import abstractmethod
from dataclasses import replace
from importlib import import_module
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

from paddlectl.tasks import registration  # with one environment, all are registered
from paddlectl.tasks.base import Split
from paddlectl.tasks.split import checked_split


class TaskEnv(gymnasium.Env[Any, Any]):
    """An environment that ends its episodes by itself, and tells so.

    Attributes:
        split: Of which the layouts are.
        max_steps: Steps after which an episode is truncated, told as `spec.max_episode_steps`. Gymnasium's
            own `make(..., max_episode_steps=...)` can only shorten it.
        episode: How many were begun, the present one among them.
        earned: Rewards of the present one so far.
    """

    split: Split
    max_steps: int
    episode: int = 0
    earned: float = 0.0
    _spec: EnvSpec | None = None

    def configure(self, split: Split, max_steps: int) -> None:
        """Sets the attributes.

        Raises:
            ValueError: If there is no such split, or episodes would have no step.
        """
        self.split = checked_split(split)
        if not isinstance(max_steps, int | np.integer) or max_steps < 1:
            raise ValueError(f"max_steps is a whole number from 1 on, not {max_steps!r}")
        self.max_steps = int(max_steps)

    @property
    @abstractmethod
    def task(self) -> str:
        """Its task's name."""

    @property
    def asked(self) -> Any:
        """Its task as `tasks.suite.load` takes it."""
        return self.task

    @abstractmethod
    def begin(self, start: Any) -> None:
        """Begins an episode as `start` of its task's engine told.

        Raises:
            LookupError, TypeError or ValueError: If it can't have told that.
        """

    @abstractmethod
    def mirror_in(self, engine: Any) -> None:
        """Brings the one lane of its task's engine into the present state of this environment.

        It is to be called after each step: an engine whose actions last several also keeps what happened
        between the first and the last of them.
        """

    def begin_episode(self) -> None:
        """Counts an episode that begins."""
        self.episode += 1
        self.earned = 0.0

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` made it from, which knows nothing of its `max_steps`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec and replace(spec, max_episode_steps=self.max_steps)


def can_be_drawn(task: Any) -> bool:
    """Whether `drawn` gives the environment of a task, which is as `tasks.suite.load` takes it."""
    return not isinstance(task, str) or task in registration.ENTRY_POINTS


def drawn(task: Any, split: Split = "evaluation") -> TaskEnv:
    """The environment of a task whose `render` gives a picture.

    Args:
        task: One that `can_be_drawn`.
        split: Of which its layouts are.
    """
    named = isinstance(task, str)
    where = registration.ENTRY_POINTS[task] if named else task.spec.ENVIRONMENT
    module, _, name = where.partition(":")
    made = getattr(import_module(module), name)
    given = task if named else task.spec
    env: TaskEnv = made(given, split=split, render_mode="rgb_array", **registration.LOOKS.get(where, {}))
    return env
