"""What the clause weights learn from decisions, by planning and by Monte-Carlo returns."""

import numpy as np
import pytest

from paddlectl.hybrid.credit import CreditSettings, credit, discounted_returns
from paddlectl.hybrid.policy import HybridPolicy, task_subgoals
from paddlectl.hybrid.rollout import PROGRESS, Outcome
from paddlectl.hybrid.settings import HybridSettings
from scripted import END, FAR_SCENE, MOON, NEAR_SCENE, OTHER, TASK, TWO

KINDS = pytest.mark.parametrize("planned", [True, False], ids=["planned", "monte-carlo"])


class Learning:
    """A policy that learns from episodes of (scene, subgoal, reward, reached) decisions by one guide."""

    def __init__(self, planned, **settings):
        self.policy = HybridPolicy(TASK, 0, HybridSettings())
        settings = CreditSettings(planned=planned, **settings)
        self._credit = credit(self.policy.clauses, task_subgoals(TASK), settings)

    def probability(self, scene, subgoal):
        return self.policy.clauses.probabilities()[scene, task_subgoals(TASK)[subgoal]]

    def learn(self, *episodes, guide=0, blocks=30):
        for _ in range(blocks):
            for decisions in episodes:
                for _ in self.telling(decisions, guide):
                    pass
            self.update()
        return self

    def update(self):
        self._credit.update()

    def telling(self, decisions, guide=0, lane=0):
        """Tells of a decision whenever it is asked to go on."""
        progress = 0
        for number, (scene, subgoal, reward, reached) in enumerate(decisions):
            done = number + 1 == len(decisions)
            paid = min(progress + (reward > 0), PROGRESS - 1)
            following = 0 if done else decisions[number + 1][0] * PROGRESS + paid
            columns = (
                lane,
                scene * PROGRESS + progress,
                subgoal,
                guide,
                3,
                np.float32(reward),
                reached,
                False,
                done,
                done,
                False,
                following,
            )
            self._credit.on_decision_end(Outcome(*(np.array([column]) for column in columns)))
            yield
            progress = paid


SOLVED = [(NEAR_SCENE, TWO, 0.0, True), (FAR_SCENE, END, 0.9, True)]


@KINDS
def test_subgoals_that_lead_to_the_end_are_learned(planned):
    near = [(NEAR_SCENE, MOON, 0.0, False), (NEAR_SCENE, END, 0.0, False)]
    far = [(FAR_SCENE, MOON, 0.0, False), (FAR_SCENE, TWO, 0.0, False)]
    made = Learning(planned).learn(SOLVED, near, far, blocks=60)
    assert made.probability(NEAR_SCENE, TWO) > 0.8
    assert made.probability(FAR_SCENE, END) > 0.8


@KINDS
def test_a_guide_that_reaches_its_subgoals_is_imitated(planned):
    made = Learning(planned).learn(SOLVED, guide=1)
    assert made.probability(NEAR_SCENE, TWO) > 0.6
    assert made.probability(FAR_SCENE, END) > 0.6


@KINDS
def test_what_leads_nowhere_is_not_learned(planned):
    failed = [(NEAR_SCENE, MOON, 0.0, False)] * 3
    made = Learning(planned).learn(failed, guide=1)
    assert made.probability(NEAR_SCENE, MOON) < 0.45


@KINDS
def test_subgoals_that_the_task_lacks_are_passed_over(planned):
    made = Learning(planned)
    before = made.policy.clauses.probabilities()
    made.learn([(NEAR_SCENE, OTHER, 0.0, True), (FAR_SCENE, OTHER, 0.9, True)], guide=1)
    assert (made.policy.clauses.probabilities() == before).all()


@KINDS
def test_a_block_without_decisions_changes_nothing(planned):
    made = Learning(planned)
    before = made.policy.clauses.probabilities()
    made.learn(blocks=3)
    assert (made.policy.clauses.probabilities() == before).all()


def test_monte_carlo_imitates_guides_that_reached_alone():
    """A crisp guide's advantage is zero on average; only the return itself teaches its subgoal."""
    by_guide = Learning(planned=False).learn(*[SOLVED] * 4, guide=1)
    alone = Learning(planned=False).learn(*[SOLVED] * 4, guide=0)
    unreached = [(*decision[:3], False) for decision in SOLVED]
    missed = Learning(planned=False).learn(*[unreached] * 4, guide=1)
    assert by_guide.probability(NEAR_SCENE, TWO) > 0.8
    assert max(made.probability(NEAR_SCENE, TWO) for made in (alone, missed)) < 0.7


def test_planning_imitates_a_guide_only_where_it_knows_no_better_subgoal():
    """A guide's subgoal leads back to where it was, though the episode is solved in the end."""
    detour = [(NEAR_SCENE, MOON, 0.0, True), (NEAR_SCENE, MOON, 0.0, True), *SOLVED]
    made = Learning(planned=True)
    for _ in range(40):
        made.learn(SOLVED, guide=0, blocks=1)
        made.learn(*[detour] * 3, guide=1, blocks=1)
    assert made.probability(NEAR_SCENE, TWO) > 0.8
    assert made.probability(NEAR_SCENE, MOON) < 0.1


@pytest.mark.parametrize("margin, learned", [(0.0, False), (0.05, True)])
def test_planning_imitates_a_guide_whose_subgoal_is_nearly_the_best(margin, learned):
    """Another subgoal is worth a little more, though it is never reached: what it is paid lies on its way."""
    reached, on_the_way = (NEAR_SCENE, TWO, 0.5, True), (NEAR_SCENE, MOON, 0.51, False)
    made = Learning(planned=True, imitation_margin=margin)
    made.learn([reached], *[[reached]] * 8, [on_the_way], guide=1)
    assert (made.probability(NEAR_SCENE, TWO) > 0.8) == learned


def test_planning_learns_before_an_episode_ends():
    """Decisions that are paid count at once, though no episode has ended."""
    made = Learning(planned=True)
    made.learn([(NEAR_SCENE, TWO, 0.5, True), (FAR_SCENE, END, 0.5, True)], blocks=1)
    first = made.probability(NEAR_SCENE, TWO)
    made.update()
    assert made.probability(NEAR_SCENE, TWO) == first, "and only once"


def test_returns_are_discounted_by_decision():
    # 0.8; 0 + 0.5·0.8; 0.1 + 0.5·0.4
    assert discounted_returns([0.1, 0.0, 0.8], 0.5) == pytest.approx([0.3, 0.4, 0.8])
    assert discounted_returns([0.1, 0.0, 0.8], 1.0) == pytest.approx([0.9, 0.8, 0.8])


def test_monte_carlo_waits_for_the_end_of_an_episode_and_keeps_lanes_apart():
    """Two lanes in turn, with an update after every decision, learn what they learn one after the other."""
    worse = [(NEAR_SCENE, MOON, 0.0, False), (FAR_SCENE, TWO, 0.1, False)]
    in_turn, whole = (Learning(planned=False, batch=1) for _ in range(2))
    before = in_turn.policy.clauses.probabilities()
    going_on = [in_turn.telling(SOLVED), in_turn.telling(worse, lane=1)]
    for telling in going_on:
        next(telling)
        in_turn.update()
    assert (in_turn.policy.clauses.probabilities() == before).all()
    for telling, episode in zip(going_on, (SOLVED, worse), strict=True):
        next(telling)
        in_turn.update()
        whole.learn(episode, blocks=1)
        assert (in_turn.policy.clauses.probabilities() == whole.policy.clauses.probabilities()).all()
    assert (in_turn.policy.clauses.probabilities() != before).any()
