"""Hybrid decisions in B environments: a selector picks subgoals, actors reach them.

A decision picks a subgoal for the present scene. It ends when the subgoal is reached, when the scene
changes in any other way, after `max_steps` steps, or with the episode (method, section 4). A
subgoal that has nothing to act on, or holds already, is given up after one step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from paddlectl.learners.base import Actor
from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.ranges import Finite, NotNegative, Positive, Share, Steps
from paddlectl.tasks.base import Bools, Environment, Floats, Ints, Step

PROGRESS = 6
"""Levels of progress that are told apart within a scene.

A scene state is a scene and how many of the episode's decisions were paid: scene * PROGRESS + progress.
Milestones pay once an episode; a key that is put down and picked up again would else seem to pay again.
"""


@dataclass(frozen=True)
class DecisionSettings:
    """When a decision ends, and what the low level gets for it.

    Attributes:
        max_steps: Most environment steps of one decision.
        patience: Share of them that a guide gets. It knows its way: what it hasn't reached by then it hardly
            ever will, and a wrong guess costs less.
        reward_unit: Extrinsic rewards are counted in it, so that returns lie in about [0, 1].
        reached_reward: Intrinsic reward for reaching the subgoal at once …
        delay_cost: … less this, times the share of `max_steps` that was used.
        failed_reward: Intrinsic reward when a decision ends in any other way.
        shaping: Potential-based shaping (Ng, Harada & Russell, 1999) of the intrinsic reward: γΦ(s') - Φ(s)
            is added, with Φ = -shaping · steps to what the subgoal acts on, and 0 after a decision's end. It
            leaves the best policy as it is, and tells the low level at each step whether it comes nearer.
    """

    max_steps: Steps = 50
    patience: Share = 0.3
    reward_unit: Positive = 1.0
    reached_reward: Finite = 1.0
    delay_cost: Finite = 0.5
    failed_reward: Finite = -0.1
    shaping: NotNegative = 0.0


class Outcome(NamedTuple):
    """Decisions that ended in one step, one a lane. Each field is [n].

    Attributes:
        scene_states: Where it was taken.
        rewards: Extrinsic reward within the decision.
        cut: It ended for no other reason than the horizon: whether it would have reached its subgoal isn't
            known.
        terminated: The episode came to its end with it: nothing is to come.
        solved: And the task was solved.
        truncated: The episode ended unsolved with it, at the horizon.
        next_scene_states: Where it led.
    """

    lanes: Ints
    scene_states: Ints
    subgoals: Ints
    guides: Ints
    steps: Ints
    rewards: Floats
    reached: Bools
    cut: Bools
    terminated: Bools
    solved: Bools
    truncated: Bools
    next_scene_states: Ints

    @property
    def done(self) -> Bools:
        """The episode ended with it. [n]"""
        return self.terminated | self.truncated


class SubgoalSelector(Protocol):
    """Who decides: a program, or the guidance over several."""

    def refresh(self) -> None:
        """Reads the learning policy's clause weights anew; called before each block."""

    def select(self, lanes: Ints, scene_states: Ints) -> tuple[Ints, Ints]:
        """The guide and the subgoal, as an index into the domain's subgoals, for each lane. [n], [n]"""


class DecisionListener(Protocol):
    """Who learns from decisions."""

    def on_decision_end(self, outcome: "Outcome") -> None:
        """Learns from the decisions that ended in this step."""


class SceneReader(Protocol):
    """Maps crisp valuations [B, P] to scene numbers [B]."""

    def scenes(self, valuation: Bools) -> Ints: ...


class Rollout:
    """The hybrid decisions of B environments: `agents.base.Player`.

    Args:
        num_envs: B.
        reader: Names the scenes.
        selector: Picks guide and subgoal.
        actors: The low level of each guide; the learning policy's first.
        settings: When a decision ends.
        discount: γ of the low level.
        buffer: Where the low level's samples go, step after step; then from the start again.
        rng: Of what the actors leave to chance.
        listeners: Learn from every decision that ended.
    """

    def __init__(
        self,
        num_envs: int,
        reader: SceneReader,
        selector: SubgoalSelector,
        actors: Sequence[Actor],
        settings: DecisionSettings,
        discount: float,
        buffer: RolloutBuffer,
        rng: np.random.Generator,
        listeners: Sequence[DecisionListener] = (),
    ) -> None:
        self.buffer = buffer
        self._reader = reader
        self._selector = selector
        self._actors = actors
        self._settings = settings
        self._discount = np.float32(discount)
        self._rng = rng
        self._listeners = listeners
        self._t = 0
        self._subgoal = np.zeros(num_envs, np.intp)
        self._guide = np.zeros(num_envs, np.intp)
        self._since = np.zeros(num_envs, np.intp)
        self._steps = np.zeros(num_envs, np.intp)
        self._limit = np.zeros(num_envs, np.intp)
        self._potential = np.zeros(num_envs, np.float32)
        self._reward = np.zeros(num_envs, np.float32)
        self._progress = np.zeros(num_envs, np.intp)
        self._pending = np.ones(num_envs, np.bool_)
        self._scene = np.zeros(num_envs, np.intp)
        self._restarted = True
        self._passed: list[dict[int, None]] = [{} for _ in range(num_envs)]  # as sets
        self._ended: dict[int, tuple[int, ...]] = {}

    def act(self, environment: Environment) -> NDArray[Any]:
        """Decides where a decision has ended, and acts by the present ones. [B, ...]"""
        if self._restarted:
            self._scene = self._reader.scenes(environment.valuation())
        self._decide(environment)
        observations = environment.observe(self._subgoal)
        self._potential = self._potentials(environment)
        buffer, t = self.buffer, self._t
        buffer.observations[t] = observations
        buffer.guides[t] = self._guide
        self._act(observations, buffer.actions[t], buffer.log_probs[t])
        return environment.in_world(self._subgoal, buffer.actions[t])

    def observe(self, environment: Environment, step: Step) -> None:
        """Ends the decisions that are over, and pays the low level for them."""
        settings, buffer, t = self._settings, self.buffer, self._t
        self._steps = environment.t - self._since
        self._reward += step.reward / np.float32(settings.reward_unit)
        scene = self._reader.scenes(environment.valuation())
        reached = environment.reached(self._subgoal) & (self._limit > 1)
        over = step.terminated | reached | (scene != self._scene) | (self._steps >= self._limit)
        cut = step.truncated & ~over
        ends = over | cut
        prompt = settings.reached_reward - settings.delay_cost * self._steps / settings.max_steps
        intrinsic = np.where(reached, prompt, np.where(over, settings.failed_reward, 0.0))
        following = np.where(over, np.float32(0.0), self._potentials(environment))
        buffer.rewards[t] = intrinsic + self._discount * following - self._potential
        buffer.ends[t] = ends
        buffer.reached[t] = reached
        buffer.cut[t] = cut
        buffer.terminated[t] = step.terminated
        buffer.truncated[t] = step.truncated
        if ends.any():
            buffer.final_observations[t] = environment.observe(self._subgoal)
        self._record(np.flatnonzero(ends), reached, cut, step, scene)
        self._pending = ends
        self._scene = scene
        self._forget(np.flatnonzero(step.terminated | step.truncated))
        self._t = (t + 1) % len(buffer.actions)

    def close(self, environment: Environment) -> RolloutBuffer:
        """The buffer, full, with what the decisions that go on see now."""
        self.buffer.last_observations[:] = environment.observe(self._subgoal)
        return self.buffer

    def scenes(self, lane: int) -> tuple[int, ...]:
        """The scenes that the episode came through which has just ended there."""
        return self._ended[lane]

    def subgoals(self) -> Ints:
        """The present one of each lane, as an index into the domain's subgoals. [B]"""
        return self._subgoal

    def _potentials(self, environment: Environment) -> Floats:
        """Φ of each lane's state under its present subgoal. [B]"""
        if not self._settings.shaping:
            return np.zeros(len(self._subgoal), np.float32)
        return -np.float32(self._settings.shaping) * environment.distance(self._subgoal)

    def _decide(self, environment: Environment) -> None:
        lanes = np.flatnonzero(self._pending)
        if not len(lanes):
            return
        self._guide[lanes], self._subgoal[lanes] = self._selector.select(
            lanes, self._scene[lanes] * PROGRESS + self._progress[lanes]
        )
        most = self._settings.max_steps
        patience = np.where(self._guide == TARGET, most, int(self._settings.patience * most))
        limit = np.where(environment.available(self._subgoal), patience, 1)
        self._limit = np.where(self._pending, limit, self._limit)
        self._since[lanes] = environment.t[lanes]
        self._reward[lanes] = 0.0
        self._pending[:] = False

    def _act(self, observations: Floats, actions: NDArray[Any], log_probs: Floats) -> None:
        for number, actor in enumerate(self._actors):
            led = self._guide == number
            if led.all():
                actions[:], log_probs[:] = actor.act(observations, self._rng)
            elif led.any():
                actions[led], log_probs[led] = actor.act(observations[led], self._rng)

    def _record(self, lanes: Ints, reached: Bools, cut: Bools, step: Step, next_scenes: Ints) -> None:
        if not len(lanes):
            return
        scenes, rewards = self._scene[lanes], self._reward[lanes]
        progress = self._progress[lanes]
        self._progress[lanes] = np.minimum(progress + (rewards > 0), PROGRESS - 1)
        outcome = Outcome(
            lanes,
            scenes * PROGRESS + progress,
            self._subgoal[lanes],
            self._guide[lanes],
            self._steps[lanes],
            rewards,
            reached[lanes],
            cut[lanes],
            step.terminated[lanes],
            step.score[lanes] > 0,
            step.truncated[lanes],
            next_scenes[lanes] * PROGRESS + self._progress[lanes],
        )
        for lane, scene in zip(lanes.tolist(), scenes.tolist(), strict=True):
            self._passed[lane][scene] = None
        for listener in self._listeners:
            listener.on_decision_end(outcome)

    def _forget(self, lanes: Ints) -> None:
        """The lanes' episodes are over."""
        self._restarted = len(lanes) > 0
        self._ended = {lane: tuple(sorted(self._passed[lane])) for lane in lanes.tolist()}
        self._progress[lanes] = 0
        for lane in self._ended:
            self._passed[lane] = {}
