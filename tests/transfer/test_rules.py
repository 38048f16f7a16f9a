"""The rule that each decision is recorded with, in scenes made for each of them."""

import numpy as np
import pytest
import torch

from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.rollout import PROGRESS
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.buffers import TARGET
from paddlectl.logic.clauses import Scene, scenes_of
from paddlectl.logic.syntax import parse_program
from paddlectl.transfer import guides
from paddlectl.transfer.bandit import AloneOrGuided
from paddlectl.transfer.candidates import Source, candidates_of, inherited_program
from paddlectl.transfer.guidance import RULES, GuidanceSettings, PaperSettings
from paddlectl.transfer.similarity import map_scenes
from scripted import END, FAR_SCENE, NEAR_SCENE, RIGHT, TASK, TWO, ByScript, outcome

WALK = "1.0 :: gt_end() :- far()"
MATCHED = "0.8 :: gt_end() :- far()\n0.2 :: gt_two() :- far()"  # ψ 14/15 in the far scene; WALK's is 13/15
EVERY_SUBGOAL = "0.4 :: gt_end() :- far()\n0.3 :: gt_two() :- far()\n0.3 :: gt_moon() :- far()"
MERIT = GuidanceSettings(episodes="guided")
"""Λ alone decides."""
ALONE = GuidanceSettings(episodes="alone")


def planned(*programs, settings=MERIT):
    return made(lambda *given: guides.PlannedGuides(*given, settings), programs)


def paper(*programs, **readings):
    return made(lambda *given: guides.PaperGuides(*given, PaperSettings(**readings)), programs)


def made(kind, programs):
    """A selector of one lane over scripted sources, for a target whose clauses are all alike."""
    policy = HybridPolicy(TASK, 0, HybridSettings())
    with torch.no_grad():
        policy.clauses.weights.zero_()
    sources = [
        Source(f"policy-{number}", "Task", TASK.subgoals, parse_program(text), ByScript(RIGHT), "")
        for number, text in enumerate(programs, start=1)
    ]
    bodies = policy.clauses.bodies
    scenes = [Scene(body, frozenset(TASK.subgoals)) for body in bodies]
    mapping = map_scenes(scenes, {each.policy: scenes_of(each.program.clauses) for each in sources})
    candidates = candidates_of(TASK, bodies, sources, mapping, 1.0)
    selector = kind(policy, candidates, 1, np.random.default_rng(0))
    selector.refresh()
    return selector


def decide(selector, scene=FAR_SCENE):
    """The guide, and the rule that it's recorded with."""
    led, _ = selector.select(np.array([0]), np.array([scene * PROGRESS]))
    return int(led[0]), selector._present[0].rule


def tell(selector, reward=0.0, following=None, reached=False):
    """What came of that decision; the episode is over if nothing follows."""
    present = selector._present[0]
    selector.on_decision_end(outcome(present.scene_state, present.subgoal, reward, following, reached))


def play(selector, count, worth=(0.0, 0.0, 0.0)):
    """Episodes of one decision, in which guide g earns worth[g]."""
    told = []
    for _ in range(count):
        guide, rule = decide(selector)
        tell(selector, worth[guide], reached=worth[guide] > 0)
        told.append((guide, rule))
    return told


# largest


def test_the_best_matched_source_leads_by_its_weight():
    assert decide(planned(WALK, EVERY_SUBGOAL)) == (2, "largest")


def test_a_target_that_is_measured_leads_by_its_weight():
    """The source earns nothing, so the target is asked, and found to earn more."""
    assert play(planned(WALK), 200, (0.9, 0.0))[-1] == (TARGET, "largest")


def test_who_earned_something_leads_by_its_weight_in_paper():
    """Of one ψ, the target and the source tie at first."""
    assert play(paper(WALK, values="per_guide"), 2, (0.0, 0.4)) == [(1, "tie"), (1, "largest")]
    assert play(paper(WALK, values="per_guide"), 2) == [(1, "tie"), (TARGET, "largest")]


# tie


