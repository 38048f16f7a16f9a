"""`explain` in forty lines: the sentences worked by hand, and that there are never more."""

from types import SimpleNamespace
from typing import Any

import pytest

from paddlectl.report.output import height
from paddlectl.report.summary import MOST_LINES, floor_text, phases, short_text, summary_parts, verdict
from samples import TARGET, body

A, B, C = (tuple(body(TARGET, true)) for true in ("X", "E", "KO"))


def labels(policy: str) -> str:
    return {"policy-1": "Door", "policy-2": "Gap"}.get(policy, policy)


def weight(
    phase: str, scene: tuple[str, ...], policy: str, chosen: int, of: int, frames: int
) -> dict[str, Any]:
    return {
        "phase": phase, "scene": list(scene), "policy": policy, "similarity": 0.5, "performance": 0.4,
        "weight": 0.45, "decisions": of, "chosen": chosen, "reached": chosen, "rules": {}, "frames": frames,
    }  # fmt: skip


def moment(frames: int, policy: str, chosen: int) -> dict[str, Any]:
    return {
        "frames": frames, "scene": 0, "policy": policy, "similarity": 0.5, "performance": 0.4,
        "weight": 0.45, "chosen": chosen,
    }  # fmt: skip


def followed(frames: int, scene: tuple[str, ...], source: str, chosen: int) -> dict[str, Any]:
    return {
        "frames": frames, "context": list(scene), "source": source, "terms": {"Q": 0.1}, "weight": 0.1,
        "chosen": chosen, "reached": None,
    }  # fmt: skip


def clause(head: str, scene: tuple[str, ...]) -> dict[str, Any]:
    return {"head": head, "body": list(scene), "probability": 0.9}


def document(**more: Any) -> dict[str, Any]:
    programs = [
        {"policy": "policy-1", "task": "Door", "clauses": [clause("gt_blockage()", A)], "minimised": []},
        {"policy": "policy-2", "task": "Gap", "clauses": [clause("gt_key()", B)], "minimised": []},
    ]
    usual: dict[str, Any] = {
        "program": None, "sources": ["policy-1", "policy-2"], "source_programs": programs, "mapping": None,
        "weights": [], "moments": [], "reuse": [], "documents": {}, "trace": [],
        "final_episodes": None,
        "trace_scores": {"early": None, "late": None},
    }  # fmt: skip
    return usual | more


def told(**more: Any) -> str:
    return " ".join(" ".join(map(str, verdict(document(**more), labels))).split())  # type: ignore[arg-type]


EARLY = [
    weight("early", A, "policy-1", 60, 60, 3000),
    weight("early", B, "policy-2", 25, 40, 3000),
    weight("early", B, "target", 15, 40, 3000),
]


def test_who_led_at_first_and_for_what_and_when_the_target_took_over() -> None:
    late = [
        weight("late", A, "target", 90, 100, 9000),
        weight("late", A, "policy-1", 10, 100, 9000),
        weight("late", B, "policy-2", 50, 50, 9000),
        weight("late", C, "policy-1", 1, 1, 9000),  # too rare to count
    ]
    moments = [moment(1000, "policy-1", 9), moment(1000, "target", 9), moment(2000, "target", 5)]
    moments += [moment(9000, "target", 3), moment(9000, "policy-2", 2)]
    assert told(weights=EARLY + late, moments=moments) == (
        "Until frame 3,000 the decisions were led 60 % by Door (for gt_blockage()), 25 % by Gap"
        " (for gt_key()) and 15 % by the target itself. From frame 1,000 on the target led most of them;"
        " in the end the target leads in 1 of the 2 scenes that come up most, Gap in {has_key(env)}."
    )


def test_a_target_that_led_most_from_the_start_or_never() -> None:
    late = [weight("late", A, "target", 9, 9, 9000)]
    start = told(weights=EARLY + late, moments=[moment(1000, "target", 2), moment(1000, "policy-1", 1)])
    assert "The target led most of them from the start; in the end the target leads in the one scene" in start
    never = told(weights=EARLY, moments=[moment(1000, "target", 9), moment(2000, "policy-1", 1)])
    assert never.endswith("The target never led most of them for good.")


