"""CUP (Zhang et al., "CUP: Critic-Guided Policy Reuse", NeurIPS 2022), over PPO and over TD3.

1. The target π alone acts.
2. The critic Q of π is learned from what came of it.
3. In each state the advantage of source i is A_i(s) = E_{a~π_i} Q(s, a) - E_{a~π} Q(s, a), that of the target
   0. The candidate g of largest advantage guides.
4. β1 min(A_g(s), β2 |V(s)|) D(π, π_g | s) is added to the actor's loss, where V(s) = E_{a~π} Q(s, a). Only D
   has a gradient. PPO's own loss is in deviations of its advantages; so are A and V then (`normalised`).

PPO has no Q: it gets one, learned from each block by expected SARSA (van Seijen et al., 2009), and D is
KL(π || π_g). TD3 has one, and D is the squared distance of the actions over 2σ².
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import torch

from paddlectl.agents.flat import FlatPolicy, FlatSettings, ReusingAgent
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.networks import HIDDEN, gradient_step, mlp
from paddlectl.learners.ppo import PPO
from paddlectl.learners.replay import Transitions
from paddlectl.learners.td3 import TD3
from paddlectl.methods.base import Method, Setup, require_sources
from paddlectl.methods.flat import USUAL
from paddlectl.ranges import Count, Hidden, NotNegative, Positive, Share
from paddlectl.tasks.base import Environment, Task


@dataclass(frozen=True)
class CUPSettings(FlatSettings):
    """The numbers of CUP beside those of its learner; the paper's where it has them.

    Attributes:
        weight: β1.
        cap: β2.
        start: Share of the budget that is used up before sources guide.
        deviation: σ, over TD3.
        normalised: Over PPO, A and V are counted in deviations of what actions were worth beyond V, as PPO
            counts its own advantages. In the paper both losses are in the unit of Q.
        critic_rate: Learning rate of Adam for PPO's Q.
        critic_epochs: Passes of PPO's Q over each block.
        critic_batch: Samples of PPO's Q a gradient step.
        trace_decay: λ of the returns that PPO's Q learns from; 0 is expected SARSA of one step.
        critic_hidden: Units of each layer of PPO's Q.
    """

    weight: NotNegative = 30.0
    cap: NotNegative = 0.003
    start: Share = 0.05
    deviation: Positive = 0.2
    normalised: bool = True
    critic_rate: Positive = 5e-4
    critic_epochs: Count = 2
    critic_batch: Count = 512
    trace_decay: Share = 0.95
    critic_hidden: Hidden = HIDDEN


class Guidance(NamedTuple):
    """Who guides in each of n states, and what it costs not to follow.

    Attributes:
        advantages: Of the candidates: the target, which is 0, and K sources. [n, 1 + K]
        guide: The candidate of largest advantage. [n]
        loss: Mean of β1 min(A_g, β2 |V|) D(π, π_g).
    """

    advantages: torch.Tensor
    guide: torch.Tensor
    loss: torch.Tensor


def guidance(expected: torch.Tensor, distances: torch.Tensor, settings: CUPSettings) -> Guidance:
    """Steps 3 and 4.

    Args:
        expected: E_{a~π_i} Q(s, a) of the candidates, the target first. [n, 1 + K]
        distances: D(π, π_i) to each, with a gradient. [n, 1 + K]
        settings: For β1 and β2.
    """
    expected = expected.detach()
    value = expected[:, 0]
    advantages = expected - value[:, None]
    largest, guide = advantages.max(-1)
    coefficients = settings.weight * torch.minimum(largest, settings.cap * value.abs())
    loss = (coefficients * distances.gather(-1, guide[:, None])[:, 0]).mean()
    return Guidance(advantages, guide, loss)


def over_ppo(
    log_probs: torch.Tensor, sources: torch.Tensor, values: torch.Tensor, settings: CUPSettings
) -> Guidance:
    """By all actions' probabilities.

    Args:
        log_probs: Of the target, with a gradient. [n, A]
        sources: Log-probabilities of the sources. [n, K, A]
        values: Q(s, a). [n, A]
        settings: Of CUP.
    """
    candidates = torch.cat([log_probs.detach()[:, None], sources], 1)
    expected = (candidates.exp() * values[:, None]).sum(-1)
    divergences = (log_probs.exp()[:, None] * (log_probs[:, None] - candidates)).sum(-1)
    return guidance(expected, divergences, settings)


def over_td3(
    actions: torch.Tensor,
    observations: torch.Tensor,
    sources: Sequence[TD3],
    critic: TD3,
    settings: CUPSettings,
) -> Guidance:
    """By the value of each one's action.

    Args:
        actions: Of the target, with a gradient. [n, A]
        observations: [n, D]
        sources: K of them.
        critic: Who values actions.
        settings: Of CUP.
    """
    candidates = [actions.detach(), *(source.actions_of(observations) for source in sources)]
    expected = [critic.values_of(observations, candidate) for candidate in candidates]
    distances = [(actions - candidate).square().sum(-1) for candidate in candidates]
    return guidance(
        torch.stack(expected, -1), torch.stack(distances, -1) / (2.0 * settings.deviation**2), settings
    )


class ActionValues:
    """Q(s, a) of all actions, for PPO, which has none.

    Args:
        size: D, numbers in a state.
        actions: A, to choose from.
        discount: γ
        settings: Of CUP.
        rng: Of its network, and of its minibatches.
    """

    def __init__(
        self, size: int, actions: int, discount: float, settings: CUPSettings, rng: np.random.Generator
    ) -> None:
        self.discount = discount
        self.settings = settings
        self.rng = rng
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**32)))
            self.network = mlp(size, actions, hidden=settings.critic_hidden, output_gain=0.1)
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=settings.critic_rate)

    @torch.no_grad()
    def values(self, states: torch.Tensor) -> torch.Tensor:
        """[n, D] -> [n, A]"""
        values: torch.Tensor = self.network(states)
        return values

    def update(self, buffer: RolloutBuffer, targets: torch.Tensor) -> None:
        """Step 2: some passes over what was done in one block, and what it was worth. [T, B]"""
        states = torch.from_numpy(buffer.observations).flatten(0, 1)
        actions = torch.from_numpy(buffer.actions).flatten()
        count = max(1, round(len(actions) / self.settings.critic_batch))
        targets = targets.flatten()
        for _ in range(self.settings.critic_epochs):
            for batch in torch.from_numpy(self.rng.permutation(len(actions))).chunk(count):
                values = self.network(states[batch]).gather(-1, actions[batch, None])[:, 0]
                gradient_step(self.optimiser, (values - targets[batch]).square().mean())

    @torch.no_grad()
    def targets(self, buffer: RolloutBuffer, policy: PPO) -> torch.Tensor:
        """Targets y = r + γ E_{a'~π} Q(s', a'), or with a trace r + γ ((1 - λ) E_{a'~π} Q(s', a') + λ y').

        Nothing is to come after a task that is solved; the horizon is no end. [T, B]
        """
        rewards, ends, terminated = map(torch.from_numpy, (buffer.rewards, buffer.ends, buffer.terminated))
        following = torch.from_numpy(buffer.following())
        expected = (policy.log_probs(following).exp() * self.values(following)).sum(-1) * ~terminated
        targets, later = torch.empty_like(rewards), expected[-1]
        for t in reversed(range(len(rewards))):
            traced = torch.lerp(expected[t], later, self.settings.trace_decay)
            targets[t] = later = rewards[t] + self.discount * torch.where(ends[t], expected[t], traced)
        return targets


class CUPAgent(ReusingAgent):
    """A target that acts alone (step 1), and is drawn to who guides."""

    settings: CUPSettings

    def __init__(
        self, policy: FlatPolicy, rng: np.random.Generator, sources: Mapping[str, FlatPolicy], frames: int
    ) -> None:
        super().__init__(policy, rng, sources, frames)
        assert isinstance(policy.settings, CUPSettings)
        self.settings = policy.settings
        self._guided = False

    def update(self, environment: Environment, progress: float) -> Mapping[str, float]:
        """One update, guided once enough of the budget is used up."""
        self._guided = progress >= self.settings.start
        return super().update(environment, progress)

    def _figures(self, found: Guidance, rows: int) -> Mapping[str, float]:
        """Takes down who guides in the latest rows of the block."""
        advantages, guide = found.advantages.numpy(), found.guide.numpy()
        valuations = self._valuations[-rows:].reshape(len(guide), -1)
        self._recorder.add(valuations, guide, advantages, {"advantage": advantages})
        return {"guided": float((guide > 0).mean())}


class CUPOverPPO(CUPAgent):
    """With a critic of its own. The sources are asked once a block."""

    def __init__(
        self, policy: FlatPolicy, rng: np.random.Generator, sources: Mapping[str, FlatPolicy], frames: int
    ) -> None:
        super().__init__(policy, rng, sources, frames)
        (critic_rng,) = rng.spawn(1)
        environment = policy.task.make(1, 0)
        learner = cast(PPO, policy.learner)
        self.critic = ActionValues(
            environment.flat_size,
            environment.actions.size,
            learner.settings.discount,
            self.settings,
            critic_rng,
        )

    def _learn(self, environment: Environment) -> Mapping[str, float]:
        buffer, learner = self._buffer, cast(PPO, self._policy.learner)
        targets = self.critic.targets(buffer, learner)
        self.critic.update(buffer, targets)
        if not self._guided:
            learner.update(buffer)
            return {"guided": 0.0}
        states = torch.from_numpy(buffer.observations).flatten(0, 1)
        values = self.critic.values(states)
        with torch.no_grad():
            own, *others = (each.log_probs(states) for each in cast(list[PPO], [learner, *self._sources]))
        sources = torch.stack(others, 1)
        beyond = targets.flatten() - (own.exp() * values).sum(-1)
        counted = values / (beyond.std(correction=0) + 1e-8) if self.settings.normalised else values

        def loss(places: torch.Tensor, log_probs: torch.Tensor) -> torch.Tensor:
            return over_ppo(log_probs, sources[places], counted[places], self.settings).loss

        learner.update(buffer, loss)
        return self._figures(over_ppo(own, sources, values, self.settings), self.rollout_steps)


class CUPOverTD3(CUPAgent):
    """By TD3's own critics."""

    def _learn(self, environment: Environment) -> Mapping[str, float]:
        learner = cast(TD3, self._policy.learner)
        if not self._guided:
            learner.update(self._buffer)
            return {"guided": 0.0}
        sources = cast(list[TD3], self._sources)

        def loss(batch: Transitions, actions: torch.Tensor) -> torch.Tensor:
            return over_td3(actions, batch.observations, sources, learner, self.settings).loss

        learner.update(self._buffer, loss)
        latest = torch.from_numpy(self._buffer.observations[-1])
        own = learner.actions_of(latest)
        return self._figures(over_td3(own, latest, sources, learner, self.settings), 1)


OVER = {"ppo": CUPOverPPO, "td3": CUPOverTD3}


def make(setup: Setup) -> CUPAgent:
    """The target, and the policies that may guide it.

    Raises:
        UsageError: If there are none.
    """
    require_sources("cup", setup)
    task = setup.task
    policy = FlatPolicy(task, setup.seed, setup.settings)
    rng = np.random.default_rng(np.random.SeedSequence(setup.seed).spawn(2)[1])
    sources = {source.id: cast(FlatPolicy, source.policy) for source in setup.sources}
    return OVER[task.learner](policy, rng, sources, setup.frames)


TUNED: Mapping[str, Mapping[str, Any]] = {"ppo": {"weight": 100.0, "critic_epochs": 6}, "td3": {}}
"""By learner, what `benchmarks/tuning/cup.yaml` found better than the paper's: PPO sees a state a few times,
SAC and TD3, which the paper has CUP over, many times."""


def _usual(task: Task) -> CUPSettings:
    return CUPSettings(**vars(USUAL[task.learner]), **TUNED[task.learner])


CUP = Method.of_usual("cup", _usual, make, FlatPolicy)
