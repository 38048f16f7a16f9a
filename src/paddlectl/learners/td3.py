"""Twin delayed deep deterministic policy gradient (Fujimoto, van Hoof & Meger, 2018) for the low level."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.learners.exploration import GoalExploration, HeldActions, Novelty
from paddlectl.learners.networks import HIDDEN, GoalFeatures, gradient_step, load_named, mlp
from paddlectl.learners.replay import Hindsight, Replay, Transitions
from paddlectl.ranges import (
    AtLeastOne,
    Count,
    Hidden,
    Kept,
    Many,
    NotNegative,
    Positive,
    PositiveShare,
    Range,
    Share,
)

Floats = NDArray[np.float32]

Guidance = Callable[[Transitions, torch.Tensor], torch.Tensor]
"""A loss to add to the actor's, of a minibatch and of the actor's actions there [n, A]."""

OPTIMISERS = {"adam": torch.optim.Adam, "rmsprop": torch.optim.RMSprop}


@dataclass(frozen=True)
class TD3Settings:
    """Table 1's values where it has them, the TD3 paper's for the others: the preset `paper`.

    What stands below `capacity` is in neither and is off here; a domain may ask for it.

    Attributes:
        learning_rate: Of both networks.
        optimiser: `rmsprop` or `adam`.
        discount: γ_l per action.
        batch: Transitions a gradient step.
        update_every: Actions between two updates.
        policy_delay: Updates of the critics to one of the actor and of the slow copies.
        policy_noise: Deviation of the noise on the target's action, cut at `noise_clip`.
        noise_clip: See there.
        exploration: Deviation of the noise on an action.
        tau: τ, by which the slow copies follow.
        hidden: Units of each layer.
        warm_up: Actions before the first update, at random unless something was inherited.
        capacity: Transitions that are kept.
        final_rate: Share of the learning rate that is left at the end of the budget; it falls in a straight
            line.
        cloning: Who inherited networks doesn't explore and learns by imitation alone: its actor is drawn to
            what guides did in decisions that are seen, in the same block, to reach their subgoal.
        normalised: Layers are normalised before their ReLU: what a critic makes of states that it has hardly
            seen stays within bounds.
        random_actions: Share of actions drawn at random, from none in the first lane to this in the last: one
            goes a long way while another looks around. It falls to nothing over the budget.
        random_steps: Actions that a random one is held, on average, and is a strong one
            (`exploration.HeldActions`); 1 draws each anew, of any strength.
        novelty: Reward of coming to a state that was never seen, beside the task's; the less the more often
            it was seen (`exploration.Novelty`). It falls to nothing over the budget.
        goal_exploration: Share of the time on the way to places seen before (`GoalExploration`). It falls
            to nothing over the budget.
        goal_exploration_steps: Actions on the way to one of them, on average.
        goal_size: Numbers at the ends of an observation that say what is achieved and what is desired.
        radius: Within which a goal is reached.
        goal_reward: Of reaching it, as the decisions pay.
        grid: Of the code of achieved and desired (`networks.GoalFeatures`).
        hindsight: Share of the samples that are given a goal which their episode achieved later on.
        other_goals: Share that is given the goal of another sample.
        span: Actions that hindsight looks ahead at most.
        lower_bound: A goal that was reached k actions later is worth at least γ^k of its reward, and no goal
            more than its reward.
        saturation_cost: Weight of the actor's outputs beyond `saturation`, before their tanh. A saturated
            actor has no gradient and learns nothing any more.
        saturation: See there.
    """

    learning_rate: Positive = 2e-4
    optimiser: Literal["rmsprop", "adam"] = "rmsprop"
    discount: Share = 0.99
    batch: Count = 256
    update_every: Count = 2
    policy_delay: Count = 2
    policy_noise: NotNegative = 0.2
    noise_clip: NotNegative = 0.5
    exploration: NotNegative = 0.1
    tau: PositiveShare = 0.005
    hidden: Hidden = HIDDEN
    warm_up: Count = 1000
    capacity: Kept = 1_000_000
    final_rate: Share = 1.0
    cloning: bool = False
    normalised: bool = False
    random_actions: Share = 0.0
    random_steps: AtLeastOne = 1.0
    novelty: NotNegative = 0.0
    goal_exploration: Share = 0.0
    goal_exploration_steps: AtLeastOne = 12.0
    goal_size: Annotated[int, Range(0, 16)] = 0
    radius: NotNegative = 0.0
    goal_reward: NotNegative = 1.0
    grid: Annotated[tuple[int, ...], Many(Range(1, 1000), most=4)] = ()
    hindsight: Share = 0.0
    other_goals: Share = 0.0
    span: Count = 50
    lower_bound: bool = False
    saturation_cost: NotNegative = 0.0
    saturation: NotNegative = 1.5

    def learner(self, observation_size: int, actions: int, seed: int) -> "TD3":
        """A new learner with these settings."""
        return TD3(observation_size, actions, seed, self)


class TD3EvalActor(NamedTuple):
    """An actor that doesn't learn."""

    act: Callable[[Floats, np.random.Generator], tuple[Floats, Floats]]


