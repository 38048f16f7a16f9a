"""What a task is to the rest of the house: symbols, subgoals, and a batch of environments."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from paddlectl.logic.atoms import Atom, Literal

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


class Step(NamedTuple):
    """One step of all lanes.

    Attributes:
        reward: Extrinsic reward, milestones included. [B]
        score: The final reward alone: > 0 in the step that solves the task, else 0. [B]
        terminated: The task was solved in this step. [B]
        truncated: The horizon was reached unsolved. [B]
    """

    reward: Floats
    score: Floats
    terminated: Bools
    truncated: Bools


class Environment(Protocol):
    """B lanes of one task, stepped together. A finished lane stays as it is until `reset`.

    Heads are given as indices into `Task.domain_heads`, one a lane. [B]
    """

    lanes: int
    observation_size: int
    actions: int

    def reset(self, lanes: Bools | None = None) -> None:
        """Draws new layouts for the masked lanes; for all if None. [B]"""

    def step(self, actions: Ints) -> Step:
        """Applies one action a lane. [B]"""

    def valuation(self) -> Bools:
        """E(s): the truth of every atom of the vocabulary, in its order. [B, P]"""

    def observe(self, heads: Ints) -> Floats:
        """What the low level sees: the state mapped by each lane's subgoal, in a frame of its own. [B, D]"""

    def in_world(self, heads: Ints, actions: Ints) -> Ints:
        """Actions chosen by what `observe` shows, as `step` takes them. [B]"""

    def reached(self, heads: Ints) -> Bools:
        """Whether each lane's subgoal holds in the present state. [B]"""

    def available(self, heads: Ints) -> Bools:
        """Whether each lane's subgoal has something to act on and doesn't hold already. [B]

        The initiation set of the subgoal taken as an option (Sutton, Precup & Singh, 1999).
        """


@dataclass(frozen=True)
class Task:
    """A task by its symbols, and how to make its environments.

    Attributes:
        name: As typed on the command line, `BoxDoor`.
        domain: Policies are interchangeable within one, `minigrid`.
        summary: One line for a reader.
        horizon: Steps after which an episode is truncated.
        vocabulary: The body atoms.
        heads: The subgoals that its programs may name.
        domain_heads: All subgoals of the domain; fixes the order of the one-hot in observations.
        make: `make(lanes, seed)` gives a reset environment; equal seeds give equal layouts.
    """

    name: str
    domain: str
    summary: str
    horizon: int
    vocabulary: Vocabulary
    heads: tuple[Atom, ...]
    domain_heads: tuple[Atom, ...]
    make: Callable[[int, int], Environment]
