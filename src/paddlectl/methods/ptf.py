"""PTF (Yang et al., 2020): options decide which source the target imitates, and how much.

The target acts. In each step (s, a, r, s') of their Algorithms 1 and 2:

1. At the start of an episode, else with probability β(s, o), the option o is picked anew, ε-greedily by Q.
   An option stands for a source.
2. Q(s, o), and Q of each source that would have done the same, learns towards r + γ U(s', ·), where
   U(s', o) = (1 - β(s', o)) Q'(s', o) + β(s', o) Q'(s', argmax Q(s', ·)) and Q' is a slow copy.
3. β descends β(s', o) · (Q(s', o) - max Q(s', ·) + ξ), unless the episode ended with the step.
4. The target descends its own loss + c1 · f(t) · (1 - β(s, o)) · H(π_o, π), where H is the cross entropy and
   f(t) = 0.5 + tanh(3 - c3 · episode) / 2.

No option has a say in what is done. So step 1 is made up for once a block is complete.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from math import tanh
from typing import Any, NamedTuple

import numpy as np
import torch

from paddlectl.agents.flat import FlatPolicy, FlatSettings, ReusingAgent
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.networks import HIDDEN, gradient_step, mlp
from paddlectl.learners.replay import Hindsight, Replay, Transitions
from paddlectl.methods import flat
from paddlectl.methods.base import Method, Setup, require_sources
from paddlectl.ranges import Count, Hidden, Kept, NotNegative, Positive, Share
from paddlectl.tasks.base import Bools, Environment, Floats, Ints, Task


@dataclass(frozen=True)
class OptionSettings:
    """The paper's values where it has them.

    Attributes:
        learning_rate: Of Adam, for Q.
        termination_rate: Of plain gradient descent, for β.
        discount: γ per action.
        batch: Transitions a gradient step.
        update_every: Transitions between two updates; the paper has one after each.
        refresh_every: Updates between two copies of Q to the slow one; in the paper 1,000, which are as many
            transitions. A thousand of these would be as good as never.
        capacity: Transitions that are kept.
        exploration: ε, the share of random picks, at the start.
        exploration_fall: By which it falls with each episode.
        final_exploration: Down to this.
        imitation: c1, weight of the cross entropy.
        decay: c3, by which the imitation ends with the episodes.
        regulariser: ξ. The best option isn't ended, nor one that is hardly worse.
        deviation: σ of a source's continuous actions.
        hidden: Units of each layer of Q, and of β.
    """

    learning_rate: Positive = 1e-3
    termination_rate: Positive = 0.1
    discount: Share = 0.99
    batch: Count = 64
    update_every: Count = 128
    refresh_every: Count = 32
    capacity: Kept = 50_000
    exploration: Share = 1.0
    exploration_fall: NotNegative = 1e-3
    final_exploration: Share = 0.05
    imitation: NotNegative = 1.0
    decay: NotNegative = 1e-3
    regulariser: NotNegative = 0.005
    deviation: Positive = 0.2
    hidden: Hidden = HIDDEN


@dataclass(frozen=True)
class PTFSettings(FlatSettings):
    """Every number of PTF; but for `options` they are those of the flat learner."""

    options: OptionSettings = field(default_factory=OptionSettings)


class Arrivals(NamedTuple):
    """n states and the options by which they were come to.

    Attributes:
        states: [n, D]
        options: [n]
        advantages: Q(s', o) - max Q(s', ·); of no matter where an episode begins. [n]
        within: Not where an episode begins. [n]
    """

    states: torch.Tensor
    options: torch.Tensor
    advantages: torch.Tensor
    within: torch.Tensor


class Options:
    """Q(s, o) and β(s, o) of K options.

    Args:
        size: D, numbers in a state.
        num_envs: B.
        count: K.
        seed: Of the networks, and of the draws from the replay.
        settings: The numbers.
    """

    def __init__(self, size: int, num_envs: int, count: int, seed: int, settings: OptionSettings) -> None:
        self.settings = settings
        self.rng = np.random.default_rng(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.online = mlp(size, count, hidden=settings.hidden, output_gain=0.01)
            self.termination = mlp(size, count, hidden=settings.hidden, output_gain=0.01)
        self.slow = deepcopy(self.online).requires_grad_(False)
        self.online_optimiser = torch.optim.Adam(
            self.online.parameters(), lr=settings.learning_rate, fused=True
        )
        # as the paper has it: the steps of Adam are as large where two values differ by noise alone, and a β
        # that has come near 0 or 1 hardly leaves it
        self.termination_optimiser = torch.optim.SGD(
            self.termination.parameters(), lr=settings.termination_rate
        )
        self.replay = Replay(settings.capacity, num_envs, size, count, Hindsight())
        self.updates = 0
        self._due = 0.0

    @torch.no_grad()
    def values(self, states: torch.Tensor) -> torch.Tensor:
        """Q(s, ·). [n, D] -> [n, K]"""
        values: torch.Tensor = self.online(states)
        return values

    @torch.no_grad()
    def terminations(self, states: torch.Tensor) -> torch.Tensor:
        """β(s, ·). [n, D] -> [n, K]"""
        terminations: torch.Tensor = self.termination(states).sigmoid()
        return terminations

    def learn(self, block: RolloutBuffer, alike: Bools, arrivals: Arrivals) -> None:
        """Keeps a block and makes the updates that are due with it.

        Args:
            block: [T, B]
            alike: Which options learn from a transition. [T, B, K]
            arrivals: The block's states.
        """
        s = self.settings
        self.replay.add(replace(block, actions=alike))  # in place of what was done: who would have done it
        due, self._due = divmod(self._due + block.rewards.size / s.update_every, 1.0)
        for _ in range(int(due)):
            self.improve_values(self.replay.sample(s.batch, self.rng))
            drawn = torch.from_numpy(self.rng.integers(block.rewards.size, size=s.batch))
            self.improve_termination(Arrivals(*(column[drawn] for column in arrivals)))

    def improve_values(self, batch: Transitions) -> None:
        """One gradient step on (Q(s, o) - y)² of the options that `batch.actions` [n, K] marks."""
        errors = self.online(batch.observations) - self.targets(batch)
        gradient_step(self.online_optimiser, (batch.actions * errors.square()).sum(-1).mean())
        self.updates += 1
        if self.updates % self.settings.refresh_every == 0:
            self.slow.load_state_dict(self.online.state_dict())

    @torch.no_grad()
    def targets(self, batch: Transitions) -> torch.Tensor:
        """Targets y = r + γ U(s', ·). [n, K]"""
        values, ending = self.slow(batch.following), self.terminations(batch.following)
        best = values.gather(-1, self.values(batch.following).argmax(-1, keepdim=True))
        to_come = (1.0 - ending) * values + ending * best
        goes_on = self.settings.discount * (1.0 - batch.ends)
        targets: torch.Tensor = batch.rewards[:, None] + goes_on[:, None] * to_come
        return targets

    def improve_termination(self, arrivals: Arrivals) -> None:
        """One gradient step on β(s', o) · (A(s', o) + ξ)."""
        ending = of_options(self.termination(arrivals.states).sigmoid(), arrivals.options)
        losses = ending * (arrivals.advantages + self.settings.regulariser)
        gradient_step(self.termination_optimiser, (arrivals.within * losses).mean())


def of_options(columns: torch.Tensor, options: torch.Tensor) -> torch.Tensor:
    """Each row's entry of its option. [n, K, ...], [n] -> [n, ...]"""
    return columns[torch.arange(len(options)), options]


def decay(episode: int, slope: float) -> float:
    """f(t), from 1 to 0."""
    return 0.5 + tanh(3.0 - slope * episode) / 2.0


class PTFAgent(ReusingAgent, ABC):
    """All but what depends on the kind of actions.

    Args:
        setup: With a source at least.
    """

    _sources: list[Any]

    def __init__(self, setup: Setup) -> None:
        _, actions, picks = np.random.SeedSequence(setup.seed).spawn(3)
        policy = FlatPolicy(setup.task, setup.seed, setup.settings)
        sources: dict[str, Any] = {source.id: source.policy for source in setup.sources}
        super().__init__(policy, np.random.default_rng(actions), sources, setup.frames)
        num_envs, size = self._buffer.last_observations.shape
        self._settings: OptionSettings = setup.settings.options
        self._options = Options(size, num_envs, len(sources), setup.seed, self._settings)
        self._picks = np.random.default_rng(picks)
        self._current: Ints = np.zeros(num_envs, np.intp)
        self._begins = np.ones(num_envs, np.bool_)
        self._episodes = 0

    def _learn(self, environment: Environment) -> Mapping[str, float]:
        """The four steps, each for the whole block."""
        block, options = self._buffer, self._options
        states = torch.from_numpy(block.observations).flatten(0, 1)
        values, ending = options.values(states), options.terminations(states)
        weight = self._settings.imitation * decay(self._episodes, self._settings.decay)

        by, current, within = self.follow(*(self._by_step(column) for column in (values, ending)))
        answers = self.answers(states)
        alike = self.alike(answers, torch.from_numpy(block.actions).flatten(0, 1))
        alike[torch.arange(len(alike)), current] = True
        advantages = of_options(values, by) - values.amax(-1)
        options.learn(block, self._by_step(alike), Arrivals(states, by, advantages, within))
        weights = weight * (1.0 - of_options(ending, current))
        learner: Any = self._policy.learner
        learner.update(block, self.imitation(of_options(answers, current), weights, weight))

        self._episodes += int(block.done.sum())
        terms = {"option_value": _beside_target(values), "termination": _beside_target(ending)}
        valuations = self._valuations.reshape(len(states), -1)
        self._recorder.add(valuations, current.numpy() + 1, terms["option_value"], terms)
        return {"imitation": float(weights.mean())}

    def follow(self, values: Floats, ending: Floats) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Step 1 in each step of the block.

        Args:
            values: Q of each state. [T, B, K]
            ending: β. [T, B, K]

        Returns:
            By which option each state was come to, which is current there, and whether no episode begins
            there. [T * B] each
        """
        by, current = np.zeros((2, *values.shape[:2]), np.intp)
        begins = np.concatenate([self._begins[None], self._buffer.done])
        lanes = np.arange(len(self._current))
        for t in range(len(values)):
            by[t] = self._current
            anew = begins[t] | (self._picks.random(len(lanes)) < ending[t, lanes, by[t]])
            current[t] = self._current = np.where(anew, self.pick(values[t]), by[t])
        self._begins = begins[-1]
        came, now, within = (torch.from_numpy(column).flatten() for column in (by, current, ~begins[:-1]))
        return came, now, within

    def pick(self, values: Floats) -> Ints:
        """The option of largest value, or with probability ε any. [B, K] -> [B]"""
        s = self._settings
        exploration = max(s.final_exploration, s.exploration - s.exploration_fall * self._episodes)
        anyhow = self._picks.random(len(values)) < exploration
        picked: Ints = np.where(
            anyhow, self._picks.integers(values.shape[1], size=len(values)), values.argmax(-1)
        )
        return picked

    @abstractmethod
    def answers(self, states: torch.Tensor) -> torch.Tensor:
        """What each source says of each state. [n, D] -> [n, K, A]"""

    @abstractmethod
    def alike(self, answers: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Which sources would have done the same. [n, K, A], [n, ...] -> [n, K]"""

    @abstractmethod
    def imitation(
        self, answers: torch.Tensor, weights: torch.Tensor, weight: float
    ) -> Callable[[Any, torch.Tensor], torch.Tensor]:
        """The loss to add to the target's.

        Args:
            answers: Of the source that was current, in each state of the block. [T * B, A]
            weights: c1 · f(t) · (1 - β(s, o)). [T * B]
            weight: c1 · f(t)
        """

    def _by_step(self, column: torch.Tensor) -> Any:
        """[T * B, K] -> [T, B, K]"""
        return column.reshape(*self._buffer.rewards.shape, -1).numpy()


class PTFOverPPO(PTFAgent):
    """Imitates, in each sample, the option that was current when it was collected."""

    @torch.no_grad()
    def answers(self, states: torch.Tensor) -> torch.Tensor:
        """Probabilities of the actions."""
        return torch.stack([source.log_probs(states) for source in self._sources], 1).exp()

    def alike(self, answers: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Those whose likeliest action it is."""
        return answers.argmax(-1) == actions[:, None]

    def imitation(
        self, answers: torch.Tensor, weights: torch.Tensor, weight: float
    ) -> Callable[[torch.Tensor, torch.Tensor], torch.Tensor]:
        """Cross entropy of places in the block and of the target's log-probabilities there [n, A]."""

        def loss(places: torch.Tensor, log_probs: torch.Tensor) -> torch.Tensor:
            return -(weights[places] * (answers[places] * log_probs).sum(-1)).mean()

        return loss


class PTFOverTD3(PTFAgent):
    """Imitates, in each state of a minibatch, the option that is greedy there now.

    Which one was current when an old transition was collected says little of the target of today. A source
    is taken as a Gaussian around its action.
    """

    @torch.no_grad()
    def answers(self, states: torch.Tensor) -> torch.Tensor:
        """Actions."""
        return torch.stack([source.actions_of(states) for source in self._sources], 1)

    def alike(self, answers: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Those within σ of it, in every dimension."""
        return ((answers - actions[:, None]).abs() <= self._settings.deviation).all(-1)

    def imitation(
        self, answers: torch.Tensor, weights: torch.Tensor, weight: float
    ) -> Callable[[Transitions, torch.Tensor], torch.Tensor]:
        """Cross entropy, but for a constant, of a minibatch and of the target's actions there [n, A]."""
        options, variance = self._options, self._settings.deviation**2

        def loss(batch: Transitions, actions: torch.Tensor) -> torch.Tensor:
            states = batch.observations
            greedy = options.values(states).argmax(-1)
            follow = weight * (1.0 - of_options(options.terminations(states), greedy))
            errors = actions - of_options(self.answers(states), greedy)
            return (follow * errors.square().sum(-1)).mean() / (2.0 * variance)

        return loss


def _beside_target(columns: torch.Tensor) -> Floats:
    """With zeros for the target, which is no option. [n, K] -> [n, 1 + K]"""
    return np.pad(columns.numpy(), ((0, 0), (1, 0)))


def make(setup: Setup) -> PTFAgent:
    """A flat learner and an option for each source.

    Raises:
        UsageError: Without sources.
    """
    require_sources("ptf", setup)
    continuous = setup.task.make(1, 0).actions.continuous
    return PTFOverTD3(setup) if continuous else PTFOverPPO(setup)


OPTIONS = {
    "ppo": OptionSettings(termination_rate=0.03),
    "td3": OptionSettings(update_every=16, imitation=0.01),
}
"""The authors' c1 for continuous actions is 0.001 to 0.01. That over PPO options end less often, is by
`benchmarks/tuning/ptf.yaml`."""


def _usual(task: Task) -> PTFSettings:
    return PTFSettings(**vars(flat.USUAL[task.learner]), options=OPTIONS[task.learner])


PTF = Method.of_usual("ptf", _usual, make, FlatPolicy)
