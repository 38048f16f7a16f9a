"""Records who led where and why: what a transfer leaves for `explain`, as JSON-able rows."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from paddlectl.agents.base import TARGET_NAME
from paddlectl.hybrid.rollout import PROGRESS
from paddlectl.learners.buffers import TARGET
from paddlectl.logic.clauses import Clause
from paddlectl.transfer.candidates import Source
from paddlectl.transfer.documents import body_document
from paddlectl.transfer.guidance import RULES
from paddlectl.transfer.guides import GuideSelector, TracedDecision

DIGITS = 4


class GuideRecorder:
    """Reads a selector's tables in the names of scenes, subgoals and policies."""

    def __init__(self, selector: GuideSelector, sources: Sequence[Source]) -> None:
        self._selector = selector
        self._bodies = selector.target.clauses.bodies
        self._subgoals = selector.target.task.domain_subgoals
        self._policies = (TARGET_NAME, *(source.policy for source in sources))
        self._tasks = (selector.target.task.name, *(source.task for source in sources))
        self._known = np.zeros(selector.shape, np.intp)

    def clear(self) -> None:
        """Starts the selector's counts anew; what it was asked since the last moment is forgotten."""
        self._selector.clear()
        self._known[:] = 0

    def moment(self, frames: int) -> Iterator[dict[str, Any]]:
        """Who led in each scene that came up since the last moment, and by which weights as of now.

        A scene is told by its place in mapping.json. Of several matches of one source the row shows that of
        largest Λ, at the level of progress that the scene came up with most.
        """
        if not self._selector.decisions.any():
            return
        weighing, chosen = self._selector.weigh(), self._selector.chosen.sum(-1)
        led = (chosen - self._known).reshape(-1, PROGRESS, chosen.shape[1])
        self._known = chosen
        for scene in np.flatnonzero(led.sum((1, 2))):
            row = scene * PROGRESS + int(led[scene].sum(-1).argmax())
            for number, policy in enumerate(self._policies):
                best = self._best(number, weighing.weight[row], weighing.similarity[row])
                if best is not None:
                    yield {
                        "frames": frames,
                        "scene": int(scene),
                        "policy": policy,
                        "similarity": round(float(weighing.similarity[row, best]), DIGITS),
                        "performance": round(float(weighing.performance[row, best]), DIGITS),
                        "weight": round(float(weighing.weight[row, best]), DIGITS),
                        "chosen": int(led[scene][:, self._selector.candidates.guides == number].sum()),
                    }

    def weights(self, phase: str, frames: int) -> Iterator[dict[str, Any]]:
        """One row for each scene met since the selector was cleared, and each policy with a match there.

        Of several matches of one source the row shows the best, at the level of progress that the scene
        came up with most; the counts are over all of them.
        """
        if not self._selector.decisions.any():
            return
        weighing = self._selector.weigh()
        by_scene = self._selector.decisions.reshape(-1, PROGRESS)
        for scene in np.flatnonzero(by_scene.sum(-1)):
            rows = scene * PROGRESS + np.arange(PROGRESS)
            shown = rows[by_scene[scene].argmax()]
            for number, policy in enumerate(self._policies):
                best = self._best(number, weighing.weight[shown], weighing.similarity[shown])
                if best is None:
                    continue
                led = np.ix_(rows, self._selector.candidates.guides == number)
                chosen = self._selector.chosen[led].sum((0, 1))
                yield {
                    "phase": phase,
                    "frames": frames,
                    "scene": body_document(self._bodies[scene]),
                    "policy": policy,
                    "task": self._tasks[number],
                    "similarity": float(weighing.similarity[shown, best]),
                    "performance": float(weighing.performance[shown, best]),
                    "weight": float(weighing.weight[shown, best]),
                    "decisions": int(by_scene[scene].sum()),
                    "chosen": int(chosen.sum()),
                    "rules": {rule: int(n) for rule, n in zip(RULES, chosen, strict=True) if n},
                    "reached": int(self._selector.reached[led].sum()),
                    "cut": int(self._selector.cut[led].sum()),
                }

    def trace(self, episode: Sequence[TracedDecision]) -> list[dict[str, Any]]:
        """One episode, decision by decision."""
        return [self._decision(step, decision) for step, decision in enumerate(episode, start=1)]

    def _decision(self, step: int, decision: TracedDecision) -> dict[str, Any]:
        body, subgoal = self._bodies[decision.scene_state // PROGRESS], self._subgoals[decision.subgoal]
        return {
            "step": step,
            "scene": body_document(body),
            "clause": str(Clause(subgoal, body)),
            "guide": self._policies[self._selector.candidates.guides[decision.candidate]],
            "weights": list(self._weighed(decision)),
            "head": str(subgoal),
            "steps": decision.steps,
            "reached": decision.reached,
            "cut": decision.cut,
            "rule": decision.rule,
        }

    def _weighed(self, decision: TracedDecision) -> Iterator[dict[str, Any]]:
        for number, policy in enumerate(self._policies):
            best = self._best(number, decision.weights, decision.similarity)
            if best is not None:
                yield {
                    "policy": policy,
                    "similarity": float(decision.similarity[best]),
                    "performance": float(decision.performance[best]),
                    "weight": float(decision.weights[best]),
                }

    def _best(self, number: int, weights: np.ndarray, similarity: np.ndarray) -> int | None:
        """The guide's candidate of largest Λ among those that match the scene."""
        of_guide = (self._selector.candidates.guides == number) & np.isfinite(similarity)
        if number != TARGET and not of_guide.any():
            return None
        return int(np.where(of_guide, weights, -np.inf).argmax())
