"""What is deleted is gone for good, whatever else happens; what others build on stays."""

import itertools
import os
import resource
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from paddlectl.errors import NotFoundError, RegistryBusyError, UsageError
from paddlectl.registry.care.check import check
from paddlectl.registry.care.deletion import chosen_runs, remove
from paddlectl.registry.care.garbage import collect
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
    with pytest.raises(UsageError, match="run-3 reused what was learned there"):
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


STEPS = {"os.mkdir", "os.rename", "os.remove", "os.rmdir"}


def stopped_at(registry: Registry, step: int) -> bool:
    """Whether a process that deletes run-3 and run-4 was ended right before that change of the disk."""
    process = os.fork()
    if not process:
        left = itertools.count(step, -1)

        def hear(event: str, given: tuple[object, ...]) -> None:
            opened = event == "open" and isinstance(given[2], int) and given[2] & (os.O_CREAT | os.O_RDWR)
            if (opened or event in STEPS) and not next(left):
                os._exit(9)

        sys.addaudithook(hear)
        try:
            gone(registry, "run-3", "run-4")
            os._exit(0)
        finally:
            os._exit(1)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code in (0, 9)
    return code == 9


def test_a_deletion_that_is_stopped_anywhere_is_ended_or_hasnt_begun(
    registry: Registry, tmp_path: Path
) -> None:
    every, some = ids(registry), ["run-2", "run-1", "policy-2", "policy-1"]
    outcomes = []
    for step in itertools.count():
        shutil.copytree(registry.folder, place := tmp_path / f"copy{step}")
        copy = Registry(place)
        if not stopped_at(copy, step):
            break
        assert check(place, read_data=True).faults == []
        outcomes.append(ids(copy))
        assert outcomes[-1] in (every, some)
        if outcomes[-1] == some and step % 4 == 3:  # the index is lost, too
            for path in place.glob("registry.db*"):
                path.unlink()
        if step % 2:
            repair(place)
            assert ids(Registry.open(place)) == outcomes[-1]
        else:
            collect(place, grace=0, dry=True)
            assert ids(copy) == outcomes[-1]
        collect(place, grace=0)
        assert check(place, read_data=True).findings == []
        assert ids(copy) == outcomes[-1] and not [*place.glob("deleted-*")]
        if outcomes[-1] == every:
            gone(copy, "run-3", "run-4")
        assert ids(copy) == some and not (place / "aside").exists()
        assert sorted(path.name for path in (place / "runs").iterdir()) == ["run-1", "run-2"]
    assert outcomes[0] == every and outcomes[-1] == some


def test_few_open_files_are_enough_for_many_runs(registry: Registry) -> None:
    for _ in range(14):
        add_source(registry, "BoxDoor", None)
    spare = os.dup(0)  # all below it are in use
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (spare + 10, hard))
        gone(registry, *(run.id for run in registry.runs()))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        os.close(spare)
    assert ids(registry) == [] and check(registry.location).findings == []


def test_a_run_that_was_entered_a_moment_ago_stays(registry: Registry) -> None:
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="BoxDoor",
        scenario=None,
        sources=[],
        seed=0,
        settings={},
        versions={},
    ).id
    with ThreadPoolExecutor(1) as pool:
        deleting = pool.submit(gone, registry, run)
        time.sleep(0.05)
        with Registry.open(registry.location).files.hold(run), pytest.raises(RegistryBusyError):
            deleting.result()
    assert registry.run(run).id == run
