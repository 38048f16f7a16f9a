"""B lanes of hybrid decisions: a chooser picks subgoals, actors reach them.

A decision picks a head for the present scene. It ends when the subgoal is reached, when the scene
changes in any other way, after `max_steps` steps, or with the episode (method, section 4). A
subgoal that has nothing to act on, or holds already, is given up after one step.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from paddlectl.learners.base import Actor
from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.tasks.base import Bools, Environment, Floats, Ints, Step

LEVELS = 6
"""Levels of progress that are told apart within a scene.

A situation is a scene and how many of the episode's decisions were paid: situation = scene * LEVELS + level.
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
    """

    max_steps: int = 50
    patience: float = 0.3
    reward_unit: float = 1.0
    reached_reward: float = 1.0
    delay_cost: float = 0.5
    failed_reward: float = -0.1


class Decisions(NamedTuple):
    """The high-level samples (B, H, R_extr) of one episode, in order. Each field is [N]."""

    scenes: Ints
    heads: Ints
    guides: Ints
    steps: Ints
    rewards: Floats
    reached: Bools

    @classmethod
    def empty(cls, *shape: int) -> "Decisions":
        scenes, heads, guides, steps = np.zeros((4, *shape), np.intp)
        return cls(scenes, heads, guides, steps, np.zeros(shape, np.float32), np.zeros(shape, np.bool_))

    def of_lane(self, lane: int, count: int) -> "Decisions":
        """A copy of the first `count` decisions of one lane of a [B, N] history."""
        return Decisions(
            self.scenes[lane, :count].copy(),
            self.heads[lane, :count].copy(),
            self.guides[lane, :count].copy(),
            self.steps[lane, :count].copy(),
            self.rewards[lane, :count].copy(),
            self.reached[lane, :count].copy(),
        )


class Episode(NamedTuple):
    """A finished episode.

    Attributes:
        order: Place among all episodes in the order in which they started.
        started: Frames that had been collected when it started.
        finished: Frames when it ended.
        score: Final reward alone, 0 on failure.
        length: Steps.
    """

    order: int
    started: int
    finished: int
    score: float
    length: int
    decisions: Decisions

    def returns(self, discount: float) -> Floats:
        """Discounted extrinsic return from each decision on, discounted per decision. [N]"""
        returns = np.zeros(len(self.decisions.rewards), np.float32)
        running = 0.0
        for k in reversed(range(len(returns))):
            running = float(self.decisions.rewards[k]) + discount * running
            returns[k] = running
        return returns


class Outcome(NamedTuple):
    """Decisions that ended in one step, one a lane. Each field is [n].

    Attributes:
        situations: Where it was taken.
        rewards: Extrinsic reward within the decision.
        cut: It ended for no other reason than the horizon: whether it would have reached its subgoal isn't
            known.
        terminated: The task was solved with it: nothing is to come.
        truncated: The episode ended unsolved with it, at the horizon.
        next_situations: Where it led.
    """

    lanes: Ints
    situations: Ints
    heads: Ints
    guides: Ints
    steps: Ints
    rewards: Floats
    reached: Bools
    cut: Bools
    terminated: Bools
    truncated: Bools
    next_situations: Ints

    @property
    def done(self) -> Bools:
        """The episode ended with it. [n]"""
        return self.terminated | self.truncated


class Chooser(Protocol):
    """Who decides: a program, or the guidance over several."""

    def refresh(self) -> None:
        """Reads the learning policy's clause weights anew; called before each block."""

    def choose(self, lanes: Ints, situations: Ints) -> tuple[Ints, Ints]:
        """The guide and the head, as an index into the domain's heads, for each lane. [n], [n]"""


class Witness(Protocol):
    """Who learns from what was decided."""

    def decided(self, outcome: "Outcome") -> None:
        """Told of the decisions that ended in this step."""


class SceneReader(Protocol):
    """Maps crisp valuations [B, P] to scene numbers [B]."""

    def scenes(self, valuation: Bools) -> Ints: ...


