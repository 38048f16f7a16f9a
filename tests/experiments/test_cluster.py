"""Jobs on a real Ray cluster of two nodes: what comes back is what the same jobs are at home.

They are skipped where Ray isn't installed; docs/cluster.md says how to run them.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from nodes import Nodes, nodes, until
from paddlectl import plugins
from paddlectl.errors import PaddlectlError
from paddlectl.experiments import cluster
from paddlectl.experiments.jobs import Failure, Job, RandomJob, TrainJob, TransferJob
from paddlectl.experiments.runner import random_source, run_transfer, train_source
from paddlectl.registry.care.check import check
from paddlectl.registry.care.deletion import chosen_runs, remove
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.tasks import suite
from postgres import server
from samples import ROOT

pytest.importorskip("ray")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the nodes are at 127.0.0.2 and so on")
FRAMES = 2048
SCENARIO = Scenario(name="small", target="BlockedBoxUnlockPickup", sources=("BoxDoor", "GapBall"))
TRAIN = [TrainJob("BoxDoor", seed, FRAMES) for seed in range(2)]
STUDY = f"""
name: small
scenarios: [{ROOT}/scenarios/A.yaml]
methods: [paddle, hdm]
seeds: 0-0
frames: {FRAMES}
source_frames: {FRAMES}
"""
RUNS = 4


def ignored(*_: object) -> None:
    """Whatever is told."""


@pytest.fixture(scope="module")
def two() -> Iterator[Nodes]:
    with nodes(2) as made:
        yield made


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """Where Ray keeps its sockets, whose names have to be short."""
    with tempfile.TemporaryDirectory(prefix="ray-", dir="/tmp") as folder:
        yield Path(folder)


def done_at_home(job: Job, registry: Registry) -> str:
    match job:
        case TransferJob():
            return run_transfer(job, registry, ignored)["run"]
        case TrainJob():
            return train_source(job, registry, ignored)["run"]
        case RandomJob():
            return random_source(job.task, job.seed, registry).run
    raise AssertionError(job)


def require_same(registry: Registry, run: str, home: Registry, other: str) -> None:
    """To the last bit: settings, figures, tables, program and weights."""
    found, own = registry.run(run), home.run(other)
    for name in ("kind", "method", "task", "seed", "sources", "settings", "results", "frames", "episodes"):
        assert getattr(found, name) == getattr(own, name), name
    learned, expected = registry.policy(found.policy or ""), home.policy(own.policy or "")
    assert (learned.checkpoint, learned.program) == (expected.checkpoint, expected.program)
    for table in ("episodes", "weights", "moments"):
        assert registry.files.read_rows(run, table) == home.files.read_rows(other, table)


def require_same_as_at_home(jobs: Sequence[Job], outcomes: list[Any], place: Path, home: Path) -> None:
    with Registry.open(place) as registry, Registry.open(home) as own:
        for job, outcome in zip(jobs, outcomes, strict=True):
            assert isinstance(outcome, dict), outcome
            require_same(registry, outcome["run"], own, done_at_home(job, own))
        assert len(registry.runs()) == len(own.runs())
    assert not check(place, read_data=True).faults


@pytest.mark.parametrize("by", ["address", "client"])
def test_what_is_learned_there_is_what_is_learned_here(two: Nodes, by: str, tmp_path: Path) -> None:
    for place in ("there", "here"):
        with Registry.open(tmp_path / place) as registry:
            random_source("GapBall", 3, registry)
            random_source("BoxDoor", 3, registry)
    jobs = [
        TransferJob(SCENARIO, ("policy-2", "policy-1"), "paddle", 1, FRAMES),
        TrainJob("BoxDoor", 2, FRAMES),
        RandomJob("OpenGoal", 5),
    ]
    told: dict[int, Any] = {}
    outcomes = cluster.run_jobs(jobs, str(tmp_path / "there"), told.__setitem__, getattr(two, by))
    assert told == dict(enumerate(outcomes))
    require_same_as_at_home(jobs, outcomes, tmp_path / "there", tmp_path / "here")


def test_without_a_cluster_ray_starts_one(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_TMPDIR", str(short_folder))
    monkeypatch.setenv("HOME", str(tmp_path))
    (outcome,) = cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "ray")
    assert isinstance(outcome, dict) and outcome["policy"] == "policy-1"
    assert not (tmp_path / ".ray").exists(), "Ray keeps its token at the user's home"


def test_ray_means_the_cluster_that_the_environment_names(
    two: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_ADDRESS", two.address)
    (outcome,) = cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "ray")
    assert isinstance(outcome, dict)
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with pytest.raises(PaddlectlError, match=r"127\.0\.0\.1:1 can't be reached"):
        cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "ray")


def test_one_that_fails_stops_no_other(two: Nodes, tmp_path: Path) -> None:
    jobs = [TrainJob("CoffeeMaze", 0, 100, method="ppo"), RandomJob("BoxDoor", 0)]
    failed, done = cluster.run_jobs(jobs, str(tmp_path / "registry"), ignored, two.address)
    assert isinstance(failed, Failure) and isinstance(failed.error, PaddlectlError)
    assert "ppo chooses" in failed.error.message and failed.error.hint
    assert isinstance(done, dict) and done["policy"] == "policy-1"


def test_a_run_whose_source_is_deleted_meanwhile_fails(two: Nodes, tmp_path: Path) -> None:
    with Registry.open(tmp_path) as registry:
        source = random_source("BoxDoor", 3, registry)

    def tell(index: int, _: object) -> None:
        if index == 0:
            remove(tmp_path, chosen_runs(tmp_path, [source.id]))

    jobs = [RandomJob("OpenGoal", 0), TransferJob(SCENARIO, (source.id,), "paddle", 0, FRAMES)]
    done, failed = cluster.run_jobs(jobs, str(tmp_path), tell, two.address)
    assert isinstance(done, dict) and isinstance(failed, Failure) and source.id in str(failed.error)


def test_nodes_with_another_version_are_refused(
    two: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "versions", lambda: {"paddlectl": "0.0.1"})
    (failed,) = cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, two.address)
    assert isinstance(failed, Failure) and "here is paddlectl 0.0.1" in str(failed.error)
    assert f"the node {socket.gethostname()} has paddlectl" in str(failed.error)


def test_no_file_of_the_working_folder_is_taken_for_a_module(
    two: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for module in ("torch", "gymnasium", "sqlalchemy"):
        Path(f"{module}.py").write_text("raise SystemExit")
    (outcome,) = cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, two.address)
    assert isinstance(outcome, dict)


@pytest.fixture
def file(tmp_path: Path) -> Iterator[Path]:
    """Where tasks may be."""
    yield tmp_path / "own.py"
    plugins._files.clear()
    suite.PLUGINS._of_files.clear()


def test_tasks_of_files_are_known_there(two: Nodes, file: Path, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    file.write_text(re.findall(r"```python\n(# cab\.py.*?)```", page, re.DOTALL)[0])
    jobs = [TrainJob(name, 0, FRAMES) for name in suite.add_file(file)]
    outcomes = cluster.run_jobs(jobs, str(tmp_path / "there"), ignored, two.address)
    require_same_as_at_home(jobs, outcomes, tmp_path / "there", tmp_path / "here")


def test_a_registry_in_postgresql_is_opened_at_home_alone(two: Nodes, tmp_path: Path) -> None:
    with server() as database:
        location = database.new(tmp_path / "files")
        with Registry.open(location) as registry:
            source = random_source("BoxDoor", 3, registry)
        jobs = [TransferJob(SCENARIO, (source.id,), "paddle", 0, FRAMES)]
        (outcome,) = cluster.run_jobs(jobs, location, ignored, two.address)
        assert isinstance(outcome, dict)
        with Registry.open(location) as registry:
            assert [run.status for run in registry.runs()] == ["finished"] * 2


def test_a_cluster_that_isnt_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(PaddlectlError, match=r"the Ray cluster 127\.0\.0\.1:1 can't be reached") as caught:
        cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, "127.0.0.1:1")
    assert "ray status" in caught.value.hint


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_something_else_at_the_address_isnt_waited_for(
    tmp_path: Path, scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "CONNECTED", 5.0)
    with socket.create_server(("127.0.0.2", 0)) as other:
        address = f"{scheme}127.0.0.2:{other.getsockname()[1]}"
        with pytest.raises(PaddlectlError, match="can't be reached: it doesn't answer"):
            cluster.run_jobs([RandomJob("BoxDoor", 0)], str(tmp_path / "registry"), ignored, address)


# What is lost


def lost_amid(made: Nodes, lose: Any, place: Path) -> list[Any]:
    """Two jobs, amid which something is lost as soon as they are learned."""
    hit = []

    def strike() -> None:
        until(lambda: made.learning() == 2)
        hit.append(lose())

    striking = threading.Thread(target=strike)
    striking.start()
    outcomes = cluster.run_jobs(TRAIN, str(place), ignored, made.address)
    striking.join()
    assert hit == [True], "nothing was lost amid a cell"
    return outcomes


def test_a_cell_whose_process_is_killed_is_learned_again(two: Nodes, tmp_path: Path) -> None:
    outcomes = lost_amid(two, two.lose_worker, tmp_path / "there")
    require_same_as_at_home(TRAIN, outcomes, tmp_path / "there", tmp_path / "here")


def test_a_cell_whose_node_is_killed_is_learned_on_another(tmp_path: Path) -> None:
    with nodes(2) as made:
        outcomes = lost_amid(made, lambda: made.lose(1), tmp_path / "there")
    require_same_as_at_home(TRAIN, outcomes, tmp_path / "there", tmp_path / "here")


def test_a_cell_that_ends_its_process_each_time_fails(two: Nodes, file: Path, tmp_path: Path) -> None:
    file.write_text("import os\nTASKS = {'Bad': lambda *_: os._exit(1)}\n")
    (name,) = suite.add_file(file)
    jobs = [TrainJob(name, 0, FRAMES), RandomJob("BoxDoor", 0)]
    failed, done = cluster.run_jobs(jobs, str(tmp_path / "registry"), ignored, two.address)
    assert isinstance(failed, Failure) and "it failed on the cluster: " in str(failed.error)
    assert isinstance(done, dict)


def begun(folder: Path, address: str) -> "subprocess.Popen[str]":
    """A sweep, as a user types it."""
    (folder / "study.yaml").write_text(STUDY)
    line = [sys.executable, "-m", "paddlectl", "sweep", "study.yaml", "--on", address]
    return subprocess.Popen(
        [*line, "--results", "results.json", "--registry", "registry"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def kept(folder: Path) -> Counter[str]:
    """How many runs of each state there are."""
    with Registry.open(folder / "registry") as registry:
        return Counter(run.status for run in registry.runs())


def require_whole(folder: Path, address: str) -> None:
    """Runs it again: what was missing is there, and each cell once."""
    again = begun(folder, address)
    told = again.communicate(timeout=200)
    assert again.returncode == 0, told
    assert kept(folder) == {"finished": RUNS}
    assert not check(folder / "registry", read_data=True).faults


def amid(process: "subprocess.Popen[str]", folder: Path, made: Nodes) -> None:
    """Waits until the sources are kept, and cells go on."""
    until(lambda: process.poll() is not None or len(list((folder / "registry/runs").glob("run-*"))) == 2)
    until(lambda: process.poll() is not None or made.learning())
    assert process.poll() is None, process.communicate()


def test_a_restarted_head_ends_the_sweep_which_can_be_run_again(tmp_path: Path) -> None:
    with nodes(2) as made:
        process = begun(tmp_path, made.address)
        amid(process, tmp_path, made)
        made.restart()
        out, told = process.communicate(timeout=100)
        assert process.returncode == 1 and not out
        assert told.splitlines()[-2].startswith(f"error: the Ray cluster {made.address} was lost: ")
        assert told.splitlines()[-1].endswith("what has ended is kept, so run the same again")
        assert "Traceback" not in told and len(told.splitlines()) == 4, told
        assert kept(tmp_path) == {"finished": 2}
        require_whole(tmp_path, made.address)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_sweep_that_is_stopped_leaves_nothing_behind_and_goes_on(
    two: Nodes, tmp_path: Path, number: signal.Signals
) -> None:
    process = begun(tmp_path, two.address)
    amid(process, tmp_path, two)
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    if number != signal.SIGKILL:
        assert process.returncode == 128 + number
        assert told.splitlines()[-1] == "interrupted"
        assert f"go on with: paddlectl sweep study.yaml --on {two.address}" in told
    until(lambda: two.learning() == 0, 20.0)
    assert kept(tmp_path) == {"finished": 2}
    require_whole(tmp_path, two.address)