@pytest.mark.parametrize("kind", [planned, paper])
def test_sources_that_match_alike_tie_and_a_random_one_leads(kind):
    selector = kind(MATCHED, "0.6 :: gt_end() :- far()\n0.4 :: gt_two() :- far()")
    assert {decide(selector) for _ in range(40)} == {(1, "tie"), (2, "tie")}


def test_a_source_that_ties_with_the_target_goes_first():
    selector = paper(EVERY_SUBGOAL)
    assert {decide(selector) for _ in range(40)} == {(1, "tie")}
    weights = selector._present[0].weights
    assert weights[TARGET] == weights[1]


# penalty


def test_the_next_best_leads_as_the_best_was_in_vain_before():
    selector = planned(WALK, "1.0 :: gt_two() :- far()")
    play(selector, 30, (0.0, 0.9, 0.8))
    assert decide(selector) == (1, "largest")
    tell(selector, 0.0, following=FAR_SCENE)
    assert selector.weigh().weight[FAR_SCENE * PROGRESS].argmax() == 1
    assert decide(selector) == (2, "penalty")
    assert selector._present[0].weights.argmax() == 2


def test_the_next_episode_knows_no_penalty():
    selector = planned(WALK, "1.0 :: gt_two() :- far()")
    play(selector, 30, (0.0, 0.9, 0.8))
    decide(selector)
    tell(selector, 0.0, following=FAR_SCENE)
    decide(selector)
    tell(selector, 0.8, reached=True)
    assert decide(selector) == (1, "largest")


# floor


def test_a_target_leads_by_its_floor_where_no_source_earns_anything():
    found = play(planned(WALK), 200)
    assert found[0] == (1, "largest")
    assert set(found[12:]) == {(TARGET, "floor")}


def test_two_scenes_of_one_source_are_no_tie():
    """Both scenes have the target's only subgoals there, and lead to the same."""
    selector = paper("0.6 :: gt_end() :- !far(), lit()\n0.6 :: gt_end() :- !far(), !lit()")
    selector._returns.mean[NEAR_SCENE, [END, TWO]] = 0.5, 0.0
    weights = selector.weigh().weight[NEAR_SCENE * PROGRESS]
    assert weights[1] == weights[2] > weights[TARGET]
    assert decide(selector, NEAR_SCENE) == (1, "largest")


def test_there_is_no_floor_in_paper():
    assert {rule for _, rule in play(paper(WALK), 60)} <= {"largest", "tie"}


# alone


def test_a_target_alone_leads_the_whole_episode():
    selector = planned(WALK, settings=ALONE)
    assert decide(selector) == (TARGET, "alone")
    weights = selector._present[0].weights
    assert weights[1] > weights[TARGET]
    selector.rules = MERIT
    tell(selector, 0.1, following=FAR_SCENE, reached=True)
    assert decide(selector) == (TARGET, "alone"), "the same episode"
    tell(selector, 0.1, reached=True)
    assert decide(selector) == (1, "largest"), "the next one"


def test_a_target_that_would_lead_anyway_leads_by_that_rule():
    selector = planned(WALK)
    play(selector, 12)
    selector.rules = ALONE
    assert decide(selector) == (TARGET, "floor")


def test_guides_that_solve_nothing_make_room():
    """The floor isn't for this: the source is worth more than it, and still nothing is solved."""
    selector = planned(EVERY_SUBGOAL, settings=GuidanceSettings())
    assert "alone" not in play_unsolved(selector, 3)
    play_unsolved(selector, 200)
    assert np.mean([rule == "alone" for rule in play_unsolved(selector, 400)]) > 0.5


def play_unsolved(selector, count):
    """Episodes that the horizon ends, in which a guide earns 0.5."""
    told = []
    for _ in range(count):
        guide, rule = decide(selector)
        present, worth = selector._present[0], 0.5 * (guide != TARGET)
        selector.on_decision_end(
            outcome(present.scene_state, present.subgoal, worth, FAR_SCENE, True, truncated=True)
        )
        told.append(rule)
    return told


