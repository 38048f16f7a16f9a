import shutil
from pathlib import Path
from typing import Any

import pytest

from paddlectl.registry.records import PolicyRecord, RunRecord
from paddlectl.registry.store import Registry


class Filler:
    """Adds runs and policies with only what a test cares about."""

    def __init__(self, registry: Registry) -> None:
        self.registry = registry

    def run(self, **given: Any) -> RunRecord:
        plain = {"kind": "train", "method": "hdm", "task": "BoxDoor", "scenario": None, "sources": []}
        rest = {"seed": 0, "settings": {"lanes": 64}, "versions": {"python": "3.11"}}
        return self.registry.add_run(**plain | rest | given)

    def policy(self, run: str, **given: Any) -> PolicyRecord:
        plain = {"task": "BoxDoor", "domain": "minigrid", "method": "hdm", "seed": 0, "frames": 1000}
        text = {"program": "0.98 :: gt_key() :- !has_key(agent)\n", "checkpoint": b"weights", "metadata": {}}
        figures = {"success_rate": 0.5, "mean_score": 0.4, "mean_length": 30.0, "crispness": 0.9}
        return self.registry.add_policy(run=run, **plain | text | figures | given)


@pytest.fixture
def location(tmp_path: Path) -> Path:
    return tmp_path / "registry"


@pytest.fixture(scope="session")
def new(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(Registry.open(tmp_path_factory.mktemp("new") / "registry").location)


@pytest.fixture
def registry(location: Path, new: Path) -> Registry:
    shutil.copytree(new, location)  # quicker than making one for each test
    return Registry.open(location)


@pytest.fixture
def add(registry: Registry) -> Filler:
    return Filler(registry)


@pytest.fixture(scope="session")
def filler() -> type[Filler]:
    return Filler
