"""Who acts and who learns: the seam between a method and everything that runs it.

The loop (`agents.interaction`) owns the environment's steps. An agent owns everything else.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from paddlectl.logic.clauses import Program
from paddlectl.tasks.base import Environment, Ints, Step, Task

if TYPE_CHECKING:
    import torch  # a second of loading, which who only reads a scenario is spared

TARGET_NAME = "target"
"""Stands for the learner itself among its sources."""


class Episode(NamedTuple):
    """A finished episode.

    Attributes:
        order: Place among all episodes in the order in which they started.
        started: Frames that had been collected when it started.
        finished: Frames when it ended.
        score: Final reward alone, 0 on failure.
        length: Steps.
        scenes: Numbers of the scenes that it came through; none of a player who knows no scenes.
    """

    order: int
    started: int
    finished: int
    score: float
    length: int
    scenes: tuple[int, ...] = ()


class Player(Protocol):
    """Acts in B environments side by side. One that inherits from it keeps nothing and knows no scenes."""

    def act(self, environment: Environment) -> NDArray[np.generic]:
        """An action for each environment, as `Environment.step` takes them. [B, ...]"""

    def observe(self, environment: Environment, step: Step) -> None:
        """Takes in what came of the actions. Environments that have ended aren't reset yet."""
        return

    def scenes(self, lane: int) -> tuple[int, ...]:
        """The scenes that the episode came through which has just ended there."""
        return ()

    def subgoals(self) -> Ints | None:
        """What each environment goes for since the latest action, by its place in the domain's subgoals. [B]

        None if it knows no subgoals.
        """
        return None


class ReuseRow(NamedTuple):
    """How one source stood in one context, for `explain`.

    Attributes:
        frames: When.
        context: Where: a scene's body, or a name.
        source: Id of its policy; `target` for the learner itself.
        terms: What its weight is made of, by name: ψ and Φ, an advantage, an option's value.
        weight: By which it was chosen.
        chosen: How often it was.
        reached: How often it then reached what was wanted; None if the method knows no such thing.
    """

    frames: int
    context: tuple[str, ...]
    source: str
    terms: Mapping[str, float]
    weight: float
    chosen: int
    reached: int | None


Tables = Mapping[str, Sequence[Mapping[str, Any]]]
"""Name of a run's table -> rows to append."""


class Policy(Protocol):
    """What was learned. One that inherits from it has no clauses.

    Attributes:
        task: The task.
        action_repeat: Steps of the task that one of its actions lasts.
        scene_count: S; 0 without clauses.
    """

    task: Task
    action_repeat: int
    scene_count: int = 0

    def player(self, task: Task, environments: int, seed: np.random.SeedSequence) -> Player:
        """Plays by it and learns nothing; all chance is `seed`'s. The task may be another of its domain."""

    def played_program(self, passed: Ints, episodes: int) -> tuple[Program | None, float | None]:
        """The program that was executed and its crispness; None without clauses.

        Args:
            passed: How many of the episodes came through each scene. [S]
            episodes: How many were played.
        """
        return None, None

    def settings_document(self) -> dict[str, Any]:
        """Its settings as JSON-able values, for it to be revived by."""

    def state(self) -> "dict[str, torch.Tensor]":
        """All tensors by name."""

    def load(self, state: "dict[str, torch.Tensor]") -> None:
        """Takes all tensors from `state`."""


class Agent(Player, Protocol):
    """Learns a task while it acts on it. All that changes is in its attributes, between two rounds.

    One that inherits from it has no sources, and keeps nothing beside the usual tables.

    Attributes:
        rollout_steps: Steps of each environment between two updates.
    """

    rollout_steps: int

    def update(self, environment: Environment, progress: float) -> Mapping[str, float]:
        """Learns from the latest `rollout_steps` steps.

        Args:
            environment: As it is now; those that had ended are reset.
            progress: Share of the budget that is used up, in [0, 1].

        Returns:
            Figures for the run's progress table.
        """

    def reuse(self) -> Iterable[ReuseRow]:
        """How its sources stand as of now; nothing without sources. It changes nothing."""
        return ()

    def record(self, frames: int, episodes: Sequence[Episode], known: int) -> Tables:
        """Takes stock after a round, and gives what is to be kept in the run's tables.

        Args:
            frames: Steps so far.
            episodes: Those that ended in the round.
            known: Episodes that have ended so far, in the order of their start, up to the first that hasn't.
        """
        return {}

    def close(self) -> Tables:
        """The last rows of the run's tables."""
        return {}

    def documents(self) -> Mapping[str, Any]:
        """What is to be kept beside the tables, by name, before the first round and after the last.

        Each is an object. `explain` tells its fields as they stand: plain values, and objects that have plain
        values by name. Ids of policies are told as their tasks.
        """
        return {}

    def policy(self) -> Policy:
        """What it has learned."""
