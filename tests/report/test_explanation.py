"""The stored fields that `explain` leans on: old runs lack some, damaged ones are refused."""

import pytest

from paddlectl.errors import IntegrityError
from paddlectl.registry.store import Registry
from paddlectl.report.explained import explanation_parts
from paddlectl.report.explanation import explanation_document
from paddlectl.report.output import print_text
from samples import (
    BLOCKED_DOOR,
    GAP_BALL,
    add_source,
    add_transfer,
    decision,
    program,
    recording,
    reseal,
    weight_rows,
)


@pytest.fixture
def registry(tmp_path):
    """Two sources and a transfer, which `explained` adds another to."""
    made = Registry.open(tmp_path / "registry")
    for task, clauses in (("BlockedDoor", BLOCKED_DOOR), ("GapBall", GAP_BALL)):
        add_source(made, task, program(task, clauses))
    add_transfer(made)
    return made


def explained(registry, weights=None, trace=None):
    """Explains a second transfer that left these."""
    run = registry.add_run(
        kind="transfer", method="paddle", task="BlockedBoxUnlockPickup", scenario="A",
        sources=["policy-1", "policy-2"], seed=0, settings={}, versions={},
    )  # fmt: skip
    registry.files.append_rows(run.id, "weights", weight_rows() if weights is None else weights)
    registry.files.write_document(run.id, "trace", {"early": [trace or decision()], "late": []})
    document = explanation_document(registry, registry.run(run.id))
    print_text(explanation_parts(document, registry.run(run.id)))
    return document


def without(row, *fields):
    return {name: value for name, value in row.items() if name not in fields}


def test_new_and_old_runs_are_explained(registry):
    explained(registry)
    old = [without(row, "rules", "dropped") for row in weight_rows()]
    explained(registry, old, without(decision(), "rule"))
    explained(registry, old, without(decision(), "rule") | {"audition": True})


def test_an_unknown_rule_is_told_by_its_name(registry, capsys):
    rows = [row | {"rules": {"of tomorrow": row["chosen"]}} for row in weight_rows()]
    explained(registry, rows, decision() | {"rule": "of tomorrow"})
    told = " ".join(capsys.readouterr().out.split())
    assert "Why: by the rule of tomorrow." in told
    assert "of these 100 % by the rule of tomorrow" in told


@pytest.mark.parametrize(
    "damage",
    [
        {"rules": None},
        {"rules": ["tie"]},
        {"rules": "tie"},
        {"rules": {"tie": "1"}},
        {"rules": {"tie": None}},
        {"rules": {"tie": True}},
        {"rules": {"tie": 0.5}},
        {"dropped": None},
        {"dropped": 1},
        {"dropped": "yes"},
        {"rules": {"tie": 10**400}},
        {"rules": {"tie": -1}},
        {"chosen": 10**400},
        {"decisions": -1},
        {"weight": 10**400},
    ],
)
def test_damaged_rows_of_weights_are_refused(registry, damage):
    rows = weight_rows()
    with pytest.raises(IntegrityError, match=r"weights\.jsonl"):
        explained(registry, [*rows[:-1], rows[-1] | damage])


@pytest.mark.parametrize("damage", [{"rule": None}, {"rule": 3}, {"rule": ["tie"]}, {"rule": {}}])
def test_damaged_decisions_are_refused(registry, damage):
    with pytest.raises(IntegrityError, match=r"trace\.json"):
        explained(registry, trace=decision() | damage)


def test_recordings_are_told_and_an_older_run_has_none(registry):
    assert explained(registry)["recordings"] == []
    told = {"late": recording(), "early": recording()}
    registry.files.write_document("run-4", "recordings", told)
    found = explanation_document(registry, registry.run("run-4"))
    assert found["recordings"] == [{"phase": "early"} | recording(), {"phase": "late"} | recording()]
    assert "recordings" not in found["documents"]


@pytest.mark.parametrize(
    "damage",
    [
        {"score": "0"},
        {"length": 319},
        {"length": -1},
        {"action_repeat": 0.5},
        {"action_repeat": 0},
        {"action_repeat": 2},
        {"length": 0, "actions": []},
        {"start": [1]},
        {"actions": "up"},
        {"actions": ["up"] * 320},
        {"actions": [[None]] * 320},
        {"actions": [0] * 319},
        {"subgoals": [["gt_key()", 3]]},
        {"subgoals": [{"subgoal": "gt_key()", "actions": -1}]},
        {"subgoals": [{"subgoal": "gt_key()", "actions": 10**15}]},
    ],
    ids=str,
)
def test_damaged_recordings_are_refused(registry, damage):
    registry.files.write_document("run-3", "recordings", {"early": recording() | damage})
    reseal(registry, "run-3")
    with pytest.raises(IntegrityError, match=r"recordings\.json"):
        explanation_document(registry, registry.run("run-3"))
    assert explanation_document(registry, registry.run("run-3"), recorded=False)["trace"]


def test_what_the_horizon_cut_off_is_neither_reached_nor_missed(registry, capsys):
    rows = [row | {"cut": row["chosen"] - row["reached"]} for row in weight_rows()]
    explained(registry, rows, decision() | {"reached": False, "cut": True})
    told = " ".join(capsys.readouterr().out.split())
    assert "was reached in 100 %" in told
    assert "steps, cut off by the horizon" in told
