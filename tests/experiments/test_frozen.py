"""What an earlier release has learned is revived and plays as it did (R19)."""

import gzip
from pathlib import Path

import pytest

from paddlectl.experiments.sources import EVALUATION_EPISODES, EVALUATION_SEED, evaluate
from paddlectl.registry import bundles
from paddlectl.registry.store import Registry
from released import BUNDLES

FROZEN = sorted(BUNDLES.glob("*.zip.gz"))


def test_there_is_one() -> None:
    assert FROZEN


@pytest.mark.parametrize("path", FROZEN, ids=lambda path: path.name)
def test_a_frozen_policy_earns_what_it_earned(path: Path, tmp_path: Path) -> None:
    bundle = tmp_path / "policy.zip"
    bundle.write_bytes(gzip.decompress(path.read_bytes()))
    told = bundles.import_(lambda: Registry.open(tmp_path / "registry"), bundle)
    with Registry.open(tmp_path / "registry") as registry:
        policy = registry.policy(told["policy"])
        found = evaluate(registry, policy, policy.task, EVALUATION_EPISODES, EVALUATION_SEED)
    assert policy.mean_score > 0.9
    for figure in ("success_rate", "mean_score", "mean_length"):
        assert found[figure] == getattr(policy, figure)
