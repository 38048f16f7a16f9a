"""Jobs on a real Ray cluster of this machine: what comes back is what the same jobs are at home."""

from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import PaddlectlError
from paddlectl.experiments import cluster
from paddlectl.experiments.jobs import Failure, RandomJob, TrainJob, TransferJob
from paddlectl.experiments.runner import random_source, run_transfer, train_source
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario

ray = pytest.importorskip("ray")
FRAMES = 4096
SCENARIO = Scenario(name="small", target="BlockedBoxUnlockPickup", sources=("BoxDoor", "GapBall"))


def ignored(*_: object) -> None:
    """Whatever is told."""


def test_what_is_learned_there_is_what_is_learned_here(tmp_path: Path) -> None:
    there, here = tmp_path / "there", tmp_path / "here"
    with Registry.open(there) as away, Registry.open(here) as home:
        for registry in (away, home):
            random_source("GapBall", 3, registry)
            random_source("BoxDoor", 3, registry)
        jobs = [
            TransferJob(SCENARIO, ("policy-2", "policy-1"), "paddle", 1, FRAMES),
            TrainJob("BoxDoor", 2, FRAMES),
            RandomJob("OpenGoal", 5),
        ]
        run_transfer(jobs[0], home, ignored)
        train_source(jobs[1], home, ignored)
        random_source("OpenGoal", 5, home)
        told: dict[int, Any] = {}
        outcomes = cluster.run_jobs(jobs, str(there), told.__setitem__, "ray")
        assert told == dict(enumerate(outcomes))
        for outcome, expected in zip(outcomes, home.runs()[2::-1], strict=True):
            assert isinstance(outcome, dict)
            run = away.run(outcome["run"])
            assert (run.kind, run.method, run.sources) == (expected.kind, expected.method, expected.sources)
            assert (run.settings, run.results) == (expected.settings, expected.results)
            found, own = away.policy(run.policy or ""), home.policy(expected.policy or "")
            assert (found.checkpoint, found.program) == (own.checkpoint, own.program)
            for table in ("episodes", "weights", "moments"):
                rows = away.files.read_rows(run.id, table)
                assert rows == home.files.read_rows(expected.id, table)
    assert not check(there, read_data=True).faults


def test_one_that_fails_stops_no_other(tmp_path: Path) -> None:
    jobs = [TrainJob("CoffeeMaze", 0, 100, method="ppo"), RandomJob("BoxDoor", 0)]
    failed, done = cluster.run_jobs(jobs, str(tmp_path / "registry"), ignored, "ray")
    assert isinstance(failed, Failure) and isinstance(failed.error, PaddlectlError)
    assert "ppo chooses" in failed.error.message and failed.error.hint
    assert isinstance(done, dict) and done["policy"] == "policy-1"


def test_nodes_with_another_version_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "versions", lambda: {"paddlectl": "0.0.1"})
    (failed,) = cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "ray")
    assert isinstance(failed, Failure) and "here is paddlectl 0.0.1" in str(failed.error)


def test_a_cluster_that_isnt_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(PaddlectlError, match=r"the Ray cluster 127\.0\.0\.1:1 can't be reached") as caught:
        cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "127.0.0.1:1")
    assert "ray status" in caught.value.hint
