"""What an earlier release has learned is revived and plays as it did (R19)."""

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from freeze import POLICIES
from paddlectl.agents.settings import changed
from paddlectl.experiments.policies import EVALUATION_EPISODES, EVALUATION_SEED, evaluate, revive
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.registry.bundles import bundles
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry
from released import BUNDLES

FROZEN = sorted(BUNDLES.glob("*.zip.gz"))
EVALUATED_OTHERWISE = {"BoxDoor-0002.zip.gz"}
"""Evaluated before layouts were split and actions drawn from the evaluation's seed: on other layouts, so
that what they earned can't be found again. They must play as well as they did."""
FIGURES = ("success_rate", "mean_score", "mean_length")


def test_there_is_one_of_each_kind() -> None:
    assert {path.name for path in FROZEN} > EVALUATED_OTHERWISE


def opened(path: Path, place: Path) -> tuple[Registry, PolicyRecord]:
    bundle = place / "policy.zip"
    bundle.write_bytes(gzip.decompress(path.read_bytes()))
    told = bundles.import_(lambda: Registry.open(place / "registry"), bundle)
    registry = Registry.open(place / "registry")
    return registry, registry.policy(told["policy"])


@pytest.mark.parametrize("path", FROZEN, ids=lambda path: path.name)
def test_a_frozen_policy_earns_what_it_earned(path: Path, tmp_path: Path) -> None:
    registry, policy = opened(path, tmp_path)
    with registry:
        found = evaluate(registry, policy, policy.task, EVALUATION_EPISODES, EVALUATION_SEED)
    assert policy.mean_score > 0.9
    if path.name in EVALUATED_OTHERWISE:
        assert found["success_rate"] >= 0.99
        assert found["mean_score"] == pytest.approx(policy.mean_score, abs=0.005)
    else:
        assert {name: found[name] for name in FIGURES} == {name: getattr(policy, name) for name in FIGURES}


@pytest.mark.parametrize("path", FROZEN, ids=lambda path: path.name)
def test_it_is_revived_by_its_own_settings(path: Path, tmp_path: Path) -> None:
    registry, policy = opened(path, tmp_path)
    with registry:
        settings: Any = revive(registry, policy).settings
    kind = path.name.rpartition("-")[0]
    frozen: Any = changed(HybridSettings(), POLICIES[kind])  # what was usual then are the defaults
    assert settings.sharpness == frozen.sharpness
    assert settings.low_level.sharpness == frozen.low_level.sharpness
    assert replace(settings.decisions, shaping=0.0) == frozen.decisions  # shaping is of learning alone
    if path.name == "BoxDoor-0002.zip.gz":
        assert settings.low_level.epochs == 4  # as it was then
