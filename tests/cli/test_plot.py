"""`plot`: what it writes, what it says of it, and what it refuses."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli.similarity import similarity_document
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.spelling import spelled
from paddlectl.studies.cells import Cell
from paddlectl.studies.results import Result, write_results
from paddlectl.tasks.suite import load
from samples import RESULT, ROOT, TARGET, Command, add_policy

EPISODES = [{"order": n, "started": 9 * n, "frames": 9 * n + 9, "score": n / 100} for n in range(100)]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with results."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    write_results(folder / "fig4.json", [replace(RESULT, seed=seed) for seed in range(3)])
    return folder


def test_a_file_of_results_needs_no_registry(command: Command, here: Path) -> None:
    answer = command("plot", "fig4.json")
    assert (answer.code, answer.err) == (0, "")
    assert answer.out.split() == [f"figures/fig4.{kind}" for kind in ("svg", "png", "csv")]
    assert all((here / name).stat().st_size for name in answer.out.split())
    answer = command("plot", here / "fig4.json", "--to", "a/b", "--x", "episodes", "--json")
    assert answer.json == {
        "figure": "fig4-episodes",
        **{kind: f"a/b/fig4-episodes.{kind}" for kind in ("svg", "png", "csv")},
    }
    assert len((here / answer.json["csv"]).read_text().splitlines()) == 1 + 4


def test_a_study_is_drawn_from_its_finished_cells(
    registry: Registry, command: Command, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = ROOT / "scenarios" / "paper" / "fig6a.yaml"
    answer = command("plot", study)
    assert (answer.code, answer.out) == (4, "")
    assert answer.err.splitlines() == [
        f"error: no results in {study}",
        f"run: paddlectl sweep {study} --dry-run",
    ]

    def finished(opened: Registry, cells: Sequence[Cell]) -> list[tuple[Cell, RunRecord]]:
        assert opened.location == registry.location
        return [(cell, opened.run("run-3")) for cell in cells]

    def results_of(_: Registry, runs: Sequence[tuple[Cell, RunRecord]]) -> list[Result]:
        return [replace(RESULT, scenario=c.scenario.name, method=c.method, seed=c.seed) for c, _ in runs]

    monkeypatch.setattr("paddlectl.studies.sweep.finished", finished)
    monkeypatch.setattr("paddlectl.studies.sweep.results_of", results_of)
    answer = command("plot", study, "--json")
    told = (here / answer.json["csv"]).read_text()
    assert answer.json["figure"] == "fig6a" and "finetune" in told and "paddle" in told


def watched(registry: Registry, moments: list[dict[str, Any]]) -> RunRecord:
    """A finished transfer with these moments."""
    of = {"kind": "transfer", "method": "paddle", "task": TARGET, "scenario": "A"}
    run = registry.add_run(**of, sources=["policy-1"], seed=0, settings={}, versions={}).id  # type: ignore[arg-type]
    sources = [registry.policy("policy-1")]
    registry.files.write_document(run, "mapping", similarity_document(load(TARGET), sources, 0.8, 0.2))
    registry.files.append_rows(run, "moments", moments)
    add_policy(registry, run, TARGET, None)
    return registry.finish_run(run, status="finished", frames=9, episodes=1, seconds=1.0, results={})


def test_a_study_of_weights_is_drawn_scene_by_scene(
    registry: Registry, command: Command, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moments = [
        {"frames": frames, "scene": 1, "policy": policy, "weight": weight, "chosen": 4}
        for frames, *weights in ((1000, 0.9, 0.1), (2000, 0.8, 0.7))
        for policy, weight in zip(("policy-1", "target"), weights, strict=True)
    ]
    runs = [watched(registry, moments), watched(registry, [moments[0] | {"scene": 99999}])]
    monkeypatch.setattr("paddlectl.studies.sweep.finished", lambda _, cells: [(cells[0], runs[0])])
    answer = command("plot", ROOT / "scenarios" / "paper" / "fig5.yaml", "--json")
    rows = list(csv.DictReader((here / answer.json["csv"]).open()))
    assert [(row["panel"], row["label"], row["x"], row["mid"]) for row in rows] == [
        ("A", "BlockedDoor", "1000", "0.9"),
        ("A", "BlockedDoor", "2000", "0.8"),
        ("A", "target", "1000", "0.1"),
        ("A", "target", "2000", "0.7"),
    ]
    assert len({row["note"] for row in rows}) == 1 and rows[0]["note"]  # the scene
    monkeypatch.setattr("paddlectl.studies.sweep.finished", lambda _, cells: [(cells[0], runs[1])])
    assert command("plot", ROOT / "scenarios" / "paper" / "fig5.yaml").code == 5


def test_a_run_is_drawn_and_shown_in_a_line(registry: Registry, command: Command, here: Path) -> None:
    registry.files.append_rows("run-1", "episodes", EPISODES)
    answer = command("plot", "run-1")
    assert answer.code == 0
    first, *files = answer.out.splitlines()
    assert first.startswith("score ▁") and first.endswith(" 0.49") and len(first) == len("score  0.49") + 40
    assert files == [f"figures/run-1.{kind}" for kind in ("svg", "png", "csv")]
    assert command("plot", "run-1", "--x", "episodes", "--json").json["figure"] == "run-1-episodes"
    assert spelled(first.replace("▁", "_"), "ascii")


def test_without_matplotlib_it_says_what_to_install(
    command: Command, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    answer = command("plot", "fig4.json")
    assert (answer.code, answer.out) == (1, "")
    assert answer.err.splitlines() == [
        "error: figures need matplotlib, which isn't installed",
        "run: pip install 'paddlectl[plots]'",
    ]
    assert not (here / "figures").exists()


def test_a_notebooks_shell_names_a_backend_that_isnt_needed(
    process: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    done = process("plot", "fig4.json", "--json", MPLBACKEND="module://matplotlib_inline.backend_inline")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["figure"] == "fig4"


@pytest.mark.parametrize(
    ("line", "code", "told"),
    [
        ("fig5.json", 4, "no file fig5.json|did you mean fig4.json? or run: paddlectl plot --help"),
        ("no/fig4.json", 4, "no file no/fig4.json|run: paddlectl plot --help"),
        ("none.json", 4, "no results in none.json"),
        ("broken.json", 3, "broken.json: not a file of results: "),
        ("folder.json", 4, "folder.json is a folder, no study|there are paper/"),
        ("fig4.csv", 2, "fig4.csv is neither a study (.yaml) nor results (.json)|run: paddlectl plot --help"),
        (
            "./fig4",
            4,
            "no file ./fig4, and no study of that name is shipped|did you mean paper/fig4 or paper/fig5",
        ),
        ("run-7", 4, "no run run-7|did you mean run-"),
        ("run-1", 4, "0 episodes of run-1 have ended, too few for a curve over frames|run: paddlectl runs"),
        ("fig4.json --x frame", 2, "Invalid value for '--x': 'frame' is not one of 'frames', 'episodes'."),
        ("fig4.json --to none.json", 2, "none.json is not a folder"),
        ("fig4.json --to none.json/x", 2, "nothing can be written in none.json/x: Not a directory"),
        ("", 2, "Missing argument"),
    ],
)
def test_what_cant_be_drawn_is_told_and_nothing_is_written(
    registry: Registry, command: Command, here: Path, line: str, code: int, told: str
) -> None:
    (here / "none.json").write_text("[]")
    (here / "broken.json").write_text("[{}")
    (here / "folder.json").mkdir()
    before = sorted(here.iterdir())
    answer = command("plot", *line.split())
    assert (answer.code, answer.out) == (code, "")
    lines = answer.err.splitlines()
    assert len(lines) <= 2
    for found, expected in zip(lines, f"error: {told}".split("|"), strict=False):
        assert found.startswith(expected)
    assert sorted(here.iterdir()) == before
