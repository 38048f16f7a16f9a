"""An evaluation is a function of (policy, task, seed, episodes): not of who asks, or when, or of defaults."""

import dataclasses
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from paddlectl.agents.evaluation import Evaluation
from paddlectl.agents.interaction import Interaction
from paddlectl.errors import IntegrityError
from paddlectl.experiments import policies
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.policies import EVALUATION_SEED, evaluate, revive
from paddlectl.experiments.resuming import job_of
from paddlectl.experiments.runner import train_source
from paddlectl.hybrid.agent import HybridAgent
from paddlectl.hybrid.credit import CreditSettings
from paddlectl.hybrid.policy import HybridPolicy, ProgramSelector
from paddlectl.hybrid.rollout import DecisionSettings, Rollout
from paddlectl.hybrid.settings import LOW_LEVELS, HybridSettings, settings_for, settings_from
from paddlectl.learners.ppo import PPOSettings
from paddlectl.logic.syntax import format_program
from paddlectl.registry.bundles import bundles
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.base import Environment
from paddlectl.tasks.stock.families import FAMILIES
from paddlectl.tasks.suite import load, names
from trials.runs import short_episodes

FRAMES = 2048  # a block of MiniGrid
FEW = {"num_envs": 8}
ELSEWHERE = """
import json, sys
import torch
from paddlectl.experiments.policies import evaluate
from paddlectl.registry.store import Registry
assert torch.get_num_threads() == 2
registry, episodes, seed = Registry.open(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
policies = [registry.policy(name) for name in sys.argv[4:]]
print(json.dumps([evaluate(registry, policy, policy.task, episodes, seed) for policy in policies]))
"""
EPISODES = 16
FIGURES = ("success_rate", "mean_score", "mean_length")
SOFT = {"sharpness": 1.0, "low_level": {"sharpness": 1.0}, "decisions": {"max_steps": 30}}
SOURCE = Path(policies.__file__).parents[2]


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry]:
    monkeypatch.setattr(policies, "EVALUATION_EPISODES", EPISODES)
    with Registry.open(tmp_path / "registry") as opened:
        yield opened


@pytest.fixture(scope="module")
def soft(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Registry]:
    """policy-1 was learned by other settings than the usual ones."""
    with pytest.MonkeyPatch.context() as patch, Registry.open(tmp_path_factory.mktemp("soft")) as opened:
        patch.setattr(policies, "EVALUATION_EPISODES", EPISODES)
        assert learn("GapBall", opened, SOFT, 8 * FRAMES).success_rate > 0.2
        yield opened


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Hashes of what was observed and done in the latest evaluation.

    Figures alone tell little of a task that hardly anyone solves so soon.
    """
    steps: list[str] = []
    act, played = Rollout.act, policies.played

    def acting(rollout: Rollout, environment: Environment) -> NDArray[Any]:
        actions = act(rollout, environment)
        steps.append(hashlib.sha256(rollout.buffer.observations.tobytes() + actions.tobytes()).hexdigest())
        return actions

    def playing(*given: Any) -> Evaluation:
        steps.clear()
        return played(*given)

    monkeypatch.setattr(Rollout, "act", acting)
    monkeypatch.setattr(policies, "played", playing)
    return steps


def learn(
    task: str, registry: Registry, changes: dict[str, Any] | None = None, frames: int = FRAMES
) -> PolicyRecord:
    job = TrainJob(task, 0, frames, changes or {})
    return registry.policy(train_source(job, registry, lambda _: None)["policy"])


def go_on(policy: HybridPolicy) -> None:
    """Acts for a block, and doesn't learn."""
    settings, rng = policy.settings, np.random.default_rng(1)
    agent = HybridAgent(policy, ProgramSelector(policy, rng), [policy.low_level], rng)
    Interaction(policy.task.make(settings.num_envs, 1, settings.action_repeat), agent).run(
        agent.rollout_steps
    )


def stored(policy: PolicyRecord) -> dict[str, float]:
    return {figure: getattr(policy, figure) for figure in FIGURES}


def played(registry: Registry, policy: PolicyRecord) -> dict[str, float]:
    found = evaluate(registry, policy, policy.task, EPISODES, EVALUATION_SEED)
    return {figure: found[figure] for figure in FIGURES}


