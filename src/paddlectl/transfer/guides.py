"""Who leads: the candidates that Ψ names, weighed by Λ at each decision (Algorithm 2, lines 4-14)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl.hybrid.policy import HybridPolicy, domain_subgoals, sample_rows
from paddlectl.hybrid.rollout import PROGRESS, Outcome
from paddlectl.hybrid.semi_markov import SemiMarkovModel
from paddlectl.learners.buffers import TARGET
from paddlectl.tasks.base import Bools, Ints
from paddlectl.transfer.bandit import AloneOrGuided
from paddlectl.transfer.candidates import Candidates
from paddlectl.transfer.guidance import (
    RULES,
    GuidanceSettings,
    PaperSettings,
    Rule,
    faded_weight,
    guidance_weight,
    select_guide,
)
from paddlectl.transfer.performance import MeanReturns, Table, performance


class Weighing(NamedTuple):
    """The tables behind one choice. Each is [S, C]."""

    similarity: Table
    performance: Table
    weight: Table


class TracedDecision(NamedTuple):
    """One decision of an episode, with the weights by which its guide was chosen.

    Attributes:
        candidate: The one that led.
        weights: Λ of each candidate, this episode's penalties included. [C]
        cut: The horizon ended it, so whether it would have reached its subgoal isn't known.
        rule: Why it led.
    """

    scene_state: int
    candidate: int
    subgoal: int
    steps: int
    reached: bool
    cut: bool
    rule: Rule
    similarity: Table
    performance: Table
    weights: Table


class GuideSelector:
    """Scene → Λ of every candidate → guide → subgoal.

    Its tables have a row for each scene state (`rollout.PROGRESS`).

    Attributes:
        candidates: Who may lead where.
        traces: The decisions of each episode that ended since `clear`, in order of ending.
        decisions, chosen, reached, cut: How often a scene state came up, a candidate led there by each of
            `RULES`, reached its subgoal, and was cut off by the horizon, since `clear`. [R], [R, C, rules],
            [R, C], [R, C]
    """

    def __init__(
        self, target: HybridPolicy, candidates: Candidates, num_envs: int, rng: np.random.Generator
    ) -> None:
        scenes = len(target.clauses.bodies)
        self.target = target
        self.candidates = candidates
        self.shape = (scenes * PROGRESS, len(candidates.guides))
        self.traces: list[list[TracedDecision]] = []
        self._rng = rng
        self._own_subgoals = domain_subgoals(target.task)
        self._present: list[TracedDecision | None] = [None] * num_envs
        self._episode: list[list[TracedDecision]] = [[] for _ in range(num_envs)]
        self.clear()

    def clear(self) -> None:
        """Starts the counts and traces anew."""
        self.traces = []
        self.decisions = np.zeros(self.shape[0], np.intp)
        self.chosen = np.zeros((*self.shape, len(RULES)), np.intp)
        self.reached = np.zeros(self.shape, np.intp)
        self.cut = np.zeros(self.shape, np.intp)

    def refresh(self) -> None:
        """Reads the target's clause weights anew, after an update."""
        self._own = self.target.clauses.probabilities()

    def weigh(self) -> Weighing:
        """ψ, Φ and Λ of every candidate in every scene state, as of now. [R, C] each"""
        raise NotImplementedError

    def select(self, lanes: Ints, scene_states: Ints) -> tuple[Ints, Ints]:
        """The guide and the subgoal for each lane. [n], [n]"""
        weighing = self.weigh()
        unpenalised = weighing.weight[scene_states]
        weights = self._penalised(unpenalised, lanes, scene_states)
        scenes = scene_states // PROGRESS
        chosen = select_guide(weights, self._rng)
        rules = self._rules(chosen, weights, unpenalised)
        alone = self._alone_in(lanes)
        rules[alone & (chosen != TARGET)] = "alone"
        chosen[alone] = TARGET
        subgoals = self._subgoals(chosen, scenes)
        for lane, scene_state, candidate, subgoal, rule, weight in zip(
            lanes, scene_states, chosen, subgoals, rules, weights, strict=True
        ):
            self._present[lane] = TracedDecision(
                int(scene_state),
                int(candidate),
                int(subgoal),
                0,
                False,
                False,
                rule,
                weighing.similarity[scene_state],
                weighing.performance[scene_state],
                weight,
            )
        return self.candidates.guides[chosen], subgoals

    def on_decision_end(self, outcome: Outcome) -> None:
        """Counts what came of the decisions that ended."""
        for lane, steps, reward, reached, cut, terminated, done, following in zip(
            outcome.lanes,
            outcome.steps,
            outcome.rewards,
            outcome.reached,
            outcome.cut,
            outcome.terminated,
            outcome.done,
            outcome.next_scene_states,
            strict=True,
        ):
            present = self._present[lane]
            assert present is not None
            decision = present._replace(steps=int(steps), reached=bool(reached), cut=bool(cut))
            self._episode[lane].append(decision)
            self.decisions[decision.scene_state] += 1
            self.chosen[decision.scene_state, decision.candidate, RULES.index(decision.rule)] += 1
            self.reached[decision.scene_state, decision.candidate] += reached
            self.cut[decision.scene_state, decision.candidate] += cut
            self._learn(lane, decision, float(reward), None if terminated else int(following))
            if done:
                self._end(lane)
                self.traces.append(self._episode[lane])
                self._episode[lane] = []

    def _subgoals(self, chosen: Ints, scenes: Ints) -> Ints:
        subgoals = sample_rows(self.candidates.subgoals[chosen], self._rng)
        own = chosen == TARGET
        subgoals[own] = self._own_subgoals[sample_rows(self._own[scenes[own]], self._rng)]
        return subgoals

    def _penalised(self, weights: Table, lanes: Ints, scene_states: Ints) -> Table:
        """Λ after what the candidates did before in each lane's episode. [n, C] -> [n, C]"""
        return weights

    def _rules(self, chosen: Ints, weights: Table, unpenalised: Table) -> NDArray[np.object_]:
        """Why each candidate [n] was chosen by its Λ [n, C], with this episode's penalties: `Rule`s. [n]"""
        largest, guides = weights == weights.max(-1, keepdims=True), self.candidates.guides
        first = np.where(largest, guides, guides.max() + 1).min(-1)
        last = np.where(largest, guides, TARGET).max(-1)
        rules = np.full(len(chosen), "largest", object)
        rules[first < last] = "tie"
        rules[unpenalised[np.arange(len(chosen)), chosen] < unpenalised.max(-1)] = "penalty"
        return rules

    def _alone_in(self, lanes: Ints) -> Bools:
        """In which lanes the target leads the episode alone. [n]"""
        return np.zeros(len(lanes), np.bool_)

    def _learn(self, lane: int, decision: TracedDecision, reward: float, following: int | None) -> None:
        """Takes in a decision that ended.

        Args:
            lane: Where.
            decision: What was decided.
            reward: Extrinsic, within it.
            following: The scene state that it led to; None if the task was solved.
        """
        raise NotImplementedError

    def _end(self, lane: int) -> None:
        """The lane's episode ended with the decision that was just learned from."""
        raise NotImplementedError


