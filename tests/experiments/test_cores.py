"""How many CPUs a process may use."""

import os

import pytest

from paddlectl.experiments import cores


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """Writes what the control groups say: of this process, and their files."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(cores, "CGROUPS", tmp_path / "groups")
    monkeypatch.setattr(cores, "OWN", tmp_path / "own")

    def write(own, files):
        (tmp_path / "own").write_text(own)
        for name, text in files.items():
            path = tmp_path / "groups" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    return write


def test_without_control_groups_the_affinity_counts(groups):
    assert cores.permitted() == 8


@pytest.mark.parametrize(
    ("quota", "count"),
    [("max 100000", 8), ("200000 100000", 2), ("150000 100000", 2), ("1000 100000", 1), ("nonsense", 8)],
)
def test_the_quota_of_a_container(groups, quota, count):
    groups("0::/\n", {"cpu.max": quota + "\n"})
    assert cores.permitted() == count


def test_the_smallest_quota_of_all_groups_above(groups):
    quotas = {"a/b/cpu.max": "max 100000\n", "a/cpu.max": "300000 100000\n", "cpu.max": "600000 100000\n"}
    groups("0::/a/b\n", quotas)
    assert cores.permitted() == 3


@pytest.mark.parametrize(("quota", "count"), [("-1", 8), ("400000", 4)])
def test_version_1_of_control_groups(groups, quota, count):
    files = {"cpu,cpuacct/docker/cpu.cfs_quota_us": quota, "cpu,cpuacct/docker/cpu.cfs_period_us": "100000"}
    groups("4:memory:/docker\n3:cpu,cpuacct:/docker\n", files)
    assert cores.permitted() == count
