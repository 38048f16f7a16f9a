"""The sentences of `explain`: who led, by which rules, how things stood then, and who was dropped."""

from types import SimpleNamespace

import pytest
from rich.console import Console

from paddlectl.report.explained import WHY, WHY_OFTEN, SceneMet, Standing, explanation_parts, sentences
from paddlectl.transfer.guidance import RULES

BODY = ("has_key(env)",)
OTHER = Standing("other", 0.6, 0.5, 0.5, 10, 1, {"tie": 10})


def leader(rules=None, policy="good", weight=0.8):
    return Standing(policy, 0.7, 0.8, weight, 90, 81, rules)


def sentence(*standings):
    met = SceneMet(BODY, {"early": 100}, {"early": standings})
    return sentences(met, lambda policy: policy.upper(), lambda policy, body: "gt_key()")[0]


def test_all_that_is_told_of_a_phase():
    assert sentence(leader({"tie": 18, "largest": 72}), OTHER) == (
        "Early: GOOD led 90 % of 100 decisions; of these 80 % as its Λ was the largest, 20 % by a tie."
        " Its subgoal (likeliest: gt_key()) was reached in 90 %."
        " At the end of the phase its Λ was 0.80 (ψ 0.70, Φ 0.80), OTHER's 0.50."
    )


def test_the_words_know_every_rule():
    assert tuple(WHY) == tuple(WHY_OFTEN) == (*RULES, "trial", "novel")


@pytest.mark.parametrize(
    "rule, words",
    [
        ("largest", "as its Λ was the largest"),
        ("tie", "by a tie"),
        ("penalty", "as larger Λs were lowered in that episode"),
        ("floor", "as no source's Λ was above the target's floor"),
        ("alone", "as it led the episode alone"),
        ("trial", "as a forced target trial"),
        ("novel", "as novel-subgoal exploration"),
        ("of\x1b tomorrow", "by the rule of\N{REPLACEMENT CHARACTER} tomorrow"),
    ],
)
def test_the_words_of_each_rule(rule, words):
    told = sentence(leader({rule: 90}), OTHER)
    assert told.startswith(f"Early: GOOD led 90 % of 100 decisions; of these 100 % {words}. Its subgoal")
    assert [other for other in WHY_OFTEN.values() if other in told and other != words] == []


def test_rare_rules_are_left_out():
    many = Standing("good", 0.7, 0.8, 0.8, 1000, 900, {"largest": 981, "tie": 10, "trial": 9})
    met = SceneMet(BODY, {"late": 1000}, {"late": (many,)})
    told = sentences(met, str, lambda policy, body: "")[0]
    assert "of these 98 % as its Λ was the largest, 1 % by a tie. Its subgoal was" in told


def test_no_cause_is_told_where_none_was_recorded():
    """Not even that of the largest Λ, though the leader's is the largest at the end."""
    told = sentence(leader(), OTHER)
    assert told.startswith("Early: GOOD led 90 % of 100 decisions. Its subgoal")
    assert [words for words in WHY_OFTEN.values() if words in told] == []


def test_a_leader_that_was_passed_is_told_by_the_state_alone():
    told = sentence(leader({"largest": 90}, weight=0.4), OTHER)
    assert told.endswith("At the end of the phase its Λ was 0.40 (ψ 0.70, Φ 0.80), OTHER's 0.50.")


def test_the_rival_is_the_best_of_the_others():
    third = Standing("third", 0.6, 0.5, 0.6, 0, 0)
    assert "THIRD's 0.60." in sentence(leader(), OTHER, third)
    assert sentence(leader()).endswith("its Λ was 0.80 (ψ 0.70, Φ 0.80).")


def test_the_targets_subgoal_is_that_of_its_final_program():
    told = sentence(leader({"floor": 90}, policy="target"), OTHER)
    assert told.startswith("Early: the target itself led 90 %")
    assert "Its subgoal (likeliest in its final program: gt_key()) was reached in 90 %." in told


def test_a_source_is_dropped_by_the_record_and_not_by_its_weight():
    low = Standing("wrong", 0.9, 0.3, -0.6, 10, 0)
    assert "Dropped" not in sentence(leader(), low)
    dropped = Standing("wrong", 0.9, 0.3, 0.1, 10, 0, {}, True)
    assert sentence(leader(), dropped).endswith(
        "Dropped here by then, as its subgoal was reached too seldom: WRONG."
    )


