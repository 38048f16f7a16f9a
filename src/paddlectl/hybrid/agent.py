"""The hybrid model as an agent: both levels learn from what is decided and done."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paddlectl.agents.base import Episode, ReuseRow, Tables
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.rollout import DecisionListener, Rollout, SubgoalSelector
from paddlectl.learners.base import Actor
from paddlectl.tasks.base import Environment, Floats, Ints, Step

RECENT = 500
"""Latest episodes that the crispness told meanwhile is over."""


class HybridAgent:
    """Updates both levels of a hybrid policy, whoever it is that decides and acts.

    Args:
        learner: Who learns.
        selector: Who decides.
        actors: The low level of each guide that the selector may name; the learner's own first.
        rng: Of what the actors leave to chance.
        listeners: Learn from the decisions, besides the learner's own credit.
    """

    def __init__(
        self,
        learner: HybridPolicy,
        selector: SubgoalSelector,
        actors: Sequence[Actor],
        rng: np.random.Generator,
        listeners: Sequence[DecisionListener] = (),
    ) -> None:
        settings = learner.settings
        self.learner = learner
        self.selector = selector
        self.rollout_steps = settings.rollout_steps
        self.credit = learner.credit()
        self.rollout = Rollout(
            settings.num_envs,
            learner.clauses,
            selector,
            actors,
            settings.decisions,
            settings.low_level.discount,
            learner.buffer(settings.rollout_steps, settings.num_envs),
            rng,
            [*listeners, self.credit],
        )
        self._fresh = True
        self._recent = _Recent(len(learner.clauses.bodies))

    def act(self, environment: Environment) -> NDArray[Any]:
        """As the rollout does; before a block the selector reads the clause weights anew. [B, ...]"""
        if self._fresh:
            self.selector.refresh()
        self._fresh = False
        return self.rollout.act(environment)

    def observe(self, environment: Environment, step: Step) -> None:
        """Ends decisions."""
        self.rollout.observe(environment, step)

    def scenes(self, lane: int) -> tuple[int, ...]:
        """The scenes that the episode came through which has just ended there."""
        passed = self.rollout.scenes(lane)
        self._recent.add(passed)
        return passed

    def subgoals(self) -> Ints:
        """Those of the rollout. [B]"""
        return self.rollout.subgoals()

    def update(self, environment: Environment, progress: float) -> dict[str, float]:
        """Updates the low level, then the clauses."""
        self._fresh = True
        self.learner.low_level.anneal(progress)
        self.learner.low_level.update(self.rollout.close(environment))
        self.credit.update()
        return {"crispness": self.learner.crispness(self._recent.shares())}

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

    def policy(self) -> HybridPolicy:
        """What it has learned."""
        return self.learner


class _Recent:
    """Which of so many scenes the latest episodes came through."""

    def __init__(self, scenes: int) -> None:
        self._episodes = 0
        self._passed = np.zeros((RECENT, scenes), np.bool_)

    def add(self, passed: Sequence[int]) -> None:
        """Takes in the next episode."""
        row = self._passed[self._episodes % RECENT]
        row[:] = False
        row[list(passed)] = True
        self._episodes += 1

    def shares(self) -> Floats:
        """Share of the episodes that came through each scene; 0 before the first. [S]"""
        shares: Floats = self._passed.sum(0) / max(1, min(self._episodes, RECENT))
        return shares
