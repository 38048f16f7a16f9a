"""h-DQN (Kulkarni et al., 2016): a DQN picks subgoals, the hybrid model's low level reaches them.

1. The meta-controller sees the whole state and picks a subgoal, ε-greedily.
2. The controller acts until the decision ends; it is paid for reaching the subgoal, as in `hdm`.
3. The meta-controller learns from (state, subgoal, sum of the rewards in between, state), the controller as
   in `hdm`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.agents.base import Episode, ReuseRow, Tables
from paddlectl.hybrid.policy import domain_subgoals, task_subgoals
from paddlectl.hybrid.rollout import DecisionSettings, Outcome, Rollout
from paddlectl.hybrid.settings import HybridSettings, presets, settings_for
from paddlectl.learners.base import Learner, LearnerSettings
from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.learners.clauses import ClauseLearner, ClauseSettings
from paddlectl.learners.dqn import DQN, Batch, DQNSettings
from paddlectl.learners.ppo import PPOSettings
from paddlectl.logic.templates import scenes
from paddlectl.methods.base import Method, Setup
from paddlectl.ranges import Environments, Frames, Steps
from paddlectl.tasks.base import FRAMES, Environment, Floats, Ints, Step, Task


@dataclass(frozen=True)
class HDQNSettings:
    """Every number of h-DQN; but for `meta` they are those of the hybrid model.

    Attributes:
        frames: The usual budget.
        num_envs: Environments side by side.
        rollout_steps: Steps of every environment between two updates.
        action_repeat: Steps of the task that one action lasts.
        meta: The meta-controller's, whose transitions a checkpoint holds. With a slow network of 250 updates
            it learns a fifth less in as many frames (`benchmarks/tuning/alone.yaml`).
        discounts: γ of a decision, by its length.
        low_level: The controller's.
        decisions: When a decision ends, and what the controller gets for it.
    """

    frames: Frames = FRAMES
    num_envs: Environments = 64
    rollout_steps: Steps = 32
    action_repeat: Steps = 1
    meta: DQNSettings = field(default_factory=partial(DQNSettings, capacity=20_000, refresh_every=50))
    discounts: ClauseSettings = field(default_factory=ClauseSettings)
    low_level: LearnerSettings = field(default_factory=PPOSettings)
    decisions: DecisionSettings = field(default_factory=DecisionSettings)


class HDQNPolicy:
    """A meta-controller over the task's subgoals, and a controller.

    Attributes:
        task: The task.
        settings: Of the method.
        meta: Q of every subgoal of the task.
        low_level: The controller.
        action_repeat: Steps of the task that one action lasts.
        scene_count: 0: it has no clauses.
    """

    scene_count = 0

    def __init__(self, task: Task, seed: int, settings: HDQNSettings) -> None:
        environment = task.make(1, 0)
        self.task = task
        self.settings = settings
        self.action_repeat = settings.action_repeat
        self.meta = DQN(environment.flat_size, len(task.subgoals), seed, settings.meta)
        self.low_level: Learner = settings.low_level.learner(
            environment.observation_size, environment.actions.size, seed
        )
        self._sizes = environment.observation_size, environment.actions.shape, environment.actions.dtype

    def player(self, task: Task, environments: int, seed: np.random.SeedSequence) -> "HDQNPlayer":
        """Plays its best subgoals by the frozen controller; all chance is `seed`'s."""
        choices, actions = map(np.random.default_rng, seed.spawn(2))
        selector = MetaController(self, environments, choices, learns=False)
        rollout = self.rollout(task, environments, selector, self.low_level.eval_actor(), 1, actions)
        return HDQNPlayer(rollout, selector)

    def rollout(
        self,
        task: Task,
        environments: int,
        selector: "MetaController",
        actor: Any,
        steps: int,
        rng: np.random.Generator,
    ) -> Rollout:
        """The decisions of so many environments; a decision also ends when a fact changes, as in `hdm`."""
        atoms = task.vocabulary.atoms
        reader = ClauseLearner(atoms, scenes(atoms, task.vocabulary.exclusions), task.subgoals, 0)
        buffer = RolloutBuffer.empty(steps, environments, *self._sizes)
        listeners = [selector] if selector.learns else []
        settings = self.settings
        return Rollout(
            environments,
            reader,
            selector,
            [actor],
            settings.decisions,
            settings.low_level.discount,
            buffer,
            rng,
            listeners,
        )

    def played_program(self, passed: Ints, episodes: int) -> tuple[None, None]:
        """No program, and no crispness."""
        return None, None

    def settings_document(self) -> dict[str, Any]:
        """Its settings as JSON-able values."""
        return asdict(self.settings)

    def state(self) -> dict[str, torch.Tensor]:
        """All tensors by name."""
        return {**self.meta.state(), **self.low_level.state()}

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes all tensors from `state`."""
        self.meta.load(state)
        self.low_level.load(state)


class MetaController:
    """Chooses subgoals by Q, and learns from what came of them.

    Args:
        policy: Whose Q.
        num_envs: B.
        rng: Of its draws.
        learns: Whether it explores, and keeps what it sees.

    Attributes:
        state: What it sees now. [B, F]
    """

    def __init__(
        self, policy: HDQNPolicy, num_envs: int, rng: np.random.Generator, *, learns: bool = True
    ) -> None:
        self.learns = learns
        self.state: Floats = np.zeros((num_envs, 0), np.float32)
        self._policy = policy
        self._rng = rng
        self._began: list[Floats | None] = [None] * num_envs
        self._domain_subgoal = domain_subgoals(policy.task)
        self._own_subgoal = task_subgoals(policy.task)

    def refresh(self) -> None:
        """Nothing: Q is read anew at each choice."""

    def select(self, lanes: Ints, scene_states: Ints) -> tuple[Ints, Ints]:
        """Its own controller, and a subgoal for each lane. [n], [n]"""
        states = self.state[lanes]
        for lane, state in zip(lanes, states, strict=True):
            self._began[lane] = state
        meta = self._policy.meta
        chosen = meta.act(states, self._rng) if self.learns else meta.values(states).argmax(-1)
        return np.full(len(lanes), TARGET), self._domain_subgoal[chosen]

    def on_decision_end(self, outcome: Outcome) -> None:
        """Learns from the decisions that ended; `state` is what they led to."""
        discounts = self._policy.settings.discounts.discounts(outcome.steps)
        began = np.stack([self._began[lane] for lane in outcome.lanes])
        self._policy.meta.learn(
            Batch(
                began,
                self._own_subgoal[outcome.subgoals],
                (discounts * outcome.rewards).astype(np.float32),
                np.where(outcome.terminated, 0.0, discounts).astype(np.float32),
                self.state[outcome.lanes],
            )
        )


class HDQNPlayer:
    """Acts by a rollout whose selector sees the whole state."""

    def __init__(self, rollout: Rollout, selector: MetaController) -> None:
        self.rollout = rollout
        self.selector = selector

    def act(self, environment: Environment) -> NDArray[Any]:
        """[B, ...]"""
        self.selector.state = environment.flat_state()
        return self.rollout.act(environment)

    def observe(self, environment: Environment, step: Step) -> None:
        """Ends decisions."""
        self.selector.state = environment.flat_state()
        self.rollout.observe(environment, step)

    def scenes(self, lane: int) -> tuple[int, ...]:
        """None."""
        return ()

    def subgoals(self) -> Ints:
        """Those of the rollout. [B]"""
        return self.rollout.subgoals()


class HDQNAgent(HDQNPlayer):
    """Both levels learn at once."""

    def __init__(self, policy: HDQNPolicy, seed: int) -> None:
        settings = policy.settings
        layouts, choices = np.random.SeedSequence(seed).spawn(2)
        actions = np.random.default_rng(layouts.spawn(1)[0])
        selector = MetaController(policy, settings.num_envs, np.random.default_rng(choices))
        self.rollout_steps = settings.rollout_steps
        self._policy = policy
        super().__init__(
            policy.rollout(
                policy.task, settings.num_envs, selector, policy.low_level, settings.rollout_steps, actions
            ),
            selector,
        )

    def update(self, environment: Environment, progress: float) -> Mapping[str, float]:
        """Updates the controller; the meta-controller learns as decisions end."""
        self._policy.meta.anneal(progress)
        self._policy.low_level.anneal(progress)
        self._policy.low_level.update(self.rollout.close(environment))
        return {"exploration": self._policy.meta.exploration}

    def reuse(self) -> Sequence[ReuseRow]:
        """Nothing."""
        return ()

    def record(self, frames: int, episodes: Sequence[Episode], known: int) -> Tables:
        """Nothing beside the usual tables."""
        return {}

    def close(self) -> Tables:
        """Nothing beside the usual tables."""
        return {}

    def documents(self) -> Mapping[str, Any]:
        """None."""
        return {}

    def policy(self) -> HDQNPolicy:
        """What it has learned."""
        return self._policy


def make(setup: Setup) -> HDQNAgent:
    """A meta-controller and a controller that have learned nothing."""
    return HDQNAgent(HDQNPolicy(setup.task, setup.seed, setup.settings), setup.seed)


def _like(hybrid: HybridSettings) -> HDQNSettings:
    return HDQNSettings(
        hybrid.frames,
        hybrid.num_envs,
        hybrid.rollout_steps,
        hybrid.action_repeat,
        discounts=hybrid.clauses,
        low_level=hybrid.low_level,
        decisions=hybrid.decisions,
    )


HDQN = Method.of_usual(
    "hdqn",
    lambda task: _like(settings_for(task)),
    make,
    HDQNPolicy,
    lambda task: {name: _like(hybrid) for name, hybrid in presets(task).items()},
)
