"""A source that has learned nothing: kept and reused as any other, and no one's best policy."""

import shutil

import pytest

from paddlectl.experiments.policies import checkpoint, revive
from paddlectl.experiments.runner import random_source, run_transfer
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from small_transfer import SHORT, job

COPIED = (
    "run", "task", "domain", "seed", "frames", "program", "mean_score", "mean_length", "crispness",
    "metadata",
)  # fmt: skip


@pytest.fixture
def registry(sources, tmp_path, monkeypatch):
    """A copy of the tiny sources' registry."""
    shutil.copytree(sources, tmp_path / "registry")
    for module, name, value in SHORT:
        monkeypatch.setattr(module, name, value)
    return Registry.open(tmp_path / "registry")


def test_it_is_an_untrained_policy_with_a_run_of_no_frames(registry):
    record = random_source("DoorBall", 7, registry)
    run = registry.run(record.run)
    assert (record.method, record.task, record.seed, record.frames) == ("random", "DoorBall", 7, 0)
    assert (run.kind, run.method, run.status, run.frames, run.episodes, run.policy) == (
        "train", "random", "finished", 0, 0, record.id,
    )  # fmt: skip
    untrained = HybridPolicy(load("DoorBall"), 7, HybridSettings())
    assert registry.read_checkpoint(record) == checkpoint(untrained)
    assert checkpoint(revive(registry, record)) == checkpoint(untrained)


def test_it_is_not_the_best_where_another_solves_more(registry):
    drawn = random_source("DoorBall", 0, registry)
    assert registry.policy("DoorBall") == drawn  # there is no other
    kept = {name: getattr(drawn, name) for name in COPIED}
    learned = registry.add_policy(
        **kept,
        method="hdm",
        checkpoint=registry.read_checkpoint(drawn),
        success_rate=drawn.success_rate + 0.1,
    )
    newer = random_source("DoorBall", 0, registry)
    assert newer.success_rate == drawn.success_rate
    assert registry.policy("DoorBall") == learned


def test_a_transfer_takes_it_as_a_source(registry):
    policies = ("policy-2", random_source("DoorBall", 0, registry).id)
    row = run_transfer(job(policies, "default", frames=64 * 8), registry, lambda _: None)
    mapping = registry.files.read_document(row["run"], "mapping")
    assert mapping["sources"] == list(policies)
    assert registry.run(row["run"]).sources == policies