def test_a_run_that_ended_early_is_told_as_a_whole() -> None:
    moments = [moment(1000, "policy-1", 9), moment(2000, "target", 9)]
    assert told(weights=EARLY, moments=moments).startswith("In all, the decisions were led 60 % by")


def test_who_was_dropped_has_no_weight() -> None:
    rows = [row | {"dropped": row["policy"] == "policy-1", "weight": -1.0} for row in EARLY]
    early, _ = phases(document(weights=rows))
    assert early is not None and (A, "policy-1") in early.dropped and (B, "policy-2") not in early.dropped


def test_a_run_of_before_moments_were_recorded_tells_no_moment() -> None:
    assert told(weights=EARLY).endswith("and 15 % by the target itself.")


def test_of_a_method_that_follows_the_first_and_the_last_period_are_told() -> None:
    rows = [followed(1000, A, "policy-1", 3), followed(1000, A, "target", 1), followed(2000, A, "target", 5)]
    assert told(reuse=rows) == (
        "Until frame 1,000 it followed Door in 75 % of its choices and itself in 25 %. From frame 1,000 on it"
        " mostly followed itself; in the end it follows itself most often in the one scene that comes up"
        " most."
    )
    assert told(reuse=[followed(1000, A, "target", 0)]) == "" == told()


@pytest.mark.parametrize("scenes", [1, 20, 64])
@pytest.mark.parametrize("values", [0, 200])
def test_it_is_never_longer_than_forty_lines(
    scenes: int, values: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = [f"holds_a_long_fact_{n}(thing)" for n in range(6)]
    bodies = [
        tuple(f"{'' if n >> k & 1 else '!'}{fact}" for k, fact in enumerate(facts)) for n in range(scenes)
    ]
    rows = [
        weight(phase, scene, policy, 2, 4, 3000)
        for phase in ("early", "late") for scene in bodies for policy in ("policy-1", "target")
    ]  # fmt: skip
    clauses = [clause("gt_key()", scene) for scene in bodies]
    shortest = [f"gt_key() :- {', '.join(scene)}" for scene in bodies]
    program = {"policy": "policy-3", "task": TARGET, "clauses": clauses, "minimised": shortest}
    own = {f"a document {n}": {f"value {k}": k for k in range(30)} for n in range(values // 30)}
    run = SimpleNamespace(
        id="run-1", method="paddle", task=TARGET, seed=0, frames=9, status="finished", results={},
        settings={}, policy="policy-3", sources=("policy-1", "policy-2"),
    )  # fmt: skip
    for width in ("60", "100", "200"):
        monkeypatch.setenv("COLUMNS", width)
        parts = summary_parts(document(weights=rows, program=program, documents=own), run)  # type: ignore[arg-type]
        assert height(parts) <= MOST_LINES


def test_a_short_run_and_the_floor_of_the_target_are_told() -> None:
    rules = {"target_floor": 0.05, "target_samples": 20.0}
    run = SimpleNamespace(settings={"rules": rules})
    assert floor_text(run) == " Until the target has led there 20 times, its Λ is 0.05; it is never less."  # type: ignore[arg-type]
    run = SimpleNamespace(settings={"rules": {"target_floor": 0.05, "target_margin": 0.02}})
    assert floor_text(run) == " The target's Λ is its Φ + 0.02, and 0.07 at least."  # type: ignore[arg-type]
    assert floor_text(SimpleNamespace(settings={})) == ""  # type: ignore[arg-type]
    assert short_text(32) == "A short run: its figures of training are over 32 episodes instead of 100."
    assert short_text(1) == "A short run: its figures of training are over 1 episode instead of 100."
    assert short_text(100) == short_text(None) == ""
