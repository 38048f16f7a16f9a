"""A transfer of a few dozen episodes, and all that it leaves behind."""

import dataclasses
import os
import shutil
import subprocess
import sys
from typing import Any, NamedTuple

import pytest

from paddlectl.agents import recording
from paddlectl.experiments.runner import run_transfer
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from paddlectl.transfer.guidance import RULES, GuidanceSettings
from samples import ROOT
from schemas import require_row
from small_transfer import FRAMES, SHORT, SMALL, TARGET, job

MODES = ("default", "paper")


class Done(NamedTuple):
    row: dict[str, Any]
    run: RunRecord
    registry: Registry

    def rows(self, name: str) -> list[dict[str, Any]]:
        return self.registry.files.read_rows(self.run.id, name)


class Transfers:
    """Runs each transfer once, however many tests look at it."""

    def __init__(self, registry: Registry, policies: tuple[str, ...]) -> None:
        self.registry = registry
        self.policies = policies
        self._done: dict[tuple[Any, ...], Done] = {}

    def __call__(self, mode: str = "default", method: str = "paddle", seed: int = 0) -> Done:
        asked = (mode, method, seed)
        if asked not in self._done:
            row = run_transfer(job(self.policies, mode, method, seed), self.registry, lambda _: None)
            self._done[asked] = Done(row, self.registry.run(row["run"]), self.registry)
        return self._done[asked]


@pytest.fixture(scope="module")
def transfer(sources, tmp_path_factory):
    location = tmp_path_factory.mktemp("transfers") / "registry"
    shutil.copytree(sources, location)
    policies = ("policy-2", "policy-1")
    with pytest.MonkeyPatch.context() as patch:
        for module, name, value in SHORT:
            patch.setattr(module, name, value)
        yield Transfers(Registry.open(location), policies)


def names(body):
    return sorted(literal.removeprefix("!") for literal in body)


VOCABULARY = sorted(str(atom) for atom in load(TARGET).vocabulary.atoms)


@pytest.mark.parametrize("mode", MODES)
def test_the_row_and_the_run_say_the_same(transfer, mode):
    done = transfer(mode)
    figures = {"jump_start", "final_score", "final_success", "area_under_curve", "success_rate"}
    told = {"run", "policy", "method", "sources", "seed", "frames", "episodes", "seconds"}
    assert set(done.row) == told | figures
    require_row(done.row, "transfer")
    assert done.row["sources"] == list(transfer.policies)
    run = done.run
    assert (run.kind, run.method, run.task, run.scenario, run.status) == (
        "transfer", "paddle", TARGET, "A", "finished",
    )  # fmt: skip
    assert run.sources == transfer.policies
    assert (run.frames, run.episodes, run.policy) == (
        done.row["frames"], done.row["episodes"], done.row["policy"],
    )  # fmt: skip
    assert done.row["success_rate"] == done.registry.policy(run.policy).success_rate
    assert {name: run.results[name] for name in figures} == {name: done.row[name] for name in figures}
    assert run.settings["scenario"]["guidance"]["mode"] == mode
    assert FRAMES <= done.row["frames"] < FRAMES + 8 * 64
    assert done.row["episodes"] >= 8 * 2


@pytest.mark.parametrize("mode", MODES)
def test_episodes(transfer, mode):
    done = transfer(mode)
    rows = done.rows("episodes")
    assert len(rows) == done.row["episodes"]
    assert len({row["order"] for row in rows}) == len(rows)
    for row in rows:
        assert set(row) == {"order", "started", "frames", "score", "length", "success"}
        assert row["success"] == (row["score"] > 0)
        assert row["frames"] - row["started"] == row["length"] * 8
        assert 1 <= row["length"] <= 320


@pytest.mark.parametrize("mode", MODES)
def test_the_mapping_is_that_of_the_target_and_its_sources(transfer, mode):
    done = transfer(mode)
    mapping = done.registry.files.read_document(done.run.id, "mapping")
    assert (mapping["target"], mapping["body_weight"], mapping["head_weight"]) == (TARGET, 0.8, 0.2)
    assert mapping["sources"] == list(transfer.policies)
    assert len(mapping["scenes"]) == 28
    for scene in mapping["scenes"]:
        assert set(scene) == {"body", "heads", "self_similarity", "matches"}
        assert names(scene["body"]) == VOCABULARY
        assert [match["policy"] for match in scene["matches"]] == list(transfer.policies)
        assert scene["self_similarity"] == max(match["similarity"] for match in scene["matches"])


