"""What is deleted is gone for good, whatever else happens; what others build on stays."""

import shutil
from pathlib import Path

import pytest

from paddlectl.errors import NotFoundError, RegistryBusyError, UsageError
from paddlectl.registry.care.check import check
from paddlectl.registry.care.deletion import chosen_runs, remove
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, TARGET, add_policy, add_source, add_transfer, program


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    """run-1 and run-2 are sources of run-3; run-4 is another's."""
    opened = Registry.open(tmp_path / "registry")
    for task in ("BlockedDoor", "GapBall"):
        add_source(opened, task, program("BlockedDoor", BLOCKED_DOOR))
    add_transfer(opened)
    add_source(opened, "BoxDoor", None)
    return opened


def ids(registry: Registry) -> list[str]:
    return [*(run.id for run in registry.runs()), *(policy.id for policy in registry.policies())]


def gone(registry: Registry, *names: str, with_dependants: bool = False) -> int:
    return remove(registry.location, chosen_runs(registry.location, names, with_dependants=with_dependants))


def test_a_run_goes_with_its_policy_its_tables_and_its_checkpoint(registry: Registry) -> None:
    before = sum(path.stat().st_size for path in registry.folder.rglob("*.json*"))
    checkpoints = len(list((registry.folder / "objects").iterdir()))
    assert gone(registry, "policy-3") > 0
    assert ids(registry) == ["run-4", "run-2", "run-1", "policy-4", "policy-2", "policy-1"]
    assert sum(path.stat().st_size for path in registry.folder.rglob("*.json*")) < before
    assert len(list((registry.folder / "objects").iterdir())) == checkpoints - 1
    assert not (registry.folder / "runs" / "run-3").exists()
    assert check(registry.location, read_data=True).findings == []


def test_it_doesnt_come_back_by_a_repair_not_even_of_a_lost_index(registry: Registry) -> None:
    gone(registry, "run-3", "run-4")
    left = ids(registry)
    registry.close()
    for path in registry.folder.glob("registry.db*"):
        path.unlink()
    assert repair(registry.location).left == []
    with Registry.open(registry.location) as again:
        assert ids(again) == left


def test_what_others_build_on_goes_only_with_them(registry: Registry) -> None:
    with pytest.raises(UsageError, match="run-3 built on"):
        gone(registry, "run-1")
    run = registry.add_run(
        kind="transfer", method="paddle", task=TARGET, scenario="B", sources=["policy-3"], seed=0,
        settings={}, versions={},
    ).id  # fmt: skip
    chosen = chosen_runs(registry.location, ["policy-1"], with_dependants=True)
    assert [each.id for each in chosen] == ["run-1", "run-3", run]
    assert ids(registry)[0] == run  # to look at what would go deletes nothing
    registry.finish_run(run, status="failed", frames=0, episodes=0, seconds=0.0, results={})
    remove(registry.location, chosen)
    assert ids(registry) == ["run-4", "run-2", "policy-4", "policy-2"]
    assert check(registry.location, read_data=True).findings == []


def test_a_checkpoint_that_another_policy_has_stays(registry: Registry) -> None:
    add_policy(registry, "run-4", "BlockedDoor", None)  # its checkpoint is made of the task's name
    twin = registry.policy("policy-5")
    gone(registry, "run-3", "run-1")
    assert registry.read_checkpoint(twin)
    assert check(registry.location, read_data=True).findings == []


def test_a_run_that_goes_on_is_refused_and_all_stays(registry: Registry) -> None:
    before = ids(registry)
    other = Registry.open(registry.location)
    with other.files.hold("run-4"), pytest.raises(RegistryBusyError):
        gone(registry, "run-3", "run-4")
    assert ids(registry) == before and check(registry.location, read_data=True).findings == []


def test_a_run_that_comes_to_build_on_it_meanwhile_keeps_it(registry: Registry) -> None:
    chosen = chosen_runs(registry.location, ["run-4"])
    registry.add_run(
        kind="transfer", method="cup", task=TARGET, scenario="B", sources=["policy-4"], seed=0, settings={},
        versions={},
    )  # fmt: skip
    with pytest.raises(RegistryBusyError, match="has begun"):
        remove(registry.location, chosen)
    assert registry.policy("policy-4")


def test_a_run_whose_folder_is_lost_can_be_deleted(registry: Registry) -> None:
    shutil.rmtree(registry.folder / "runs" / "run-4")
    gone(registry, "run-4")
    assert "run-4" not in ids(registry) and check(registry.location).findings == []


@pytest.mark.parametrize("name", ["run-77", "policy-77", "BoxDoor", "run-0", ""])
def test_only_what_is_there_can_be_named(registry: Registry, name: str) -> None:
    with pytest.raises(NotFoundError):
        chosen_runs(registry.location, ["run-4", name])