class PaperGuides(GuideSelector):
    """`guidance: paper`: Eqs. 2 and 3, read as `PaperSettings` say.

    G is the running mean of the discounted return from a decision to its episode's end (Algorithm 2, line
    18), of each candidate or of each subgoal in a scene; of a subgoal the first visit of an episode counts.
    """

    def __init__(
        self,
        target: HybridPolicy,
        candidates: Candidates,
        num_envs: int,
        rng: np.random.Generator,
        settings: PaperSettings,
    ) -> None:
        super().__init__(target, candidates, num_envs, rng)
        scenes, subgoals = candidates.similarity.shape[0], candidates.subgoals.shape[1]
        self.readings = settings
        self._per_subgoal = settings.values == "per_subgoal"
        columns = subgoals if self._per_subgoal else self.shape[1]
        self._returns = MeanReturns((scenes, columns), settings.initial_performance)
        self._rewards: list[list[float]] = [[] for _ in range(num_envs)]

    def weigh(self) -> Weighing:
        """ψ + Φ, the same at every level of progress. [R, C] each"""
        psi = self.candidates.similarity
        entropy = np.broadcast_to(self.candidates.entropy, psi.shape).copy()
        entropy[:, TARGET] = -(self._own * np.log(self._own + 1e-12)).sum(-1)
        phi = performance(self._worth(), entropy, clipped=self.readings.normalise == "clip")
        tables = (psi, phi, guidance_weight(psi, phi))
        return Weighing(*(np.repeat(table, PROGRESS, axis=0) for table in tables))

    def _worth(self) -> Table:
        """G of every candidate; of subgoals, what its program expects of them: Σ p·V. [S, C]"""
        values = self._returns.mean
        if not self._per_subgoal:
            return values
        worth: Table = values @ self.candidates.subgoals.T.astype(np.float64)
        worth[:, TARGET] = (self._own * values[:, self._own_subgoals]).sum(-1)
        return worth

    def _learn(self, lane: int, decision: TracedDecision, reward: float, following: int | None) -> None:
        missed = not decision.reached and not decision.cut
        self._rewards[lane].append(reward - self.readings.failure_cost * missed)

    def _end(self, lane: int) -> None:
        discount = self.target.settings.clauses.discount
        return_, returns = 0.0, []
        for earned in reversed(self._rewards[lane]):
            return_ = earned + discount * return_
            returns.append(return_)
        seen = set()
        for decision, return_ in zip(self._episode[lane], reversed(returns), strict=True):
            scene = decision.scene_state // PROGRESS
            cell = (scene, decision.subgoal if self._per_subgoal else decision.candidate)
            if not (self._per_subgoal and cell in seen):
                self._returns.record(*cell, return_)
            seen.add(cell)
        self._rewards[lane] = []