@pytest.mark.parametrize("name", [name for name in names() if name not in [*FAMILIES][1:]])
def test_what_is_stored_is_what_is_found(name: str, registry: Registry, seen: list[str]) -> None:
    with short_episodes():
        policy = learn(name, registry, FEW, 1)
        at_first = seen.copy()
        assert played(registry, policy) == stored(policy)
        assert seen == at_first
        revived, task = revive(registry, policy), load(name)
        assert isinstance(revived, HybridPolicy)
        assert revived.settings == settings_for(task, FEW)
        before = policies.played(revived, task, EPISODES, EVALUATION_SEED)
        assert (before.success_rate, before.mean_score, before.mean_length) == tuple(stored(policy).values())
        assert before.program is not None
        assert (before.crispness, format_program(before.program)) == (policy.crispness, policy.program)
        go_on(revived)
        assert policies.played(revived, task, EPISODES, EVALUATION_SEED) == before
        assert seen == at_first


def test_a_process_with_more_threads_finds_the_same(registry: Registry) -> None:
    """In either domain, with episodes as long as usual."""
    kept = [learn(task, registry, FEW, 1) for task in ("GapBall", "MailMaze")]
    given = [registry.location, EPISODES, EVALUATION_SEED, *(policy.id for policy in kept)]
    environment = os.environ | {"PYTHONPATH": str(SOURCE), "OMP_NUM_THREADS": "2"}
    line = [sys.executable, "-c", ELSEWHERE, *map(str, given)]
    done = subprocess.run(line, env=environment, capture_output=True, check=True)
    found = [{figure: each[figure] for figure in FIGURES} for each in json.loads(done.stdout)]
    assert found == [stored(policy) for policy in kept]


def test_the_threads_of_who_asks_stay_as_they_are(soft: Registry) -> None:
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        assert played(soft, soft.policy("policy-1")) == stored(soft.policy("policy-1"))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


# What a policy was learned by is what it is revived by


def change_defaults(patch: pytest.MonkeyPatch, kind: type[Any], **values: Any) -> None:
    """Other defaults of a settings dataclass, all of whose fields have one."""
    found = zip(dataclasses.fields(kind), kind.__init__.__defaults__, strict=True)
    patch.setattr(
        kind.__init__, "__defaults__", tuple(values.get(field.name, usual) for field, usual in found)
    )


def other_defaults(patch: pytest.MonkeyPatch) -> None:
    change_defaults(patch, HybridSettings, sharpness=9.0, action_repeat=2, num_envs=3)
    change_defaults(patch, PPOSettings, sharpness=9.0, epochs=9)
    change_defaults(patch, DecisionSettings, max_steps=50, patience=0.9)
    assert HybridSettings().sharpness == HybridSettings().low_level.sharpness == 9.0


def other_numbers_of_the_domain(patch: pytest.MonkeyPatch) -> None:
    numbers = HybridSettings(sharpness=9.0, decisions=DecisionSettings(max_steps=50))
    patch.setattr("paddlectl.hybrid.settings.USUAL", {"minigrid": numbers})
    assert settings_for(load("GapBall")).sharpness == 9.0