@pytest.mark.parametrize(("known", "least", "most"), [(1.0, 0.0, 0.02), (0.8, 0.3, 0.7), (0.4, 0.85, 1.0)])
def test_what_guides_know_decides_the_first_episodes(known, least, most):
    bandit, rng = AloneOrGuided(known, prior=10.0, memory=(300.0, 50.0)), np.random.default_rng(0)
    assert least <= np.mean([bandit.choose(rng) for _ in range(2000)]) <= most


def test_a_target_is_measured_however_well_it_is_guided():
    bandit, rng = AloneOrGuided(1.0, 10.0, (300.0, 50.0), least=0.05), np.random.default_rng(0)
    for _ in range(300):
        bandit.record(alone=False, solved=True)
    assert np.mean([bandit.choose(rng) for _ in range(4000)]) == pytest.approx(0.05, abs=0.015)


@pytest.mark.parametrize("better", [False, True])
def test_the_way_that_solves_more_leads(better):
    """Of 400 episodes, one way solving 0.9 and the other 0.3, whatever was believed."""
    bandit, rng = AloneOrGuided(0.8, prior=10.0, memory=(300.0, 50.0)), np.random.default_rng(0)
    for _ in range(400):
        alone = bandit.choose(rng)
        bandit.record(alone, rng.random() < (0.9 if alone == better else 0.3))
    assert np.mean([bandit.choose(rng) == better for _ in range(500)]) > 0.95


def test_the_counts_by_hand():
    bandit = AloneOrGuided(0.5, prior=4.0, memory=(2.0, 4.0))
    assert bandit._prior.tolist() == [[0.5, 2.0], [3.5, 2.0]]  # solved and not, guided and alone
    for alone, solved in ((False, True), (False, False), (True, False), (True, False)):
        bandit.record(alone, solved)
    assert bandit._seen.tolist() == [[0.5, 0.0], [1.0, 1.75]]


# What the target starts with


def test_a_program_is_inherited_by_how_well_it_matches():
    """In the far scene ψ is 14/15: 0.5 · 14/15 of the source's 0.8 and 0.2, and a third each of the rest."""
    candidates = planned(MATCHED).candidates
    psi = 14 / 15
    rest = (1 - 0.5 * psi) / 3
    program = inherited_program(TASK, candidates, 0.5)
    by_subgoal = dict(zip(map(str, TASK.subgoals), program[FAR_SCENE], strict=True))
    assert by_subgoal["gt_end()"] == pytest.approx(0.8 * 0.5 * psi + rest)
    assert by_subgoal["gt_two()"] == pytest.approx(0.2 * 0.5 * psi + rest)
    assert by_subgoal["gt_moon()"] == pytest.approx(rest)
    assert program.sum(-1) == pytest.approx(1.0)


def test_without_a_share_or_a_source_nothing_is_inherited():
    for candidates, share in ((planned(MATCHED).candidates, 0.0), (planned().candidates, 0.7)):
        assert inherited_program(TASK, candidates, share) == pytest.approx(1 / len(TASK.subgoals))


# What is kept


def test_traces_and_counts_keep_the_rules():
    selector = planned(WALK, settings=ALONE)
    decide(selector)
    tell(selector, 0.1, reached=True)
    selector.rules = MERIT
    decide(selector)
    tell(selector, 0.1, reached=True)
    assert [decision.rule for trace in selector.traces for decision in trace] == ["alone", "largest"]
    counted = selector.chosen[FAR_SCENE * PROGRESS]
    assert counted[TARGET, RULES.index("alone")] == counted[1, RULES.index("largest")] == 1
    assert selector.chosen.sum() == selector.decisions.sum() == 2


@pytest.mark.parametrize("kind", [planned, paper])
def test_to_weigh_changes_nothing(kind):
    selector = kind(MATCHED, WALK)
    for _ in range(30):
        for scene, following in ((NEAR_SCENE, FAR_SCENE), (FAR_SCENE, None)):
            decide(selector, scene)
            tell(selector, 0.4, following, reached=selector._present[0].subgoal in (TWO, END))
        first, second, third = (selector.weigh() for _ in range(3))
        for table, again, oncemore in zip(first, second, third, strict=True):
            assert np.array_equal(table, again)
            assert np.array_equal(table, oncemore)