class PlannedGuides(GuideSelector):
    """`guidance: default`: the rules of `GuidanceSettings` over planned returns."""

    def __init__(
        self,
        target: HybridPolicy,
        candidates: Candidates,
        num_envs: int,
        rng: np.random.Generator,
        settings: GuidanceSettings,
    ) -> None:
        super().__init__(target, candidates, num_envs, rng)
        self.rules = settings
        memory = np.where(candidates.guides == TARGET, settings.target_memory, settings.source_memory)
        self._clauses = target.settings.clauses
        self._model = SemiMarkovModel(*self.shape, memory)
        self._returns = np.zeros(self.shape)
        self._similarity = np.repeat(candidates.similarity, PROGRESS, axis=0)
        self._known = np.where(np.isfinite(self._similarity), self._similarity, 0.0)
        self._leading_subgoal = candidates.subgoals.argmax(-1)
        guides_and_subgoals = int(candidates.guides.max()) + 1, candidates.subgoals.shape[1]
        self._repeats = np.zeros((num_envs, self.shape[0], *guides_and_subgoals), np.float32)
        known = float(candidates.subgoals[1:, self._own_subgoals].any(0).mean())
        memories = settings.source_memory, settings.target_memory
        self._bandit = AloneOrGuided(known, settings.bandit_prior, memories, settings.least_alone)
        self._alone = np.zeros(num_envs, np.bool_)
        self._begins = np.ones(num_envs, np.bool_)

    def weigh(self) -> Weighing:
        """ψ faded into the planned Φ; the target's is its Φ or floor, and a margin. [R, C] each"""
        weights = self._weights()
        weights[:, TARGET] += self.rules.target_margin
        return Weighing(self._similarity, self._returns, weights)

    def _weights(self) -> Table:
        """Λ without the target's margin, by which it is planned. [R, C]"""
        weights = faded_weight(self._known, self._returns, self._model.count, self.rules.similarity_decay)
        weights[np.isneginf(self._similarity)] = -np.inf
        weights[:, TARGET] = np.maximum(self._returns[:, TARGET], self.rules.target_floor)
        return weights

    def on_decision_end(self, outcome: Outcome) -> None:
        """Counts what came of the decisions that ended, then makes one sweep of planning."""
        super().on_decision_end(outcome)
        for lane, solved in zip(outcome.lanes[outcome.done], outcome.solved[outcome.done], strict=True):
            self._bandit.record(bool(self._alone[lane]), bool(solved))
        self._returns = self._model.returns(self._weights().max(-1))

    def _penalised(self, weights: Table, lanes: Ints, scene_states: Ints) -> Table:
        leading = np.tile(self._leading_subgoal, (len(lanes), 1))
        leading[:, TARGET] = self._own_subgoals[self._own[scene_states // PROGRESS].argmax(-1)]
        repeats = self._repeats[lanes[:, None], scene_states[:, None], self.candidates.guides, leading]
        penalised: Table = weights - self.rules.repeat_penalty * repeats
        penalised[:, TARGET] = np.maximum(penalised[:, TARGET], self.rules.target_floor)
        return penalised

    def _rules(self, chosen: Ints, weights: Table, unpenalised: Table) -> NDArray[np.object_]:
        rules = super()._rules(chosen, weights, unpenalised)
        least = unpenalised[:, TARGET] <= self.rules.target_floor + self.rules.target_margin
        rules[(chosen == TARGET) & least & (rules != "penalty")] = "floor"
        return rules

    def _alone_in(self, lanes: Ints) -> Bools:
        for lane in lanes[self._begins[lanes]]:
            how = self.rules.episodes
            self._alone[lane] = how == "alone" or (how == "bandit" and self._bandit.choose(self._rng))
        self._begins[lanes] = False
        return self._alone[lanes]

    def _learn(self, lane: int, decision: TracedDecision, reward: float, following: int | None) -> None:
        guide = self.candidates.guides[decision.candidate]
        self._repeats[lane, decision.scene_state, guide, decision.subgoal] += 1
        discount = float(self._clauses.discounts(np.array(decision.steps)))
        self._model.record(decision.scene_state, decision.candidate, reward, following, discount)

    def _end(self, lane: int) -> None:
        self._repeats[lane] = 0
        self._begins[lane] = True
