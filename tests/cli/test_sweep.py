"""`paddlectl sweep`: a small study run for real, and what it says."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import inline
from hurried import hurry
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import Failure
from paddlectl.registry.store import Registry
from paddlectl.studies.results import Result, change_results, read_results, write_results
from samples import ROOT, Command
from studies.made import SIX
from studies.made import results as made

A = ROOT / "scenarios" / "A.yaml"


def study(folder: Path, methods: str = "paddle, hdm") -> Path:
    path = folder / "study.yaml"
    path.write_text(
        f"name: small\nscenarios: [{A}]\nmethods: [{methods}]\nseeds: 0\nframes: 2048\nsource_frames: 2048\n"
    )
    return path


def test_a_study_is_run_once(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", inline.run_jobs)
    file, results = study(tmp_path), tmp_path / "made" / "results.json"
    before = command("sweep", file, "--dry-run")
    assert before.code == 0
    assert before.out.startswith("small: 2 cells: 2 missing\nto run: 4 runs × 2,048 frames, ")
    assert not (tmp_path / "registry").exists(), "to look makes nothing"
    done = command("sweep", file, "--results", results, "--jobs", 2)
    assert done.code == 0 and done.out.startswith("small: 2 cells: 2 finished\n")
    runs = Registry.open(tmp_path / "registry").runs()
    assert sorted((run.kind, run.method, run.task) for run in runs) == [
        ("train", "hdm", "BlockedDoor"),
        ("train", "hdm", "GapBall"),
        ("transfer", "hdm", "BlockedBoxUnlockPickup"),
        ("transfer", "paddle", "BlockedBoxUnlockPickup"),
    ]
    again = command("sweep", file, "--json").json
    assert {(cell["method"], cell["state"], cell["frames"]) for cell in again["cells"]} == {
        ("paddle", "finished", 2048),
        ("hdm", "finished", 2048),
    }
    assert again["failed"] == [] and len(Registry.open(tmp_path / "registry").runs()) == 4
    kept = read_results(results)
    assert [(row.scenario, row.method, row.seed, row.frames) for row in kept] == [
        ("A", "paddle", 0, 2048),
        ("A", "hdm", 0, 2048),
    ]
    assert [row.source_frames for row in kept] == [4096, 0]
    assert all(len(row.by_frames) == 100 for row in kept)


def test_it_goes_on_where_another_machine_left_off(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", inline.run_jobs)
    file, results = study(tmp_path, "hdm"), tmp_path / "results.json"
    assert command("sweep", file, "--results", results, "--jobs", 1).code == 0
    (there,) = read_results(results)
    elsewhere = tmp_path / "elsewhere"
    both = study(tmp_path, "hdm, ppo")
    answer = command("sweep", both, "--registry", elsewhere, "--results", results, "--dry-run")
    assert answer.out.startswith("small: 2 cells: 1 from the file of results, 1 missing\nto run: 1 run")
    assert read_results(results) == [there]
    answer = command("sweep", both, "--registry", elsewhere, "--results", results, "--json", "--jobs", 1)
    assert [(cell["method"], cell["state"]) for cell in answer.json["cells"]] == [
        ("hdm", "kept"),
        ("ppo", "finished"),
    ]
    assert [run.method for run in Registry.open(elsewhere).runs()] == ["ppo"]
    assert [row.method for row in read_results(results)] == ["hdm", "ppo"]
    assert read_results(results)[0] == there
    before = results.read_bytes()
    for other in (("--seeds", "7"), ("--frames", "1024")):
        answer = command("sweep", both, *other, "--results", results, "--dry-run")
        assert answer.out.startswith("small: 2 cells: 2 missing") and results.read_bytes() == before
    command("sweep", study(tmp_path, "hdm"), "--frames", "1024", "--results", results, "--jobs", 1)
    new, other = read_results(results)
    assert (new.method, other.method) == ("hdm", "ppo") and new.cell != there.cell, "a new row in its place"


def test_what_another_sweep_wrote_meanwhile_stays(tmp_path: Path) -> None:
    results = tmp_path / "results.json"
    rows = made({("A", "paddle"): SIX})
    write_results(results, rows[:1])

    def change(before: Sequence[Result]) -> list[Result]:
        return [*before, rows[len(before)]]

    with ThreadPoolExecutor() as pool:
        [*pool.map(lambda _: change_results(results, change), range(5))]
    assert read_results(results) == rows


@pytest.mark.parametrize("place", ["/proc/results.json", "/proc/new/results.json"])
def test_where_results_can_not_be_written_is_told_before_anything_runs(
    command: Command, tmp_path: Path, failing: list[Any], place: str
) -> None:
    answer = command("sweep", study(tmp_path), "--results", place)
    assert answer.code == 2 and "can't be written" in answer.err and failing == []


def test_a_file_of_results_that_is_none_is_told_before_anything_runs(
    command: Command, failing: list[str], tmp_path: Path
) -> None:
    results = tmp_path / "results.json"
    results.write_text("[{}]")
    answer = command("sweep", study(tmp_path), "--results", results)
    assert answer.code == 3 and "not a file of results" in answer.err and failing == []
    assert results.read_text() == "[{}]"


def test_a_shipped_study_is_told_by_its_name(command: Command) -> None:
    answer = command("sweep", "paper/fig6a", "--dry-run", "--seeds", "0")
    assert answer.code == 0 and answer.out.startswith("fig6a: 4 cells: 4 missing\n")
    assert answer.out.endswith("run it: paddlectl sweep paper/fig6a --seeds 0\n")


def test_each_of_its_runs_has_a_process_of_its_own(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hurry(monkeypatch, tmp_path)
    done = command("sweep", study(tmp_path, "hdm"))
    assert done.code == 0 and done.out.startswith("small: 1 cells: 1 finished\n")
    (run,) = Registry.open(tmp_path / "registry").runs()
    assert (run.kind, run.method, run.status) == ("transfer", "hdm", "finished")


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """No job is done but fails; the names of tasks that were asked for."""
    asked: list[str] = []

    def run_jobs(jobs: Any, _: str, tell: Callable[..., None], *__: object) -> list[Failure]:
        failures = []
        for index, job in enumerate(jobs):
            asked.append(job.task if hasattr(job, "task") else job.scenario.name)
            failures.append(Failure(None, PaddlectlError("no")))
            tell(index, failures[-1])
        return failures

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    return asked


def test_what_fails_is_told_at_the_end_and_stops_nothing_else(
    command: Command, failing: list[str], tmp_path: Path
) -> None:
    answer = command("sweep", study(tmp_path))
    assert answer.code == 1
    assert failing == ["BlockedDoor", "GapBall", "A"], "hdm needs no source"
    assert "A paddle seed 0: its source failed: " in answer.err and "A hdm seed 0: no" in answer.err
    assert answer.out == "small: 2 cells: 2 missing\n"


def test_or_stops_all_the_others(command: Command, failing: list[str], tmp_path: Path) -> None:
    answer = command("sweep", study(tmp_path), "--fail-fast", "--json")
    assert answer.code == 1 and failing == ["BlockedDoor"]
    assert [each["job"] for each in answer.json["failed"]] == ["BlockedDoor hdm seed 0"]


def test_one_sweep_at_a_time(command: Command, failing: list[str], tmp_path: Path) -> None:
    registry = Registry.open(tmp_path / "registry")
    with registry.files.sweeping():
        answer = command("sweep", study(tmp_path))
    assert answer.code == 6 and "another sweep runs in" in answer.err and failing == []
    assert command("sweep", study(tmp_path), "--dry-run").code == 0


def test_what_is_wrong_is_told_before_anything_is_made(command: Command, tmp_path: Path) -> None:
    file = study(tmp_path, "padle")
    answer = command("sweep", file)
    assert answer.code == 3 and f"{file}:3:11: unknown method 'padle'" in answer.err
    command("sweep", file, "--results", tmp_path / "new" / "results.json")
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "registry").exists()
    answer = command("sweep", study(tmp_path), "--results", tmp_path)
    assert answer.code == 2 and f"{tmp_path} is a folder" in answer.err
    assert not (tmp_path / "registry").exists()
