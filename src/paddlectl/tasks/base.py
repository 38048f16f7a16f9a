"""What a task is to the rest of the package: symbols, subgoals, and a batch of environments."""

import json
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from paddlectl.logic.atoms import Atom, Literal

Split = typing.Literal["training", "evaluation"]
"""Layouts are split by value: an eighth of them is for evaluation alone and is never drawn in training."""

Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Vocabulary:
    """The body atoms that the encoder E(s) answers, in a fixed order.

    Attributes:
        atoms: One ground atom for each column of a valuation.
        exclusions: Sets of literals that never hold together in a state where a decision is made.
    """

    atoms: tuple[Atom, ...]
    exclusions: tuple[frozenset[Literal], ...] = ()


@dataclass(frozen=True)
class Actions:
    """What one lane takes in a step.

    Attributes:
        size: How many actions there are to choose from; of a continuous one, how many numbers in [-1, 1]
            it consists of.
    """

    size: int
    continuous: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one action."""
        return (self.size,) if self.continuous else ()

    @property
    def dtype(self) -> type[np.generic]:
        return np.float32 if self.continuous else np.int64

    def checked(self, actions: Any, lanes: tuple[int, ...] = ()) -> NDArray[Any]:
        """Actions as an array, none of which is changed.

        Args:
            actions: An action, or one for each lane. [...] or [B, ...]
            lanes: Empty, or (B,).

        Raises:
            ValueError: If they have another shape, aren't numbers (whole ones, unless continuous), or one
                isn't among those that there are to choose from.
        """
        try:
            given = np.asarray(actions)
        except ValueError:  # rows of unequal length
            given = np.asarray(actions, dtype=object)
        low, high = (-1, 1) if self.continuous else (0, self.size - 1)
        shape = (*lanes, *self.shape)
        if given.shape != shape or given.dtype.kind not in ("fiu" if self.continuous else "iu"):
            found = f"{given.dtype} of shape {given.shape}"
            raise ValueError(f"actions are {self._range} of shape {shape}, not {found}")
        if not (given.min() >= low and given.max() <= high):  # so that NaN is refused, too
            wrong = given[~((given >= low) & (given <= high))][0]
            raise ValueError(f"actions are {self._range}, not {wrong}")
        return given

    @property
    def _range(self) -> str:
        return "numbers in [-1, 1]" if self.continuous else f"whole numbers in 0..{self.size - 1}"

    def sample(self, rng: np.random.Generator, num_envs: int) -> NDArray[Any]:
        """An action for each lane, uniformly. [B, ...]"""
        if self.continuous:
            return rng.uniform(-1.0, 1.0, (num_envs, self.size)).astype(np.float32)
        return rng.integers(self.size, size=num_envs)


class Step(NamedTuple):
    """One step of all lanes.

    Attributes:
        reward: Extrinsic reward, milestones included. [B]
        score: The final reward alone: > 0 in the step that solves the task, else 0. [B]
        terminated: The episode came to its end in this step: the task was solved, or can't be any more. [B]
        truncated: The horizon was reached unsolved. [B]
    """

    reward: Floats
    score: Floats
    terminated: Bools
    truncated: Bools

    def then(self, other: "Step") -> "Step":
        """Both steps as one."""
        return Step(
            self.reward + other.reward,
            self.score + other.score,
            self.terminated | other.terminated,
            self.truncated | other.truncated,
        )


class Environment(Protocol):
    """B lanes of one task, stepped together. A finished lane stays as it is until `reset`.

    Subgoals are given as indices into `Task.domain_subgoals`, one a lane. [B]

    One that can't be put back where it was, for a stopped run to go on, has `exact`, which is False.

    One whose episodes can be played again has `start(lane)`, a JSON object that tells how the lane's episode
    began, and `begin(start)`, which begins an episode so in all lanes; it raises LookupError, TypeError or
    ValueError for what `start` can't have told.

    Attributes:
        num_envs: B.
        observation_size: D.
        flat_size: F.
        actions: What `step` takes of each lane.
        action_repeat: Steps of the task that one action lasts, unless the episode ends before.
        t: Steps of the task since each lane's start. [B]
    """

    num_envs: int
    observation_size: int
    flat_size: int
    actions: Actions
    action_repeat: int
    t: Ints

    def reset(self, lanes: Bools | None = None) -> None:
        """Draws new layouts for the masked lanes; for all if None. [B]"""

    def step(self, actions: NDArray[Any]) -> Step:
        """Applies one action a lane, for `action_repeat` steps. [B, ...]"""

    def valuation(self) -> Bools:
        """E(s): the truth of every atom of the vocabulary, in its order. [B, P]"""

    def observe(self, subgoals: Ints) -> Floats:
        """What the low level sees: the state mapped by each lane's subgoal, in a frame of its own. [B, D]"""

    def flat_state(self) -> Floats:
        """The whole state, in which no subgoal shows; the same numbers for all tasks of a domain. [B, F]"""

    def distance(self, subgoals: Ints) -> Floats:
        """About how many steps what each lane's subgoal acts on is away; 0 if there is no such thing. [B]

        Asked only where the intrinsic reward is shaped by it (`DecisionSettings.shaping`).
        """
        raise NotImplementedError

    def in_world(self, subgoals: Ints, actions: NDArray[Any]) -> NDArray[Any]:
        """Actions chosen by what `observe` shows, as `step` takes them. [B, ...]"""

    def reached(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal holds in the present state. [B]"""

    def available(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal has something to act on and doesn't hold already. [B]

        The initiation set of the subgoal taken as an option (Sutton, Precup & Singh, 1999).
        """


FRAMES = 100_000
"""The usual budget of learning a source, in environment steps."""


class Make(Protocol):
    """Makes a reset environment; equal seeds give equal layouts, all of them of the split."""

    def __call__(
        self, num_envs: int, seed: int, action_repeat: int = 1, split: Split = "training"
    ) -> Environment: ...


@dataclass(frozen=True)
class Task:
    """A task by its symbols, and how to make its environments.

    Attributes:
        name: As typed on the command line, `BoxDoor`.
        domain: Policies are interchangeable within one, `minigrid`.
        summary: One line for a reader.
        horizon: Steps after which an episode is truncated.
        vocabulary: The body atoms.
        subgoals: The subgoals that its programs may name.
        domain_subgoals: All subgoals of the domain; fixes the order of the one-hot in observations.
        make: Its environments.
        learner: Of the low level that fits its actions, `ppo` or `td3`.
        frames: The usual budget of learning it, in environment steps; a method may have its own.
    """

    name: str
    domain: str
    summary: str
    horizon: int
    vocabulary: Vocabulary
    subgoals: tuple[Atom, ...]
    domain_subgoals: tuple[Atom, ...]
    make: Make
    learner: str = "ppo"
    frames: int = FRAMES

    @property
    def definition(self) -> Mapping[str, Any] | None:
        """What the registry keeps of a task from a file; None of one that is found by its name."""
        return None


@dataclass(frozen=True)
class DefinedTask(Task):
    """A task from a file.

    Attributes:
        told: What the registry keeps of it, as JSON.
    """

    told: str = "{}"

    @property
    def definition(self) -> Mapping[str, Any]:
        definition: Mapping[str, Any] = json.loads(self.told)
        return definition


class Definition(Protocol):
    """What a task file says.

    Attributes:
        MADE_BY: `module:function` that makes the task of it.
        ENVIRONMENT: `module:class` of its Gymnasium environment.
        name: The task's.
    """

    MADE_BY: ClassVar[str]
    ENVIRONMENT: ClassVar[str]

    @property
    def name(self) -> str: ...

    def document(self) -> dict[str, Any]:
        """All that a task file may say of it, nothing left to be filled in."""


@dataclass(frozen=True)
class Defined:
    """A task as a file defines it. It prints as its name.

    Attributes:
        file: Where that was read; empty if it is from a registry.
    """

    spec: Definition
    file: str = field(default="", compare=False)

    def __str__(self) -> str:
        return self.spec.name
