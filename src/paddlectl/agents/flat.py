"""One learner on the task's whole state, without subgoals."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.agents.base import TARGET_NAME, Agent, Episode, Player, Policy, ReuseRow, Tables
from paddlectl.agents.reuse import ReuseRecorder
from paddlectl.learners.base import Actor, Learner, LearnerSettings
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.ppo import PPOSettings
from paddlectl.ranges import Environments, Frames, Positive, Steps
from paddlectl.tasks.base import FRAMES, Environment, Step, Task


@dataclass(frozen=True)
class FlatSettings:
    """The numbers of a flat learner.

    Attributes:
        frames: The usual budget.
        num_envs: Environments side by side.
        rollout_steps: Steps of every environment between two updates.
        action_repeat: Steps of the task that one action lasts.
        reward_unit: Rewards are counted in it.
        learner: The update rule's own.
    """

    frames: Frames = FRAMES
    num_envs: Environments = 64
    rollout_steps: Steps = 32
    action_repeat: Steps = 1
    reward_unit: Positive = 1.0
    learner: LearnerSettings = field(default_factory=PPOSettings)


class FlatPolicy(Policy):
    """What a flat learner knows.

    Attributes:
        task: The task.
        settings: Of its method.
        learner: Its networks, and how they learn.
        action_repeat: Steps of the task that one action lasts.
    """

    def __init__(self, task: Task, seed: int, settings: FlatSettings) -> None:
        environment = task.make(1, 0)
        self.task = task
        self.settings = settings
        self.action_repeat = settings.action_repeat
        self.learner: Learner = settings.learner.learner(
            environment.flat_size, environment.actions.size, seed
        )

    def player(self, task: Task, environments: int, seed: np.random.SeedSequence) -> "FlatPlayer":
        """Plays by what was learned and learns nothing; all chance is `seed`'s."""
        return FlatPlayer(self.learner.eval_actor(), np.random.default_rng(seed))

    def settings_document(self) -> dict[str, Any]:
        """Its settings as JSON-able values."""
        return asdict(self.settings)

    def state(self) -> dict[str, torch.Tensor]:
        """All tensors by name."""
        return self.learner.state()

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes all tensors from `state`."""
        self.learner.load(state)


class FlatPlayer(Player):
    """Acts by the whole state."""

    def __init__(self, actor: Actor, rng: np.random.Generator) -> None:
        self._actor = actor
        self._rng = rng

    def act(self, environment: Environment) -> NDArray[Any]:
        """[B, ...]"""
        return self._actor.act(environment.flat_state(), self._rng)[0]


class FlatAgent(Agent):
    """Learns from the task's own rewards; the horizon is no end (Pardo et al., 2018).

    Args:
        policy: Who learns.
        rng: Of its exploration.
    """

    def __init__(self, policy: FlatPolicy, rng: np.random.Generator) -> None:
        settings, environment = policy.settings, policy.task.make(1, 0)
        self.rollout_steps = settings.rollout_steps
        self._policy = policy
        self._rng = rng
        self._t = 0
        actions = environment.actions
        self._buffer = RolloutBuffer.empty(
            settings.rollout_steps, settings.num_envs, environment.flat_size, actions.shape, actions.dtype
        )

    def act(self, environment: Environment) -> NDArray[Any]:
        """Explores as the learner does. [B, ...]"""
        buffer, t = self._buffer, self._t
        buffer.observations[t] = environment.flat_state()
        buffer.actions[t], buffer.log_probs[t] = self._policy.learner.act(buffer.observations[t], self._rng)
        chosen: NDArray[Any] = buffer.actions[t]
        return chosen

    def observe(self, environment: Environment, step: Step) -> None:
        """Keeps what was earned, and what followed."""
        buffer, t = self._buffer, self._t
        done = step.terminated | step.truncated
        buffer.rewards[t] = step.reward / np.float32(self._policy.settings.reward_unit)
        buffer.ends[t] = done
        buffer.cut[t] = step.truncated
        buffer.terminated[t] = step.terminated
        buffer.truncated[t] = step.truncated
        if done.any():
            buffer.final_observations[t] = environment.flat_state()
        self._t = (t + 1) % self.rollout_steps

    def update(self, environment: Environment, progress: float) -> Mapping[str, float]:
        """One update."""
        self._buffer.last_observations[:] = environment.flat_state()
        self._policy.learner.anneal(progress)
        return self._learn(environment)

    def _learn(self, environment: Environment) -> Mapping[str, float]:
        """One update of the learner, from the block. A method that reuses sources learns here."""
        self._policy.learner.update(self._buffer)
        return {}

    def policy(self) -> FlatPolicy:
        """What it has learned."""
        return self._policy


class ReusingAgent(FlatAgent):
    """A flat learner with sources at hand, and a record of who was followed.

    A method chooses in `_learn`, or in `act`, and takes that down by `_recorder.add`.

    Args:
        policy: Who learns.
        rng: Of its exploration.
        sources: Ids and policies of the sources.
        frames: The budget.
    """

    def __init__(
        self, policy: FlatPolicy, rng: np.random.Generator, sources: Mapping[str, FlatPolicy], frames: int
    ) -> None:
        super().__init__(policy, rng)
        self._sources = [source.learner for source in sources.values()]
        self._recorder = ReuseRecorder(policy.task, (TARGET_NAME, *sources), frames)
        self._now = 0
        self._valuations = np.zeros(
            (self.rollout_steps, policy.settings.num_envs, len(policy.task.vocabulary.atoms)), np.bool_
        )

    def act(self, environment: Environment) -> NDArray[Any]:
        """Explores as the learner does; the scene is kept for the record. [B, ...]"""
        self._valuations[self._t] = environment.valuation()
        return super().act(environment)

    def reuse(self) -> Iterable[ReuseRow]:
        """Of the period so far."""
        return self._recorder.rows(self._now)

    def record(self, frames: int, episodes: Sequence[Episode], known: int) -> Tables:
        """Who was followed, at the end of a period."""
        self._now = frames
        return self._recorder.end_of_period(frames)

    def close(self) -> Tables:
        """Who was followed in the last period."""
        return self._recorder.end_of_period(self._now, at_once=True)
