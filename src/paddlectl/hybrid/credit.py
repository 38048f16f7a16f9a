"""Q of Eq. 1: what a subgoal was worth in its scene, from a model or by Monte-Carlo returns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from paddlectl.hybrid.rollout import PROGRESS, Outcome
from paddlectl.hybrid.semi_markov import SemiMarkovModel, Table
from paddlectl.learners.buffers import TARGET
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.ranges import AtLeastOne, Count, NotNegative
from paddlectl.tasks.base import Bools, Floats, Ints


class Credit(Protocol):
    """Turns decisions into updates of the clause weights."""

    def on_decision_end(self, outcome: Outcome) -> None:
        """Counts the decisions that ended in a step."""

    def update(self) -> None:
        """Updates the weights, once a block."""


@dataclass(frozen=True)
class CreditSettings:
    """How Q is estimated.

    Attributes:
        planned: By `SemiMarkovModel`; otherwise by Monte-Carlo returns, as the paper has it.
        memory: Latest decisions that a cell of the model weighs.
        prior: Decisions' worth of belief that a subgoal is worth as much as its scene.
        sweeps: Of policy evaluation before each update.
        steps: Gradient steps on the model's advantages after a rollout.
        imitation_margin: A guide's subgoal is imitated if it is worth at most so much less than the best.
            Where one place lies on the way to another, both are worth about the same, be they reached or not.
        batch: Episodes to a Monte-Carlo update.
    """

    planned: bool = True
    memory: AtLeastOne = 500.0
    prior: NotNegative = 3.0
    sweeps: Count = 60
    steps: Count = 8
    imitation_margin: NotNegative = 0.0
    batch: Count = 16


class ModelBasedCredit:
    """Eq. 1 with the advantages of a model's returns, for all subgoals at once.

    Decisions count as soon as they end, whoever made them. A guided one that reached its subgoal is
    imitated too, weighted by its return: a crisp guide always takes the same subgoal, so there is no other
    to have an advantage over. But only as long as the model knows no subgoal there that is better by more
    than a margin: a guide may well reach a subgoal that leads nowhere.

    Args:
        clauses: The weights that learn.
        subgoal_of: Index among the clauses' heads of each of the domain's; -1 for none. [domain's H]
        settings: The numbers.
    """

    def __init__(self, clauses: ClauseLearner, subgoal_of: Ints, settings: CreditSettings) -> None:
        scene_states = len(clauses.bodies) * PROGRESS
        self._clauses = clauses
        self._subgoal_of = subgoal_of
        self._settings = settings
        self._model = SemiMarkovModel(scene_states, len(clauses.heads), settings.memory)
        self._values = np.zeros(scene_states)
        self._visits = np.zeros(scene_states)
        self._guided = np.zeros((scene_states, len(clauses.heads)))

    def on_decision_end(self, outcome: Outcome) -> None:
        """Counts the decisions for the subgoals that are heads of clauses."""
        discounts = self._clauses.settings.discounts(outcome.steps)
        taught = (outcome.guides != TARGET) & outcome.reached
        for scene_state, subgoal, guided, discount, reward, terminated, following in zip(
            outcome.scene_states,
            self._subgoal_of[outcome.subgoals],
            taught,
            discounts,
            outcome.rewards,
            outcome.terminated,
            outcome.next_scene_states,
            strict=True,
        ):
            if subgoal >= 0:
                self._visits[scene_state] += 1
                self._guided[scene_state, subgoal] += guided
                self._model.record(scene_state, subgoal, reward, None if terminated else following, discount)

    def update(self) -> None:
        """Evaluates the present program in the model, then makes an expected update by its advantages."""
        if not self._visits.any():
            return
        policy = np.repeat(self._clauses.probabilities(), PROGRESS, axis=0)
        for _ in range(self._settings.sweeps):
            returns = self._model.returns(self._values, self._settings.prior)
            self._values = (policy * returns).sum(-1)
        advantages = self._visits[:, None] * (returns - self._values[:, None])
        best = returns >= returns.max(-1, keepdims=True) - self._settings.imitation_margin
        imitation = self._guided * returns * best
        self._clauses.expected_update(
            self._by_scene(advantages),
            self._by_scene(imitation),
            self._by_scene(self._visits),
            self._settings.steps,
        )
        self._visits[:] = 0.0
        self._guided[:] = 0.0

    def _by_scene(self, table: Table) -> Table:
        """Summed over the levels of progress. [R, …] -> [S, …]"""
        by_scene: Table = table.reshape(len(self._clauses.bodies), PROGRESS, *table.shape[1:]).sum(1)
        return by_scene


class Decisions(NamedTuple):
    """The high-level samples (B, H, R_extr) of one episode, in order. Each field is [N]."""

    scenes: Ints
    subgoals: Ints
    returns: Floats
    imitate: Bools


class MonteCarloCredit:
    """Eq. 1 as the paper has it: discounted returns of finished episodes, a few episodes at a time.

    An episode's return is what it earned within the horizon; without a table there is no value to go on from.
    """

    def __init__(self, clauses: ClauseLearner, subgoal_of: Ints, settings: CreditSettings) -> None:
        self._clauses = clauses
        self._subgoal_of = subgoal_of
        self._batch = settings.batch
        self._going_on: dict[int, list[tuple[int, int, float, bool]]] = {}
        self._ended: list[Decisions] = []

    def on_decision_end(self, outcome: Outcome) -> None:
        """Keeps the decisions until their episodes end."""
        imitate = (outcome.guides != TARGET) & outcome.reached
        columns = (
            outcome.lanes,
            outcome.scene_states // PROGRESS,
            outcome.subgoals,
            outcome.rewards,
            imitate,
            outcome.done,
        )
        for lane, scene, subgoal, reward, imitated, done in zip(*(c.tolist() for c in columns), strict=True):
            self._going_on.setdefault(lane, []).append((scene, subgoal, reward, imitated))
            if done:
                scenes, subgoals, rewards, imitations = zip(*self._going_on.pop(lane), strict=True)
                returns = discounted_returns(rewards, self._clauses.settings.discount)
                made = Decisions(np.array(scenes), np.array(subgoals), returns, np.array(imitations))
                self._ended.append(made)

    def update(self) -> None:
        """Scores the decisions under the learner's own weights."""
        for start in range(0, len(self._ended), self._batch):
            columns = zip(*self._ended[start : start + self._batch], strict=True)
            scenes, subgoals, returns, imitate = (np.concatenate(column) for column in columns)
            known = self._subgoal_of[subgoals] >= 0
            self._clauses.update(
                scenes[known], self._subgoal_of[subgoals[known]], returns[known], imitate[known]
            )
        self._ended = []


def discounted_returns(rewards: Sequence[float], discount: float) -> Floats:
    """Return from each decision to the episode's end, discounted per decision. [N]"""
    returns = np.zeros(len(rewards), np.float32)
    running = 0.0
    for k in reversed(range(len(rewards))):
        running = rewards[k] + discount * running
        returns[k] = running
    return returns


def credit(clauses: ClauseLearner, subgoal_of: Ints, settings: CreditSettings) -> Credit:
    """The credit that the settings ask for."""
    kind = ModelBasedCredit if settings.planned else MonteCarloCredit
    return kind(clauses, subgoal_of, settings)