class Networks(nn.Module):
    """An actor π and two critics Q1, Q2 over the same features, which don't learn."""

    def __init__(self, observation_size: int, actions: int, settings: TD3Settings) -> None:
        super().__init__()
        self.features = GoalFeatures(observation_size, settings.goal_size, settings.grid)
        size = self.features.size
        layers = partial(mlp, hidden=settings.hidden, normalised=settings.normalised)
        self.actor = layers(size, actions, output_gain=0.01)
        self.critics = nn.ModuleList(layers(size + actions, 1, output_gain=0.1) for _ in range(2))

    def values(self, features: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Q1 and Q2. [2, n]"""
        inputs = torch.cat([features, actions], -1)
        return torch.stack([critic(inputs)[:, 0] for critic in self.critics])


class TD3:
    """A deterministic actor and two critics, each with its own network, and slow copies of all three.

    It learns from all that was done, whoever acted; one that clones, from what guides did alone.
    """

    def __init__(
        self, observation_size: int, actions: int, seed: int, settings: TD3Settings | None = None
    ) -> None:
        self.settings = s = settings or TD3Settings()
        self.actions = actions
        self.rng = np.random.default_rng(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.online = Networks(observation_size, actions, s)
        self.slow = deepcopy(self.online).requires_grad_(False)
        optimiser = OPTIMISERS[s.optimiser]
        self.actor_optimiser = optimiser(self.online.actor.parameters(), lr=s.learning_rate)
        self.critic_optimiser = optimiser(self.online.critics.parameters(), lr=s.learning_rate)
        self.replay: Replay | None = None
        self.updates = 0
        self._due = 0.0
        self._left = 1.0
        self._own = 1.0
        self._skilled = False
        self._goal_exploration = GoalExploration(s.goal_size, s.goal_exploration_steps)
        self._held = HeldActions(actions, s.random_steps)
        self._novelty = Novelty(observation_size) if s.novelty else None

    def act(self, observations: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Actions with the noise of exploration [B, A], and zeros [B].

        It explores by goals, and acts at random, the less the more others act for it. Who clones does
        neither, and without noise.
        """
        s, shape = self.settings, (len(observations), self.actions)
        if self._clones:
            return _best(self.online, observations, rng)
        rate = np.full(shape[0], 0.0 if self._skilled else 1.0)
        if self.replay and self._warm(self.replay):
            exploring = self._left * self._own
            rate = np.linspace(0.0, s.random_actions * exploring, shape[0])
            if s.goal_exploration:
                share = s.goal_exploration * exploring
                observations = self._goal_exploration.send(observations, self.replay, share, rng)
        noisy = _best(self.online, observations, rng)[0] + rng.normal(0.0, s.exploration, shape)
        actions = noisy.clip(-1.0, 1.0)
        if s.random_steps > 1.0:
            actions = self._held.replace(actions, rate, rng)
        else:
            anyhow = rng.random(shape[0]) < rate
            actions = np.where(anyhow[:, None], rng.uniform(-1.0, 1.0, shape), actions)
        return actions.astype(np.float32), np.zeros(shape[0], np.float32)

    def eval_actor(self) -> TD3EvalActor:
        """The actor's slow copy, without noise: it trembles less from one update to the next."""
        return TD3EvalActor(partial(_best, self.slow))

    def teacher_actor(self) -> TD3EvalActor:
        """The same actor as the teacher of another policy."""
        return self.eval_actor()

    @property
    def _clones(self) -> bool:
        return self._skilled and self.settings.cloning

    @torch.no_grad()
    def actions_of(self, observations: torch.Tensor) -> torch.Tensor:
        """What the slow actor does, without noise. [n, D] -> [n, A]"""
        actions: torch.Tensor = self.slow.actor(self.slow.features(observations)).tanh()
        return actions

    @torch.no_grad()
    def values_of(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Mean of the slow critics. [n, D], [n, A] -> [n]"""
        values: torch.Tensor = self.slow.values(self.slow.features(observations), actions).mean(0)
        return values

    def _warm(self, replay: Replay) -> bool:
        return len(replay) >= self.settings.warm_up

    def update(self, buffer: RolloutBuffer, guidance: Guidance | None = None) -> None:
        """Keeps a block of experience and makes the updates that are due; who clones learns from it alone.

        `guidance` adds to the actor's loss.
        """
        s = self.settings
        if self._clones:
            self._imitate(buffer)
            return
        if self.replay is None:
            num_envs, size = buffer.last_observations.shape
            hindsight = Hindsight(s.goal_size, s.radius, s.goal_reward, s.hindsight, s.other_goals, s.span)
            self.replay = Replay(s.capacity, num_envs, size, self.actions, hindsight)
        self.replay.add(buffer)
        if self._novelty:
            self._novelty.count(buffer.following())
        self._own = float((buffer.guides == TARGET).mean())
        if not self._warm(self.replay):
            return
        for _ in range(self._updates_for(buffer)):
            self._improve(self._with_novelty(self.replay.sample(s.batch, self.rng)), guidance)

    def _updates_for(self, buffer: RolloutBuffer) -> int:
        """How many updates are due with this block; parts of one are left over for the next."""
        due, self._due = divmod(self._due + buffer.rewards.size / self.settings.update_every, 1.0)
        return int(due)

    def _with_novelty(self, batch: Transitions) -> Transitions:
        """The batch, its rewards with what novelty pays by now."""
        if not self._novelty:
            return batch
        bonus = torch.from_numpy(self._novelty.bonus(batch.following.numpy()))
        return batch._replace(rewards=batch.rewards + self.settings.novelty * self._left * bonus)

    def _imitate(self, buffer: RolloutBuffer) -> None:
        """The updates that are due, of (π(s) - a)² over what guides did in decisions that they reached."""
        taught = (buffer.guides != TARGET) & buffer.of_reached_decisions()
        features = self.online.features(torch.from_numpy(buffer.observations[taught]))
        actions = torch.from_numpy(buffer.actions[taught])
        for _ in range(self._updates_for(buffer) if taught.any() else 0):
            batch = self.rng.integers(len(actions), size=self.settings.batch)
            error = self.online.actor(features[batch]).tanh() - actions[batch]
            gradient_step(self.actor_optimiser, error.square().mean())
            self._track()

    def _improve(self, batch: Transitions, guidance: Guidance | None = None) -> None:
        """One update of the critics; every `policy_delay`th time also of the actor and the slow copies."""
        self.updates += 1
        targets = self._targets(batch)
        features = self.online.features(batch.observations)
        values = self.online.values(features, batch.actions)
        gradient_step(self.critic_optimiser, (values - targets).square().mean(-1).sum())
        if self.updates % self.settings.policy_delay == 0:
            gradient_step(
                self.actor_optimiser, self._actor_loss(features, guidance and partial(guidance, batch))
            )
            self._track()

    @torch.no_grad()
    def _targets(self, batch: Transitions) -> torch.Tensor:
        """Targets y = r + γ min_i Q'_i(s', π'(s') + ε), ε clipped noise. [n]"""
        s = self.settings
        features = self.slow.features(batch.following)
        actions = self.slow.actor(features).tanh()
        noise = torch.from_numpy(self.rng.normal(0.0, s.policy_noise, actions.shape).astype(np.float32))
        actions = (actions + noise.clamp(-s.noise_clip, s.noise_clip)).clamp(-1.0, 1.0)
        to_come = self.slow.values(features, actions).amin(0)
        targets = batch.rewards + s.discount * (1.0 - batch.ends) * to_come
        if not s.lower_bound:
            return targets
        return torch.maximum(targets, s.goal_reward * s.discount**batch.steps).clamp(0.0, s.goal_reward)

    def _actor_loss(
        self, features: torch.Tensor, guidance: Callable[[torch.Tensor], torch.Tensor] | None = None
    ) -> torch.Tensor:
        """-Q1(s, π(s)), the cost of saturated actions, and what guidance adds."""
        s = self.settings
        outputs = self.online.actor(features)
        self.online.critics.requires_grad_(False)
        value: torch.Tensor = self.online.critics[0](torch.cat([features, outputs.tanh()], -1)).mean()
        self.online.critics.requires_grad_(True)
        beyond = (outputs.abs() - s.saturation).clamp_min(0.0).square().mean()
        loss: torch.Tensor = s.saturation_cost * beyond - value
        return loss + guidance(outputs.tanh()) if guidance else loss

    @torch.no_grad()
    def _track(self) -> None:
        """θ' ← τ θ + (1 - τ) θ'."""
        for slow, online in zip(self.slow.parameters(), self.online.parameters(), strict=True):
            slow.lerp_(online, self.settings.tau)

    def anneal(self, done: float) -> None:
        """Sets learning rate and exploration for the share of the budget that is used up, in [0, 1]."""
        s = self.settings
        self._left = 1.0 - min(done, 1.0)
        for optimiser in (self.actor_optimiser, self.critic_optimiser):
            for group in optimiser.param_groups:
                group["lr"] = s.learning_rate * (s.final_rate + (1.0 - s.final_rate) * self._left)

    def _networks(self) -> nn.ModuleDict:
        return nn.ModuleDict({"online": self.online, "slow": self.slow})

    def state(self) -> dict[str, torch.Tensor]:
        """The networks' tensors by name."""
        return dict(self._networks().state_dict())

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the networks' tensors from `state`."""
        load_named(self._networks(), state)

    def warm_start(self, state: dict[str, torch.Tensor], logit_scale: float) -> None:
        """Starts from another's networks as they are: it has no logits to scale."""
        self.load(state)
        self._skilled = True


@torch.no_grad()
def _best(networks: Networks, observations: Floats, _: np.random.Generator) -> tuple[Floats, Floats]:
    """The actor's actions [B, A], and zeros [B]; nothing is left to chance."""
    actions = networks.actor(networks.features(torch.from_numpy(observations))).tanh()
    return actions.numpy(), np.zeros(len(observations), np.float32)