@pytest.mark.parametrize("mode", MODES)
def test_weights_by_scene_and_policy(transfer, mode):
    done = transfer(mode)
    rows = done.rows("weights")
    assert {row["phase"] for row in rows} == {"early", "late"}
    keys = [(row["phase"], tuple(row["scene"]), row["policy"]) for row in rows]
    assert len(set(keys)) == len(keys)
    assert {row["policy"] for row in rows} == {"target", *transfer.policies}
    tasks = {"target": TARGET, **dict(zip(transfer.policies, ("BlockedDoor", "GapBall"), strict=True))}
    for row in rows:
        assert set(row) == {
            "phase", "frames", "scene", "policy", "task", "similarity", "performance", "weight",
            "decisions", "chosen", "reached", "cut", "rules",
        }  # fmt: skip
        assert sum(row["rules"].values()) == row["chosen"]
        assert set(row["rules"]) <= set(RULES)
        assert names(row["scene"]) == VOCABULARY
        assert row["task"] == tasks[row["policy"]]
        assert 0 <= row["reached"] <= row["chosen"] <= row["decisions"] > 0
    for phase, scene in {(row["phase"], tuple(row["scene"])) for row in rows}:
        here = [row for row in rows if (row["phase"], tuple(row["scene"])) == (phase, scene)]
        assert sum(row["chosen"] for row in here) == here[0]["decisions"]


@pytest.mark.parametrize("mode", MODES)
def test_paper_weights_are_the_sum_of_the_similarities(transfer, mode):
    sums = [row["weight"] == row["similarity"] + row["performance"] for row in transfer(mode).rows("weights")]
    assert all(sums) == (mode == "paper")


@pytest.mark.parametrize("mode", MODES)
def test_the_trace_of_an_early_and_a_late_episode(transfer, mode):
    done = transfer(mode)
    trace = done.registry.files.read_document(done.run.id, "trace")
    assert set(trace) == {"early", "late", "score_early", "score_late"}
    lengths = {(row["score"], row["length"]) for row in done.rows("episodes")}
    for phase in ("early", "late"):
        steps = sum(decision["steps"] for decision in trace[phase])
        assert (trace[f"score_{phase}"], steps) in lengths
        assert [decision["step"] for decision in trace[phase]] == list(range(1, len(trace[phase]) + 1))
        for decision in trace[phase]:
            assert set(decision) >= {
                "step", "scene", "clause", "guide", "weights", "head", "steps", "reached", "cut", "rule",
            }  # fmt: skip
            assert decision["rule"] in RULES
            assert decision["guide"] in {weight["policy"] for weight in decision["weights"]}
            assert decision["clause"] == f"{decision['head']} :- {', '.join(decision['scene'])}"
            assert 1 <= decision["steps"] <= 50
            for weight in decision["weights"]:
                assert set(weight) == {"policy", "similarity", "performance", "weight"}


def test_from_scratch_there_is_nothing_to_explain_but_the_episodes(transfer):
    done = transfer(method="hdm")
    assert (done.run.method, done.run.sources, done.run.status) == ("hdm", (), "finished")
    assert len(done.rows("episodes")) == done.row["episodes"] >= 8 * 2
    assert done.registry.files.read_document(done.run.id, "mapping") is None
    assert done.registry.files.read_document(done.run.id, "trace") is None
    assert done.rows("weights") == []


def checkpoint(done):
    return done.registry.policy(done.row["policy"]).checkpoint


def test_equal_seeds_give_equal_policies_in_another_process(transfer):
    line = [sys.executable, str(ROOT / "tests" / "small_transfer.py"), transfer.registry.location]
    line += ["default", "0", *transfer.policies]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "PYTHONHASHSEED": "12"}
    other = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert other.stdout.strip() == checkpoint(transfer("default"))


@pytest.mark.parametrize(
    "changes",
    [
        {"rules": GuidanceSettings(target_floor=0.0, episodes="guided")},
        {"changes": SMALL | {"credit": {"planned": False}, "sharpness": 2.0}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_caller_may_change_the_rules_and_the_settings(transfer, changes):
    changed = dataclasses.replace(job(transfer.policies, "default"), **changes)
    row = run_transfer(changed, transfer.registry, lambda _: None)
    told, usual = transfer.registry.run(row["run"]).settings, transfer().run.settings
    assert told["rules"] == dataclasses.asdict(changed.rules or GuidanceSettings())
    if "changes" in changes:
        assert told["learning"]["credit"] == usual["learning"]["credit"] | {"planned": False}
        assert told["learning"] == usual["learning"] | {
            "sharpness": 2.0,
            "credit": told["learning"]["credit"],
        }
    else:
        assert told["learning"] == usual["learning"]
    assert transfer.registry.policy(row["policy"]).checkpoint != checkpoint(transfer())


def test_other_seeds_and_other_rules_give_other_policies(transfer):
    runs = [transfer("default"), transfer("paper"), transfer(method="hdm"), transfer("default", seed=1)]
    assert len({checkpoint(done) for done in runs}) == 4


def test_weights_are_told_once_when_the_early_episodes_are_over_in_the_last_round(transfer, monkeypatch):
    """Eight lanes that time out together, after 320 steps, in the fifth round of 64."""
    monkeypatch.setattr(recording, "EARLY", 8)
    short = job(transfer.policies, "paper", frames=8 * 320)
    row = run_transfer(short, transfer.registry, lambda _: None)
    rows = transfer.registry.files.read_rows(row["run"], "weights")
    keys = [(row["phase"], tuple(row["scene"]), row["policy"]) for row in rows]
    assert len(set(keys)) == len(keys) > 0
