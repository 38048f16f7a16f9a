"""Proximal policy optimisation (Schulman et al., 2017) for the low level."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from paddlectl.learners.buffers import TARGET, RolloutBuffer, generalised_advantages
from paddlectl.learners.networks import HIDDEN, gradient_step, load_named, mlp
from paddlectl.ranges import Count, Hidden, NotNegative, Positive, Share

Guidance = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""A loss to add to the actor's, of the places [n] of a minibatch's samples in the flattened block, [T * B],
and of the actor's log-probabilities there [n, A]."""


@dataclass(frozen=True)
class PPOSettings:
    """Table 1's values where it has them; the others are the usual ones.

    Attributes:
        learning_rate: Of RMSProp, for both networks, at the start.
        final_rate: Share of it that is left at the end of the budget; it falls in a straight line. A
            constant rate keeps a good policy shaking: now and then it stalls before a door.
        discount: γ_l per step.
        trace_decay: λ of GAE.
        clip: Of the probability ratio.
        entropy_coef: Weight of the policy's entropy.
        value_coef: Weight of the value loss.
        epochs: Passes over each batch.
        minibatch: Samples a gradient step.
        max_gradient_norm: Cut-off of the gradient.
        clone_coef: Weight of the log-likelihood of guided actions that reached their subgoal.
        sharpness: Power of the action probabilities once it has learned.
        hidden: Units of each layer, of both networks.
    """

    learning_rate: Positive = 5e-4
    final_rate: Share = 0.05
    discount: Share = 0.99
    trace_decay: Share = 0.95
    clip: Positive = 0.2
    entropy_coef: NotNegative = 0.01
    value_coef: NotNegative = 0.5
    epochs: Count = 4
    minibatch: Count = 512
    max_gradient_norm: Positive = 0.5
    clone_coef: NotNegative = 0.5
    sharpness: NotNegative = 2.0
    hidden: Hidden = HIDDEN

    def learner(self, observation_size: int, actions: int, seed: int) -> "PPO":
        """A new learner with these settings."""
        return PPO(observation_size, actions, seed, self)


class PPOEvalActor(NamedTuple):
    """An actor that doesn't learn."""

    act: Callable[[NDArray[np.float32], np.random.Generator], tuple[NDArray[np.int64], NDArray[np.float32]]]


