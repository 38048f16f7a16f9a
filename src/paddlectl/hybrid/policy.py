"""The hybrid decision model: a logic program picks a subgoal, a learner reaches it."""

from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.hybrid.credit import Credit, credit
from paddlectl.hybrid.rollout import PROGRESS, Rollout
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.base import Learner
from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.logic.clauses import Clause, Program
from paddlectl.logic.templates import scenes
from paddlectl.tasks.base import Bools, Floats, Ints, Task

ON_PATH = 0.05
"""A scene is on a policy's path if at least this share of its episodes come through it."""

EXECUTED = 0.1
"""Execution probability from which a clause belongs to the synthesised program (method, section 4)."""


class HybridPolicy:
    """π: the complete clause set of a task with learned weights, and its low level."""

    def __init__(self, task: Task, seed: int, settings: HybridSettings) -> None:
        environment = task.make(1, 0)
        vocabulary = task.vocabulary
        self.task = task
        self.action_repeat = settings.action_repeat
        self._sizes = environment.observation_size, environment.actions.shape, environment.actions.dtype
        self.settings = settings
        self.clauses = ClauseLearner(
            vocabulary.atoms,
            scenes(vocabulary.atoms, vocabulary.exclusions),
            task.subgoals,
            seed,
            settings.clauses,
        )
        self.scene_count = len(self.clauses.bodies)
        self.low_level: Learner = settings.low_level.learner(
            environment.observation_size, environment.actions.size, seed
        )

    def program(self, visited: Ints | None = None, threshold: float = 0.0) -> Program:
        """The clauses with execution probability ≥ `threshold` in the scenes `visited`; all if None."""
        probabilities = self.clauses.probabilities()
        rows = range(len(self.clauses.bodies)) if visited is None else visited
        kept = [
            (Clause(subgoal, self.clauses.bodies[row]), round(float(p), 6))
            for row in rows
            for subgoal, p in zip(self.clauses.heads, probabilities[row], strict=True)
            if p >= threshold
        ]
        return Program(tuple(clause for clause, _ in kept), tuple(p for _, p in kept))

    def played_program(self, passed: Ints, episodes: int) -> tuple[Program, float]:
        """The clauses executed in scenes that were visited, and the crispness on their path.

        Args:
            passed: How many of the episodes came through each scene. [S]
            episodes: How many were played.
        """
        return self.program(np.flatnonzero(passed), EXECUTED), self.crispness(passed / episodes)

    def crispness(self, shares: NDArray[Any]) -> float:
        """Smallest best-clause probability over scenes that at least ON_PATH of episodes pass; 0 if none."""
        best = self.clauses.probabilities().max(-1)[shares >= ON_PATH]
        return float(best.min()) if len(best) else 0.0

    def player(self, task: Task, environments: int, seed: np.random.SeedSequence) -> Rollout:
        """Plays by the sharpened program and the frozen low level; all chance is `seed`'s.

        The task may be another than the policy's, of the same domain: its facts are then read in the policy's
        own vocabulary.
        """
        choices, actions = map(np.random.default_rng, seed.spawn(2))
        return Rollout(
            environments,
            _Reading(self.clauses, task),
            ProgramSelector(self, choices, self.settings.sharpness),
            [self.low_level.eval_actor()],
            self.settings.decisions,
            self.settings.low_level.discount,
            self.buffer(1, environments),
            actions,
        )

    def buffer(self, steps: int, environments: int) -> RolloutBuffer:
        """For so many steps of the low level."""
        return RolloutBuffer.empty(steps, environments, *self._sizes)

    def credit(self) -> Credit:
        """A new credit of decisions for its clause weights to learn from."""
        return credit(self.clauses, task_subgoals(self.task), self.settings.credit)

    def settings_document(self) -> dict[str, Any]:
        """Its settings as JSON-able values."""
        return asdict(self.settings)

    def state(self) -> dict[str, torch.Tensor]:
        """All tensors by name."""
        return {**self.clauses.state(), **self.low_level.state()}

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes all tensors from `state`."""
        self.clauses.load(state)
        self.low_level.load(state)


class _Reading:
    """The scenes of a policy, read off the valuations of any task of its domain.

    A fact that the task knows nothing of doesn't hold.
    """

    def __init__(self, clauses: ClauseLearner, task: Task) -> None:
        known = task.vocabulary.atoms
        self._clauses = clauses
        self._columns = [known.index(atom) if atom in known else len(known) for atom in clauses.atoms]

    def scenes(self, valuation: Bools) -> Ints:
        padded = np.pad(valuation, ((0, 0), (0, 1)))
        return self._clauses.scenes(padded[:, self._columns])


class ProgramSelector:
    """The selector of a policy that acts alone: samples subgoals from its clause weights."""

    def __init__(self, policy: HybridPolicy, rng: np.random.Generator, sharpness: float = 1.0) -> None:
        self._policy = policy
        self._rng = rng
        self._sharpness = sharpness
        self._domain_subgoal = domain_subgoals(policy.task)
        self.refresh()

    def refresh(self) -> None:
        """Reads the clause weights anew, after an update."""
        self._probabilities = sharpened(self._policy.clauses.probabilities(), self._sharpness)

    def select(self, lanes: Ints, scene_states: Ints) -> tuple[Ints, Ints]:
        """Its own guide, and a subgoal sampled in each scene. [n], [n]"""
        subgoals = sample_rows(self._probabilities[scene_states // PROGRESS], self._rng)
        return np.full(len(lanes), TARGET), self._domain_subgoal[subgoals]


def domain_subgoals(task: Task) -> Ints:
    """Index among the domain's subgoals of each of the task's. [H]"""
    return np.array([task.domain_subgoals.index(subgoal) for subgoal in task.subgoals])


def task_subgoals(task: Task) -> Ints:
    """Index among the task's subgoals of each of the domain's; -1 for one that it hasn't. [domain's H]"""
    return np.array([task.subgoals.index(h) if h in task.subgoals else -1 for h in task.domain_subgoals])


def sharpened(probabilities: Floats, power: float) -> Floats:
    """p^power, each row normalised. [S, H]"""
    raised = probabilities**power
    result: Floats = raised / raised.sum(-1, keepdims=True)
    return result


def sample_rows(probabilities: Floats, rng: np.random.Generator) -> Ints:
    """One column index from each row's distribution. [n, H] -> [n]"""
    cumulative = probabilities.cumsum(-1)
    drawn: Ints = (rng.random((len(probabilities), 1)) * cumulative[:, -1:] < cumulative).argmax(-1)
    return drawn
