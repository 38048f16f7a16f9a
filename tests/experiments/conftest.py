"""A registry of two tiny sources."""

from pathlib import Path
from typing import Any, NamedTuple

import pytest

import inline
from hurried import hurry
from paddlectl.experiments.jobs import Event, TrainJob
from paddlectl.experiments.processes import rows_of, run_jobs
from paddlectl.registry.store import Registry

JOBS = (TrainJob("GapBall", 0, 1), TrainJob("BlockedDoor", 0, 1))
"""One block of frames each, evaluated on few layouts."""


class Trained(NamedTuple):
    """What became of them, each learned in a process of its own."""

    rows: list[dict[str, Any]]
    told: list[tuple[int, Event]]
    registry: Registry


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    folder = tmp_path_factory.mktemp("trained")
    location = str(folder / "registry")
    told: list[tuple[int, Event]] = []
    with pytest.MonkeyPatch.context() as patch:
        hurry(patch, folder)
        rows = rows_of(run_jobs(JOBS, location, lambda index, event: told.append((index, event)), workers=2))
    return Trained(rows, told, Registry.open(location, create=False))


@pytest.fixture(scope="session")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The registry of the same jobs, done in this process: policy-1 of GapBall, policy-2 of BlockedDoor."""
    location = tmp_path_factory.mktemp("sources") / "registry"
    inline.run_jobs(JOBS, str(location), lambda *_: None)
    return location