class PPO:
    """A discrete actor and a critic, each with its own network.

    Learns from the target's own samples by the clipped surrogate, and from those of its guides that
    reached their subgoal by cloning.

    Args:
        observation_size: D.
        actions: A.
        seed: Of the networks, and of the minibatches.
        settings: The numbers.
        actor: Makes the network of the A logits from D and A; None is one that has no preferences yet.
    """

    def __init__(
        self,
        observation_size: int,
        actions: int,
        seed: int,
        settings: PPOSettings | None = None,
        actor: Callable[[int, int], nn.Module] | None = None,
    ) -> None:
        self.settings = settings or PPOSettings()
        self.rng = np.random.default_rng(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            hidden = self.settings.hidden
            actor = actor or partial(mlp, hidden=hidden, output_gain=0.01)
            self.actor = actor(observation_size, actions)
            self.critic = mlp(observation_size, 1, hidden=hidden)
        self.optimiser = torch.optim.RMSprop(
            [*self.actor.parameters(), *self.critic.parameters()],
            lr=self.settings.learning_rate,
            alpha=0.99,
            eps=1e-5,
        )

    def act(
        self, observations: NDArray[np.float32], rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Samples actions [B] and their log-probabilities [B] for observations [B, D]."""
        return _sample(self.actor, observations, rng, 1.0)

    def eval_actor(self) -> "PPOEvalActor":
        """The same actor for evaluation: it explores less."""
        return PPOEvalActor(partial(_sample, self.actor, sharpness=self.settings.sharpness))

    def teacher_actor(self) -> "PPOEvalActor":
        """The same actor as the teacher of another policy: as it learned, so that it hardly gets stuck."""
        return PPOEvalActor(partial(_sample, self.actor, sharpness=1.0))

    def log_probs(self, observations: torch.Tensor) -> torch.Tensor:
        """Of every action. [..., D] -> [..., A]"""
        log_probs: torch.Tensor = self.actor(observations).log_softmax(-1)
        return log_probs

    def update(self, buffer: RolloutBuffer, guidance: Guidance | None = None) -> None:
        """Several epochs of minibatches over one block of experience; `guidance` adds to the actor's loss."""
        advantages, returns = self._targets(buffer)
        own = buffer.guides == TARGET
        samples = torch.from_numpy(np.flatnonzero(own))
        guided = torch.from_numpy(np.flatnonzero(~own & buffer.of_reached_decisions()))
        # RMSprop would take a whole step for a handful.
        share = min(1.0, len(guided) / self.settings.minibatch)
        observations = torch.from_numpy(buffer.observations).flatten(0, 1)
        actions = torch.from_numpy(buffer.actions).flatten()
        old_log_probs = torch.from_numpy(buffer.log_probs).flatten()
        for _ in range(self.settings.epochs):
            for batch in self._minibatches(samples):
                loss = self._surrogate_loss(
                    observations[batch],
                    actions[batch],
                    old_log_probs[batch],
                    advantages[batch],
                    returns[batch],
                    guidance and partial(guidance, batch),
                )
                gradient_step(self.optimiser, loss, self.settings.max_gradient_norm)
            for batch in self._minibatches(guided):
                loss = self._cloning_loss(observations[batch], actions[batch], returns[batch])
                gradient_step(self.optimiser, share * loss, self.settings.max_gradient_norm)

    def anneal(self, done: float) -> None:
        """Sets the learning rate for the share of the budget that is used up, in [0, 1]."""
        share = 1.0 - (1.0 - self.settings.final_rate) * min(done, 1.0)
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * share

    def _networks(self) -> nn.ModuleDict:
        return nn.ModuleDict({"actor": self.actor, "critic": self.critic})

    def state(self) -> dict[str, torch.Tensor]:
        """The networks' tensors by name."""
        return dict(self._networks().state_dict())

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the networks' tensors from `state`."""
        load_named(self._networks(), state)

    @torch.no_grad()
    def warm_start(self, state: dict[str, torch.Tensor], logit_scale: float) -> None:
        """Starts from another's networks, the actor's logits times `logit_scale`: it explores again."""
        self.load(state)
        for parameter in list(self.actor.parameters())[-2:]:  # weights and biases of the last layer
            parameter.mul_(logit_scale)

    @torch.no_grad()
    def _targets(self, buffer: RolloutBuffer) -> tuple[torch.Tensor, torch.Tensor]:
        values = self.critic(torch.from_numpy(buffer.observations)).squeeze(-1)
        last_values = self.critic(torch.from_numpy(buffer.last_observations)).squeeze(-1)
        rewards = torch.from_numpy(buffer.rewards)
        if buffer.cut.any():
            cut = torch.from_numpy(buffer.cut)
            final = self.critic(torch.from_numpy(buffer.final_observations[buffer.cut])).squeeze(-1)
            rewards = rewards.masked_scatter(cut, rewards[cut] + self.settings.discount * final)
        advantages = generalised_advantages(
            rewards,
            values,
            last_values,
            torch.from_numpy(buffer.ends).float(),
            self.settings.discount,
            self.settings.trace_decay,
        )
        return advantages.flatten(), (advantages + values).flatten()

    def _minibatches(self, samples: torch.Tensor) -> tuple[torch.Tensor, ...]:
        if not len(samples):
            return ()
        shuffled = samples[torch.from_numpy(self.rng.permutation(len(samples)))]
        count = max(1, round(len(samples) / self.settings.minibatch))
        return shuffled.chunk(count)

    def _surrogate_loss(
        self,
        observations: torch.Tensor,
        actions: torch.Tensor,
        old_log_probs: torch.Tensor,
        advantages: torch.Tensor,
        returns: torch.Tensor,
        guidance: Callable[[torch.Tensor], torch.Tensor] | None = None,
    ) -> torch.Tensor:
        log_probs = self.log_probs(observations)
        entropy = -(log_probs.exp() * log_probs).sum(-1).mean()
        ratio = (log_probs.gather(-1, actions[:, None])[:, 0] - old_log_probs).exp()
        advantages = (advantages - advantages.mean()) / (advantages.std(correction=0) + 1e-8)
        clipped = ratio.clamp(1.0 - self.settings.clip, 1.0 + self.settings.clip)
        policy_loss = -torch.minimum(ratio * advantages, clipped * advantages).mean()
        if guidance:
            policy_loss = policy_loss + guidance(log_probs)
        value_loss = self._value_loss(observations, returns)
        return policy_loss + value_loss - self.settings.entropy_coef * entropy

    def _cloning_loss(
        self, observations: torch.Tensor, actions: torch.Tensor, returns: torch.Tensor
    ) -> torch.Tensor:
        log_probs = self.log_probs(observations)
        likelihood = log_probs.gather(-1, actions[:, None]).mean()
        return self._value_loss(observations, returns) - self.settings.clone_coef * likelihood

    def _value_loss(self, observations: torch.Tensor, returns: torch.Tensor) -> torch.Tensor:
        error: torch.Tensor = self.critic(observations).squeeze(-1) - returns
        return self.settings.value_coef * error.square().mean()


@torch.no_grad()
def _sample(
    actor: nn.Module, observations: NDArray[np.float32], rng: np.random.Generator, sharpness: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Actions [B] and their log-probabilities [B] for observations [B, D]."""
    log_probs = (sharpness * actor(torch.from_numpy(observations))).log_softmax(-1)
    uniform = torch.from_numpy(rng.random(log_probs.shape, np.float32))
    noise = uniform.clamp_min_(1e-10).log_().neg_().log_()
    actions = (log_probs - noise).argmax(-1)
    return actions.numpy(), log_probs.gather(-1, actions[:, None])[:, 0].numpy()
