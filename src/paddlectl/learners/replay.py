"""Past transitions to learn from again, and hindsight: what they would have been worth to other goals."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.learners.buffers import RolloutBuffer

Floats = NDArray[np.float32]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]


class Transitions(NamedTuple):
    """A minibatch of n transitions (s, a, r, s').

    Attributes:
        observations: [n, D]
        actions: [n, A]
        rewards: [n]
        ends: 1 where nothing is to come after it, else 0. [n]
        following: The next observation, of the same goal. [n, D]
        steps: Actions from the next observation until the goal was reached; inf where it isn't known to have
            been. [n]
    """

    observations: torch.Tensor
    actions: torch.Tensor
    rewards: torch.Tensor
    ends: torch.Tensor
    following: torch.Tensor
    steps: torch.Tensor


@dataclass(frozen=True)
class Hindsight:
    """How samples are seen with another goal in mind (Andrychowicz et al., 2017).

    Attributes:
        goal_size: An observation begins with so many numbers that say what is achieved and ends with as many
            that say what is desired, as in Gymnasium's goal environments. 0 if there are no goals.
        radius: A goal is reached where the achieved passes by it within this distance.
        reward: Of reaching a goal.
        future: Share of samples that are given a goal which their episode achieved later on.
        others: Share that is given the goal of another sample.
        span: Actions that `future` looks ahead at most.
    """

    goal_size: int = 0
    radius: float = 0.0
    reward: float = 1.0
    future: float = 0.0
    others: float = 0.0
    span: int = 50


class Replay:
    """The latest transitions of B lanes, as a ring of rows in time.

    Each row keeps the state that its own episode came to next, also where the episode ended with it. A goal
    that is reached is terminal, and so is a task that is solved. A decision's end isn't, and neither is the
    horizon: what could have come after it is worth what the critics say of the state that was come to.

    Args:
        capacity: Transitions that are kept.
        num_envs: B.
        observation_size: D.
        actions: Numbers in an action.
        hindsight: How samples are drawn.
    """

    def __init__(
        self, capacity: int, num_envs: int, observation_size: int, actions: int, hindsight: Hindsight
    ) -> None:
        shape = (max(2, capacity // num_envs), num_envs)
        self.hindsight = hindsight
        self.rows = 0  # written so far; row r lies in place r % capacity
        self.observations = np.zeros((*shape, observation_size), np.float32)
        self.following = np.zeros((*shape, observation_size), np.float32)
        self.actions = np.zeros((*shape, actions), np.float32)
        self.rewards = np.zeros(shape, np.float32)
        self.reached = np.zeros(shape, np.bool_)
        self.terminated = np.zeros(shape, np.bool_)
        self.episode = np.zeros(shape, np.intp)
        self._running = np.arange(num_envs)

    def __len__(self) -> int:
        """Transitions that are kept."""
        return min(self.rows, len(self.rewards)) * self.rewards.shape[1]

    def add(self, buffer: RolloutBuffer) -> None:
        """Appends a block of experience, whoever acted."""
        after, done = buffer.following(), buffer.done
        for t in range(len(buffer.actions)):
            place = self.rows % len(self.rewards)
            self.observations[place] = buffer.observations[t]
            self.following[place] = after[t]
            self.actions[place] = buffer.actions[t]
            self.rewards[place] = buffer.rewards[t]
            self.reached[place] = buffer.reached[t]
            self.terminated[place] = buffer.terminated[t]
            self.episode[place] = self._running
            self._running[done[t]] += len(self._running)
            self.rows += 1

    def sample(self, count: int, rng: np.random.Generator) -> Transitions:
        """Draws transitions, some of them with another goal in mind."""
        size, num_envs = min(self.rows, len(self.rewards)), self.rewards.shape[1]
        age, lane = rng.integers(1, size + 1, count), rng.integers(num_envs, size=count)
        at = (self._place(age), lane)
        observations, following = self.observations[at], self.following[at]
        rewards, reached = self.rewards[at], self.reached[at]
        steps = np.where(reached, 0.0, np.inf)
        if g := self.hindsight.goal_size:
            changed, goals, ahead = self._other_goals(age, lane, rng)
            observations[:, -g:] = following[:, -g:] = goals
            near = _passes(observations[:, :g], following[:, :g], goals) <= self.hindsight.radius
            rewards = np.where(changed, self.hindsight.reward * near, rewards)
            reached = np.where(changed, near, reached)
            steps = np.minimum(np.where(reached, 0.0, np.inf), ahead)
        ends = reached | self.terminated[at]
        columns = (observations, self.actions[at], rewards, ends, following, steps)
        return Transitions(*(torch.from_numpy(column.astype(np.float32)) for column in columns))

    def _place(self, age: Ints) -> Ints:
        """Where the row lies that was written `age` rows ago; the newest is 1. [n]"""
        return (self.rows - age) % len(self.rewards)

    def _other_goals(self, age: Ints, lane: Ints, rng: np.random.Generator) -> tuple[Bools, Floats, Floats]:
        """Which samples have another goal, the goals of all, and the actions until hindsight saw it reached.

        Returns:
            [n], [n, G], [n] with inf where hindsight gave no goal.
        """
        rules, at = self.hindsight, (self._place(age), lane)
        kind = rng.random(len(age))
        future = kind < rules.future
        other = ~future & (kind < rules.future + rules.others)
        ahead = self._ahead(age, lane, rng.integers(rules.span, size=len(age)))
        goals = self.observations[at][:, -rules.goal_size :].copy()
        goals[future] = self._achieved(self._place(age - ahead), lane)[future]
        goals[other] = goals[rng.permutation(len(age))][other]
        return future | other, goals, np.where(future, ahead, np.inf).astype(np.float32)

    def _ahead(self, age: Ints, lane: Ints, wanted: Ints) -> Ints:
        """How many rows later a goal is taken from: as wanted, 0 where the episode isn't that long. [n]"""
        there, here = (self._place(np.maximum(age - wanted, 1)), lane), (self._place(age), lane)
        within = (wanted < age) & (self.episode[here] == self.episode[there])
        return np.where(within, wanted, 0)

    def _achieved(self, place: Ints, lane: Ints) -> Floats:
        """What was achieved by these transitions; by one that reached its goal, that goal. [n, G]"""
        g, at = self.hindsight.goal_size, (place, lane)
        return np.where(self.reached[at][:, None], self.observations[at][:, -g:], self.following[at][:, :g])

    def places(self, count: int, rng: np.random.Generator, among: int = 4096) -> Floats:
        """What was achieved, drawn such that each square of side 1/2 comes up as likely as another. [n, G]"""
        size = min(self.rows, len(self.rewards))
        seen = self._achieved(rng.integers(size, size=among), rng.integers(self.rewards.shape[1], size=among))
        squares = np.rint(2 * seen).astype(np.intp) @ 1000 ** np.arange(self.hindsight.goal_size)
        _, first = np.unique(squares, return_index=True)
        chosen: Floats = seen[rng.choice(first, count)]
        return chosen


def _passes(start: Floats, end: Floats, goal: Floats) -> Floats:
    """How near the straight way from start to end passes by a goal. [n, G] each -> [n]"""
    way = end - start
    along = ((goal - start) * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-12)
    nearest = start + along.clip(0.0, 1.0)[:, None] * way
    return np.asarray(np.linalg.norm(nearest - goal, axis=-1), np.float32)