# The whole text


def weight(policy, chosen, **more):
    return {
        "phase": "early", "scene": list(BODY), "policy": policy, "similarity": 0.5, "performance": 0.4,
        "weight": 0.45, "decisions": 10, "chosen": chosen, "reached": 1, **more,
    }  # fmt: skip


def decision(**more):
    weights = [
        {"policy": policy, "similarity": 0.5, "performance": 0.4, "weight": 0.45}
        for policy in ("target", "policy-1", "policy-2")
    ]
    return {
        "phase": "early", "step": 1, "scene": list(BODY), "clause": "gt_key() :- has_key(env)",
        "guide": "policy-1", "weights": weights, "head": "gt_key()", "steps": 3, "reached": True, **more,
    }  # fmt: skip


def text(weights=(), trace=(), **more):
    document = {
        "program": None, "sources": [], "source_programs": [], "mapping": None, "weights": list(weights),
        "reuse": [], "moments": [], "documents": {},
        "trace": list(trace), "final_episodes": None, "trace_scores": {"early": 0.9, "late": None},
    }  # fmt: skip
    told = {"method": "paddle", "status": "finished", "results": {}, "policy": None, **more}
    run = SimpleNamespace(id="run-1", task="T", seed=0, frames=9, sources=(), settings={}, **told)
    console = Console(width=100, markup=False)
    with console.capture() as caught:
        for part in explanation_parts(document, run):
            console.print(part)
    return " ".join(caught.get().split())


@pytest.mark.parametrize(
    "rule, words",
    [
        ("largest", "its Λ is the largest"),
        ("tie", "others had as large a Λ: a source goes before the target, and between sources one is drawn"),
        ("penalty", "larger Λs were lowered for what those guides did before in this episode"),
        ("floor", "no source's Λ is above the target's floor"),
        ("alone", "the target leads this episode alone"),
        ("trial", "forced target trial, to measure it here"),
        ("novel", "novel-subgoal exploration: no source knows this subgoal"),
        ("new", "by the rule new"),
    ],
)
def test_each_decision_tells_its_rule(rule, words):
    told = text(trace=[decision(rule=rule)])
    assert f"policy-1 → gt_key(), 3 steps, reached Why: {words}. target" in told
    assert [other for other in WHY.values() if other in told and other != words] == []
    assert told.count("*") == 1
    assert "policy-1 ψ 0.50 Φ 0.40 Λ 0.45 *" in told


@pytest.mark.parametrize("more", [{}, {"audition": True}, {"audition": False}])
def test_a_decision_of_an_older_run_tells_no_cause(more):
    told = text(trace=[decision(**more)])
    assert "policy-1 → gt_key(), 3 steps, reached target ψ" in told
    assert "Why" not in told
    assert "measure" not in told


def test_counts_of_rules_come_from_the_rows():
    rows = [
        weight("policy-1", 8, rules={"tie": 6, "penalty": 2}, dropped=False),
        weight("target", 2, rules={"trial": 2}, dropped=False),
        weight("policy-2", 0, rules={}, dropped=True),
    ]
    told = text(rows)
    assert "policy-1 led 80 % of 10 decisions; of these 75 % by a tie, 25 % as larger Λs were" in told
    assert "too seldom: policy-2." in told
    assert "older version" not in told


def test_an_older_run_is_told_to_have_recorded_no_causes():
    told = text([weight("policy-1", 8), weight("target", 2)])
    assert "older version, which did not record why a guide was chosen" in told
    assert "policy-1 led 80 % of 10 decisions. Its subgoal was reached in 12 %." in told
    assert "Dropped" not in told


def test_a_run_from_scratch_says_why_nobody_led_and_what_tells_more():
    told = text(method="hdm", policy="policy-7", results={"mean_length": 30.0, "final_score": 0.8})
    assert "final score 0.80, unseen length 30.0" in told
    assert "hdm learns from scratch: there were no guides to choose from, and no episode was kept." in told
    assert told.endswith("paddlectl evaluate policy-7")
    stopped = text(method="hdm", status="interrupted")
    assert "No policy was stored: the run is interrupted. run: paddlectl resume run-1" in stopped
    assert "evaluate" not in stopped


def test_an_episode_of_a_run_from_scratch_would_be_told():
    told = text(trace=[decision()], method="hdm")
    assert "policy-1 → gt_key(), 3 steps, reached" in told and "no guides" not in told