@pytest.mark.parametrize("change", [lambda patch: None, other_defaults, other_numbers_of_the_domain])
def test_no_default_changes_a_policy(
    soft: Registry, change: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = soft.policy("policy-1")
    learned_by = settings_for(load("GapBall"), SOFT)
    change(monkeypatch)
    assert revive(soft, policy).settings == learned_by
    assert played(soft, policy) == stored(policy)


def test_its_settings_go_with_it(soft: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundles.export(soft, "policy-1", tmp_path / "policy.zip")
    with Registry.open(tmp_path / "elsewhere") as elsewhere:
        bundles.import_(lambda: Registry.open(tmp_path / "elsewhere"), tmp_path / "policy.zip")
        other_defaults(monkeypatch)
        assert elsewhere.policy("policy-1").metadata == soft.policy("policy-1").metadata
        assert played(elsewhere, elsewhere.policy("policy-1")) == stored(soft.policy("policy-1"))


def test_an_older_policy_has_the_settings_of_its_run(soft: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = dataclasses.replace(soft.policy("policy-1"), metadata={})
    run = soft.run(policy.run)
    older = dataclasses.replace(run, settings={"hybrid": run.settings["learning"]})  # as runs had them then
    monkeypatch.setattr(Registry, "run", lambda *_: older)
    other_defaults(monkeypatch)
    assert played(soft, policy) == stored(policy)


def test_a_policy_that_nothing_is_known_of_is_played_as_today(soft: Registry, registry: Registry) -> None:
    known = soft.policy("policy-1")
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="GapBall",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )
    told = {name: getattr(known, name) for name in (*FIGURES, "crispness", "domain", "frames", "program")}
    policy = registry.add_policy(
        run=run.id, task="GapBall", method="hdm", seed=0, checkpoint=soft.read_checkpoint(known), metadata={},
        **told,
    )  # fmt: skip
    assert revive(registry, policy).settings == settings_for(load("GapBall"))
    assert played(registry, policy) != stored(known)


def test_a_name_that_came_later_has_its_usual_value(soft: Registry) -> None:
    policy = soft.policy("policy-1")
    settings = json.loads(json.dumps(policy.metadata["settings"]))
    del settings["action_repeat"], settings["credit"]["imitation_margin"]
    older = dataclasses.replace(policy, metadata={"settings": settings})
    assert revive(soft, older).settings == settings_for(load("GapBall"), SOFT)
    assert (HybridSettings().action_repeat, CreditSettings().imitation_margin) == (1, 0.0)


def test_whatever_the_domain_has_today_it_has_the_default() -> None:
    for task in (load("MailMaze"), load("GapBall")):
        default = HybridSettings(low_level=LOW_LEVELS[task.learner]())
        assert settings_from(task, {}) == default
        assert settings_from(task, {"num_envs": 5}) == dataclasses.replace(default, num_envs=5)
        assert settings_from(task, {}, settings_for(task)) == settings_for(task)


def test_the_names_that_settings_had_are_read(soft: Registry) -> None:
    policy = soft.policy("policy-1")
    settings = json.loads(json.dumps(policy.metadata["settings"]))
    for then, now in {"lanes": "num_envs", "block": "rollout_steps", "repeat": "action_repeat"}.items():
        settings[then] = settings.pop(now)
    older = dataclasses.replace(policy, metadata={"settings": settings})
    assert revive(soft, older).settings == settings_for(load("GapBall"), SOFT)
    assert played(soft, older) == stored(policy)
    run = soft.run("run-1")
    begun = dataclasses.replace(run, settings={**run.settings, "learning": settings})
    assert job_of(begun) == job_of(run)


@pytest.mark.parametrize(
    "settings",
    [
        [],
        "soft",
        {"softness": 1.0},
        {"lanes": 64, "num_envs": 64},
        {"sharpness": "1.0"},
        {"sharpness": True},
        {"sharpness": None},
        {"sharpness": {"power": 1.0}},
        {"low_level": 1},
        {"low_level": {"hidden": 400}},
        {"credit": {"planned": 1}},
    ],
)
def test_settings_that_cant_be_read_are_told(soft: Registry, settings: Any) -> None:
    policy = dataclasses.replace(soft.policy("policy-1"), metadata={"settings": settings})
    with pytest.raises(IntegrityError, match="the settings of policy-1 aren't what this version writes"):
        revive(soft, policy)


@pytest.mark.parametrize("name", ["heads", "atoms"])
def test_clauses_of_other_symbols_are_refused(soft: Registry, name: str) -> None:
    policy = soft.policy("policy-1")
    other = {**policy.metadata, name: policy.metadata[name][::-1]}
    with pytest.raises(IntegrityError, match="doesn't fit GapBall"):
        revive(soft, dataclasses.replace(policy, metadata=other))


def test_a_run_goes_on_by_its_own_settings(soft: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    begun_by = settings_for(load("GapBall"), SOFT)
    other_defaults(monkeypatch)
    job = job_of(soft.run("run-1"))
    assert settings_for(load("GapBall"), job.changes) == begun_by