class Rollout:
    """Runs the lanes and keeps each lane's present decision between blocks.

    Args:
        environment: The lanes.
        horizon: Most steps of an episode, which bounds its decisions.
        reader: Names the scenes.
        chooser: Picks guide and head.
        actors: The low level of each guide; the learning policy's first.
        settings: When a decision ends.
        rng: Of what the actors leave to chance.
        witnesses: Told of every decision that ended.
    """

    def __init__(
        self,
        environment: Environment,
        horizon: int,
        reader: SceneReader,
        chooser: Chooser,
        actors: Sequence[Actor],
        settings: DecisionSettings,
        rng: np.random.Generator,
        witnesses: Sequence[Witness] = (),
    ) -> None:
        lanes = environment.lanes
        self.environment = environment
        self.frames = 0
        self._reader = reader
        self._chooser = chooser
        self._actors = actors
        self._settings = settings
        self._rng = rng
        self._witnesses = witnesses
        self._head = np.zeros(lanes, np.intp)
        self._guide = np.zeros(lanes, np.intp)
        self._since = np.zeros(lanes, np.intp)
        self._steps = np.zeros(lanes, np.intp)
        self._limit = np.zeros(lanes, np.intp)
        self._reward = np.zeros(lanes, np.float32)
        self._level = np.zeros(lanes, np.intp)
        self._pending = np.ones(lanes, np.bool_)
        self._order = np.arange(lanes)
        self._started = np.zeros(lanes, np.intp)
        self._count = np.zeros(lanes, np.intp)
        self._history = Decisions.empty(lanes, horizon)
        self._scene = reader.scenes(environment.valuation())

    def collect(self, buffer: RolloutBuffer) -> list[Episode]:
        """Fills `buffer` with its T steps of all lanes; gives the episodes that ended, in order of ending."""
        episodes: list[Episode] = []
        for t in range(len(buffer.actions)):
            self._decide()
            observations = self.environment.observe(self._head)
            buffer.observations[t] = observations
            buffer.guides[t] = self._guide
            self._act(observations, buffer.actions[t], buffer.log_probs[t])
            episodes.extend(self._step(buffer, t))
        buffer.last_observations[:] = self.environment.observe(self._head)
        return episodes

    def _decide(self) -> None:
        lanes = np.flatnonzero(self._pending)
        if not len(lanes):
            return
        self._guide[lanes], self._head[lanes] = self._chooser.choose(
            lanes, self._scene[lanes] * LEVELS + self._level[lanes]
        )
        most = self._settings.max_steps
        patience = np.where(self._guide == TARGET, most, int(self._settings.patience * most))
        limit = np.where(self.environment.available(self._head), patience, 1)
        self._limit = np.where(self._pending, limit, self._limit)
        self._since[lanes] = self.environment.t[lanes]
        self._reward[lanes] = 0.0
        self._pending[:] = False

    def _act(self, observations: Floats, actions: NDArray[Any], log_probs: Floats) -> None:
        for number, actor in enumerate(self._actors):
            led = self._guide == number
            if led.all():
                actions[:], log_probs[:] = actor.act(observations, self._rng)
            elif led.any():
                actions[led], log_probs[led] = actor.act(observations[led], self._rng)

    def _step(self, buffer: RolloutBuffer, t: int) -> Iterator[Episode]:
        settings = self._settings
        before = self.environment.t.sum()
        step = self.environment.step(self.environment.in_world(self._head, buffer.actions[t]))
        self.frames += int(self.environment.t.sum() - before)
        self._steps = self.environment.t - self._since
        self._reward += step.reward / np.float32(settings.reward_unit)
        done = step.terminated | step.truncated
        scene = self._reader.scenes(self.environment.valuation())
        reached = self.environment.reached(self._head) & (self._limit > 1)
        over = step.terminated | reached | (scene != self._scene) | (self._steps >= self._limit)
        cut = step.truncated & ~over
        ends = over | cut
        prompt = settings.reached_reward - settings.delay_cost * self._steps / settings.max_steps
        buffer.rewards[t] = np.where(reached, prompt, np.where(over, settings.failed_reward, 0.0))
        buffer.ends[t] = ends
        buffer.reached[t] = reached
        buffer.cut[t] = cut
        buffer.terminated[t] = step.terminated
        buffer.truncated[t] = step.truncated
        if ends.any():
            buffer.final_observations[t] = self.environment.observe(self._head)
        self._record(np.flatnonzero(ends), reached, cut, step, scene)
        self._pending = ends
        self._scene = scene
        return self._finish(np.flatnonzero(done), done, step.score)

    def _record(self, lanes: Ints, reached: Bools, cut: Bools, step: Step, next_scenes: Ints) -> None:
        if not len(lanes):
            return
        scenes, rewards = self._scene[lanes], self._reward[lanes]
        level = self._level[lanes]
        self._level[lanes] = np.minimum(level + (rewards > 0), LEVELS - 1)
        outcome = Outcome(
            lanes,
            scenes * LEVELS + level,
            self._head[lanes],
            self._guide[lanes],
            self._steps[lanes],
            rewards,
            reached[lanes],
            cut[lanes],
            step.terminated[lanes],
            step.truncated[lanes],
            next_scenes[lanes] * LEVELS + self._level[lanes],
        )
        place = (lanes, self._count[lanes])
        self._history.scenes[place] = scenes
        self._history.heads[place] = outcome.heads
        self._history.guides[place] = outcome.guides
        self._history.steps[place] = outcome.steps
        self._history.rewards[place] = rewards
        self._history.reached[place] = outcome.reached
        self._count[lanes] += 1
        for witness in self._witnesses:
            witness.decided(outcome)

    def _finish(self, lanes: Ints, done: Bools, score: Floats) -> Iterator[Episode]:
        if not len(lanes):
            return iter(())
        episodes = [
            Episode(
                int(self._order[lane]),
                int(self._started[lane]),
                self.frames,
                float(score[lane]),
                int(self.environment.t[lane]),
                self._history.of_lane(int(lane), int(self._count[lane])),
            )
            for lane in lanes
        ]
        self.environment.reset(done)
        self._scene = self._reader.scenes(self.environment.valuation())
        self._order[lanes] = self._order.max() + 1 + np.arange(len(lanes))
        self._started[lanes] = self.frames
        self._count[lanes] = 0
        self._level[lanes] = 0
        return iter(episodes)
