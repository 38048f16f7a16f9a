"""Deep Q-network (Mnih et al., 2015) with double targets (van Hasselt, Guez & Silver, 2016)."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.networks import HIDDEN, gradient_step, load_named, mlp
from paddlectl.ranges import Count, Hidden, Kept, Positive, PositiveShare, Share, Steps

Floats = NDArray[np.float32]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class DQNSettings:
    """The numbers of a DQN.

    Attributes:
        learning_rate: Of Adam.
        discount: γ per step.
        batch: Transitions a gradient step.
        capacity: Transitions that are kept.
        warm_up: Transitions before the first update.
        update_every: Transitions between two updates.
        refresh_every: Updates between two copies of the network to the slow one.
        exploration: ε, the share of random choices, at the start.
        final_exploration: ε once `exploration_share` of the budget is used up; it falls in a straight line.
        exploration_share: See there.
        max_gradient_norm: Cut-off of the gradient.
        hidden: Units of each layer.
    """

    learning_rate: Positive = 5e-4
    discount: Share = 0.99
    batch: Count = 256
    capacity: Kept = 100_000
    warm_up: Count = 1000
    update_every: Count = 8
    refresh_every: Count = 250
    exploration: Share = 1.0
    final_exploration: Share = 0.05
    exploration_share: PositiveShare = 0.1
    max_gradient_norm: Positive = 10.0
    hidden: Hidden = HIDDEN


class Batch(NamedTuple):
    """n transitions (s, a, r, s').

    Attributes:
        states: [n, D]
        actions: [n]
        rewards: Discounted sum of what the action earned while it lasted. [n]
        discounts: γ^k of an action that lasted k steps; 0 where nothing is to come after it. [n]
        following: [n, D]
    """

    states: Floats
    actions: Ints
    rewards: Floats
    discounts: Floats
    following: Floats


class DQN:
    """Q(s, a) of a few actions, which may last several steps each (Sutton, Precup & Singh, 1999).

    Args:
        size: D, numbers in a state.
        actions: To choose from.
        seed: Of the network, and of the draws from the replay.
        settings: The numbers.
    """

    def __init__(self, size: int, actions: int, seed: int, settings: DQNSettings) -> None:
        self.settings = settings
        self.rng = np.random.default_rng(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.online = mlp(size, actions, hidden=settings.hidden, output_gain=0.1)
        self.slow = deepcopy(self.online).requires_grad_(False)
        self.optimiser = torch.optim.Adam(self.online.parameters(), lr=settings.learning_rate)
        self.exploration = settings.exploration
        self.updates = 0
        self._kept = Batch(
            np.zeros((settings.capacity, size), np.float32),
            np.zeros(settings.capacity, np.intp),
            np.zeros(settings.capacity, np.float32),
            np.zeros(settings.capacity, np.float32),
            np.zeros((settings.capacity, size), np.float32),
        )
        self._added = 0
        self._due = 0.0

    @torch.no_grad()
    def values(self, states: Floats) -> Floats:
        """Q of every action. [n, D] -> [n, A]"""
        values: Floats = self.online(torch.from_numpy(states)).numpy()
        return values

    def act(
        self,
        states: Floats,
        rng: np.random.Generator,
        allowed: NDArray[np.bool_] | None = None,
        exploration: float | None = None,
    ) -> Ints:
        """The best action, or with probability ε any. [n]

        Args:
            states: [n, D]
            rng: Of the draws.
            allowed: Which actions there are to choose from; all if None. [n, A]
            exploration: ε; that of the moment if None.
        """
        rate = self.exploration if exploration is None else exploration
        values = self.values(states)
        chances = np.ones(values.shape, np.bool_) if allowed is None else allowed
        best = np.where(chances, values, -np.inf).argmax(-1)
        anyhow = np.where(chances, rng.random(values.shape), -1.0).argmax(-1)
        chosen: Ints = np.where(rng.random(len(states)) < rate, anyhow, best)
        return chosen

    def learn(self, batch: Batch) -> None:
        """Keeps transitions, and makes the updates that are due with them."""
        s = self.settings
        places = (self._added + np.arange(len(batch.actions))) % s.capacity
        for name, column in batch._asdict().items():
            getattr(self._kept, name)[places] = column
        self._added += len(places)
        if self._added < s.warm_up:
            return
        due, self._due = divmod(self._due + len(places) / s.update_every, 1.0)
        for _ in range(int(due)):
            drawn = self.rng.integers(min(self._added, s.capacity), size=s.batch)
            states, actions, rewards, discounts, following = self._kept
            self.improve(
                Batch(states[drawn], actions[drawn], rewards[drawn], discounts[drawn], following[drawn])
            )

    def improve(self, batch: Batch) -> None:
        """One gradient step on the Huber loss of Q(s, a) - y."""
        states, actions = torch.from_numpy(batch.states), torch.from_numpy(batch.actions)
        values = self.online(states).gather(-1, actions[:, None])[:, 0]
        loss = functional.smooth_l1_loss(values, self.targets(batch))
        gradient_step(self.optimiser, loss, self.settings.max_gradient_norm)
        self.updates += 1
        if self.updates % self.settings.refresh_every == 0:
            self.slow.load_state_dict(self.online.state_dict())

    @torch.no_grad()
    def targets(self, batch: Batch) -> torch.Tensor:
        """Targets y = r + γ^k Q'(s', argmax_a Q(s', a)), where Q' is the slow network. [n]"""
        following = torch.from_numpy(batch.following)
        chosen = self.online(following).argmax(-1, keepdim=True)
        to_come: torch.Tensor = self.slow(following).gather(-1, chosen)[:, 0]
        return torch.from_numpy(batch.rewards) + torch.from_numpy(batch.discounts) * to_come

    def anneal(self, progress: float) -> None:
        """Sets ε for the share of the budget that is used up, in [0, 1]."""
        s = self.settings
        share = min(progress / s.exploration_share, 1.0)
        self.exploration = s.exploration + share * (s.final_exploration - s.exploration)

    def state(self) -> dict[str, torch.Tensor]:
        """The network's tensors by name."""
        return {f"q.{name}": tensor for name, tensor in self.online.state_dict().items()}

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the network's tensors from `state`, which may hold others too."""
        load_named(self.online, {n.removeprefix("q."): t for n, t in state.items() if n.startswith("q.")})
        self.slow.load_state_dict(self.online.state_dict())


@dataclass(frozen=True)
class StepDQNSettings(DQNSettings):
    """The numbers of a DQN that acts at every step, and so has far more transitions than one that decides.

    A checkpoint holds all that are kept.

    Attributes:
        returns: n of n-step returns.
        final_rate: Share of the learning rate that is left at the end of the budget; it falls in a straight
            line. A constant rate keeps a good policy shaking.
        noise: ε once it has learned: who is greedy alone now and then gets stuck.
    """

    batch: Count = 128
    capacity: Kept = 50_000
    update_every: Count = 16
    exploration_share: PositiveShare = 0.25
    returns: Steps = 5
    final_rate: Share = 0.1
    noise: Share = 0.05

    def learner(self, observation_size: int, actions: int, seed: int) -> "StepDQN":
        """A new learner with these settings."""
        return StepDQN(observation_size, actions, seed, self)


class DQNEvalActor(NamedTuple):
    """An actor that doesn't learn."""

    act: Callable[[Floats, np.random.Generator], tuple[Ints, Floats]]


class StepDQN:
    """A DQN as a learner like others: it acts at every step, and learns block by block."""

    def __init__(self, observation_size: int, actions: int, seed: int, settings: StepDQNSettings) -> None:
        self.settings = settings
        self.dqn = DQN(observation_size, actions, seed, settings)

    def act(self, observations: Floats, rng: np.random.Generator) -> tuple[Ints, Floats]:
        """ε-greedy actions [B], and zeros [B]."""
        return self._act(observations, rng, self.dqn.exploration)

    def eval_actor(self) -> DQNEvalActor:
        """The same actor for evaluation: it explores less."""
        return DQNEvalActor(partial(self._act, exploration=self.settings.noise))

    def teacher_actor(self) -> DQNEvalActor:
        """The same actor as the teacher of another policy."""
        return self.eval_actor()

    @torch.no_grad()
    def values_of(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Q of actions. [n, D], [n] -> [n]"""
        values: torch.Tensor = self.dqn.online(observations).gather(-1, actions[:, None])[:, 0]
        return values

    def update(self, buffer: RolloutBuffer) -> None:
        """Keeps a block of experience, whoever acted, and makes the updates that are due with it."""
        self.dqn.learn(n_step(buffer, self.settings.returns, self.settings.discount))

    def anneal(self, done: float) -> None:
        """Sets ε and the learning rate for the share of the budget that is used up, in [0, 1]."""
        s = self.settings
        self.dqn.anneal(done)
        for group in self.dqn.optimiser.param_groups:
            group["lr"] = s.learning_rate * (1.0 - (1.0 - s.final_rate) * min(done, 1.0))

    def state(self) -> dict[str, torch.Tensor]:
        """The network's tensors by name."""
        return self.dqn.state()

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the network's tensors from `state`."""
        self.dqn.load(state)

    def warm_start(self, state: dict[str, torch.Tensor], logit_scale: float) -> None:
        """Starts from another's network as it is: ε alone says how much it explores."""
        self.load(state)

    def _act(self, observations: Floats, rng: np.random.Generator, exploration: float) -> tuple[Ints, Floats]:
        chosen = self.dqn.act(observations, rng, exploration=exploration)
        return chosen, np.zeros(len(chosen), np.float32)


def n_step(buffer: RolloutBuffer, steps: int, discount: float) -> Batch:
    """The transitions of a block over n steps, or as many as the episode or the block has left.

    Of r_t + γ r_t+1 + … + γ^k max_a Q(s_t+k, a), the last term falls away where the task was solved; at the
    horizon s_t+k is the state that the episode ended in (Pardo et al., 2018).

    Args:
        buffer: T steps of B lanes.
        steps: n.
        discount: γ

    Returns:
        T * B transitions, those of a step together.
    """
    rewards, following = buffer.rewards.copy(), buffer.following()
    discounts = np.where(buffer.terminated, np.float32(0.0), np.float32(discount))
    goes_on = ~buffer.done[:-1]
    for _ in range(steps - 1):
        rewards[:-1][goes_on] = (buffer.rewards[:-1] + discount * rewards[1:])[goes_on]
        discounts[:-1][goes_on] = discount * discounts[1:][goes_on]
        following[:-1][goes_on] = following[1:][goes_on]
    states, actions = buffer.observations, buffer.actions
    return Batch(
        states.reshape(-1, states.shape[-1]),
        actions.ravel(),
        rewards.ravel(),
        discounts.ravel(),
        following.reshape(-1, states.shape[-1]),
    )
