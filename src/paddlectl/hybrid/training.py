"""Collect, update, stop: the hybrid model's training, a round at a time, and its evaluation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from paddlectl.hybrid.credit import Credit
from paddlectl.hybrid.policy import HybridPolicy, OwnProgram
from paddlectl.hybrid.rollout import Chooser, Episode, Rollout, Witness
from paddlectl.learners.base import Actor
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.logic.clauses import Program
from paddlectl.tasks.base import Bools, Environment, Ints, Task

ON_PATH = 0.05
"""A scene is on a policy's path if at least this share of its episodes come through it."""

LANES = 1000
"""Most episodes that an evaluation plays side by side. Chance is drawn for all of them together, so another
number would give more episodes than this other figures."""

EXECUTED = 0.1
"""Execution probability from which a clause belongs to the synthesised program (method, section 4)."""


class Round(NamedTuple):
    """What one block of experience brought: frames so far, and the episodes that ended in it."""

    frames: int
    episodes: list[Episode]


@dataclass(frozen=True)
class Evaluation:
    """A policy on unseen layouts.

    Attributes:
        episodes: How many were played.
        success_rate: Share solved.
        mean_score: Mean final reward, 0 on failure.
        mean_length: Mean steps, failures at the horizon.
        program: The clauses executed in the scenes visited, with their probabilities.
        crispness: Smallest best-clause probability over the scenes on the policy's path.
    """

    episodes: int
    success_rate: float
    mean_score: float
    mean_length: float
    program: Program
    crispness: float


class Learning:
    """Collect, update both levels, again. All that it needs to go on is in its attributes between two rounds.

    Attributes:
        policy: Who learns.
        chooser: Who decides.
        rollout: The lanes.
        credit: What the clause weights learn from.
        buffer: The latest block.
        frames: The budget.
        left: Rounds to come.
    """

    def __init__(
        self,
        policy: HybridPolicy,
        chooser: Chooser,
        rollout: Rollout,
        credit: Credit,
        buffer: RolloutBuffer,
        frames: int,
        rounds: int,
    ) -> None:
        self.policy = policy
        self.chooser = chooser
        self.rollout = rollout
        self.credit = credit
        self.buffer = buffer
        self.frames = frames
        self.left = rounds

    @property
    def round(self) -> int:
        """Frames of a round, at most."""
        environment = self.rollout.environment
        return len(self.buffer.actions) * environment.lanes * environment.repeat

    def __iter__(self) -> "Learning":
        return self

    def __next__(self) -> Round:
        if not self.left:
            raise StopIteration
        self.chooser.refresh()
        episodes = self.rollout.collect(self.buffer)
        self.policy.low_level.anneal(self.rollout.frames / self.frames)
        self.policy.low_level.update(self.buffer)
        self.credit.update(episodes)
        self.left -= 1
        return Round(self.rollout.frames, episodes)


def train(policy: HybridPolicy, seed: int, frames: int) -> Learning:
    """Learns from scratch within `frames`; the consumer may leave off earlier."""
    environments, choices = np.random.SeedSequence(seed).spawn(2)
    chooser = OwnProgram(policy, np.random.default_rng(choices))
    return learn(policy, chooser, [policy.low_level], environments, frames)


def learn(
    policy: HybridPolicy,
    chooser: Chooser,
    actors: Sequence[Actor],
    seed: np.random.SeedSequence,
    frames: int,
    witnesses: Sequence[Witness] = (),
) -> Learning:
    """Collect, update both levels, again: whoever it is that decides and acts, `policy` learns from it.

    Args:
        policy: Who learns.
        chooser: Who decides.
        actors: The low level of each guide that the chooser may name; the policy's own first.
        seed: Of the layouts, and of what the actors leave to chance.
        frames: The budget: as many whole blocks as it holds, and one at least.
        witnesses: Told of the decisions, besides the policy's own credit.
    """
    settings = policy.settings
    environment = policy.task.make(settings.lanes, int(seed.generate_state(1)[0]), settings.repeat)
    credit = policy.credit()
    rollout = Rollout(
        environment,
        policy.task.horizon,
        policy.clauses,
        chooser,
        actors,
        settings.decisions,
        np.random.default_rng(seed.spawn(1)[0]),
        [*witnesses, credit],
    )
    buffer = _buffer(settings.block, environment)
    rounds = max(1, frames // (settings.block * settings.lanes * environment.repeat))
    return Learning(policy, chooser, rollout, credit, buffer, frames, rounds)


def evaluate(policy: HybridPolicy, task: Task, episodes: int, seed: int) -> Evaluation:
    """Plays the first `episodes` evaluation layouts of `seed`, each once; nothing is learned.

    A lane whose episode ends takes the next layout, so that memory is that of `LANES` episodes at most. All
    chance comes from `seed`: whoever evaluates the same policy gets the same figures.

    The task may be another than the policy's, of the same domain: its facts are then read in the policy's
    own vocabulary.
    """
    choices, actions = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    environment = task.make(min(episodes, LANES), seed, policy.settings.repeat, "evaluation")
    chooser = OwnProgram(policy, choices, policy.settings.sharpness)
    rollout = Rollout(
        environment,
        task.horizon,
        _Reading(policy, task),
        chooser,
        [policy.low_level.frozen()],
        policy.settings.decisions,
        actions,
    )
    buffer = _buffer(32, environment)
    visits = np.zeros(len(policy.clauses.bodies), np.intp)
    ended = solved = length = 0
    score = 0.0
    while ended < episodes:
        played = [episode for episode in rollout.collect(buffer) if episode.order < episodes]
        ended += len(played)
        solved += sum(episode.score > 0 for episode in played)
        length += sum(episode.length for episode in played)
        score += sum(episode.score for episode in played)
        visits += scene_visits(played, len(visits))
    return Evaluation(
        episodes,
        solved / episodes,
        score / episodes,
        length / episodes,
        policy.program(np.flatnonzero(visits), EXECUTED),
        crispness(policy, visits / episodes),
    )


def _buffer(steps: int, environment: Environment) -> RolloutBuffer:
    actions = environment.actions
    return RolloutBuffer.empty(
        steps, environment.lanes, environment.observation_size, actions.shape, actions.dtype
    )


class _Reading:
    """The scenes of a policy, read off the valuations of any task of its domain.

    A fact that the task knows nothing of doesn't hold.
    """

    def __init__(self, policy: HybridPolicy, task: Task) -> None:
        known = task.vocabulary.atoms
        self._clauses = policy.clauses
        self._columns = [known.index(atom) if atom in known else len(known) for atom in policy.clauses.atoms]

    def scenes(self, valuation: Bools) -> Ints:
        padded = np.pad(valuation, ((0, 0), (0, 1)))
        return self._clauses.scenes(padded[:, self._columns])


def scene_visits(episodes: Sequence[Episode], scenes: int) -> Ints:
    """How many of the episodes came through each scene. [S]"""
    visits = np.zeros(scenes, np.intp)
    for episode in episodes:
        visits[np.unique(episode.decisions.scenes)] += 1
    return visits


def crispness(policy: HybridPolicy, shares: np.ndarray) -> float:
    """Smallest best-clause probability over the scenes that at least ON_PATH of episodes pass; 0 if none."""
    best = policy.clauses.probabilities().max(-1)[shares >= ON_PATH]
    return float(best.min()) if len(best) else 0.0
