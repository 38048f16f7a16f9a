"""Every command's `--json` is what its schema and docs/json.md say: no field comes or goes unnoticed."""

import copy
import gzip
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import typer

from paddlectl.cli.app import COMMANDS, make_app
from paddlectl.registry.bundles import bundles
from paddlectl.registry.store import Registry
from paddlectl.studies.results import write_results
from released import BUNDLES
from samples import ROOT, TARGET, Answer, Command, body
from schemas import FOLDER, misfits, require_row, schema_of
from studies.made import SIX, moved, results

sys.path.insert(0, str(ROOT / "docs"))
import fields

TRAINED = {
    "run": "run-9", "policy": "policy-9", "task": "BoxDoor", "method": "hdm", "seed": 0, "frames": 1,
    "episodes": 1, "seconds": 1.0, "success_rate": 1.0, "mean_score": 1.0, "crispness": 1.0,
}  # fmt: skip
TRANSFERRED = {
    "run": "run-9", "policy": "policy-9", "method": "paddle", "sources": ["policy-1"], "seed": 0, "frames": 1,
    "episodes": 1, "seconds": 1.0, "jump_start": 0.0, "final_score": 0.0, "final_success": 0.0,
    "area_under_curve": 0.0, "success_rate": 1.0,
}  # fmt: skip


@pytest.fixture
def fits(command: Command, registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs a command line and holds what it prints to the schema of a command."""
    monkeypatch.chdir(tmp_path)

    def run(name: str, line: str = "", code: int = 0) -> Any:
        answer: Answer = command(*name.split(), *line.split(), "--json")
        assert answer.code == code, answer.err
        assert misfits(answer.json, schema_of(name)) == []
        return answer.json

    return run


def test_what_reads(fits: Any, registry: Registry) -> None:
    reused = {
        "frames": 1, "context": body("GapBall", "E"), "source": "policy-2", "terms": {"advantage": 0.1},
        "weight": 0.5, "chosen": 1, "reached": None,
    }  # fmt: skip
    run = registry.add_run(
        kind="transfer", method="cup", task=TARGET, scenario="A", sources=["policy-2"], seed=0, settings={},
        versions={},
    )  # fmt: skip
    registry.files.append_rows(run.id, "reuse", [reused])
    registry.files.write_document(run.id, "start", {"scores": {"policy-2": 0.5}})
    for name, line in (
        ("tasks", ""), ("policies", ""), ("runs", ""), ("show", "GapBall"), ("explain", "run-3"),
        ("similarity", f"--target {TARGET}"), ("export", "run-3 --csv"), ("export", "run-1"),
    ):  # fmt: skip
        assert fits(name, line)
    assert fits("label", f"{run.id} --name first --tag a")["runs"][0]["tags"] == ["a"]
    assert fits("explain", "first")["program"] is None
    assert fits("export", run.id)["tables"]["reuse"]


def test_what_cares_for_the_registry(fits: Any, registry: Registry) -> None:
    (registry.folder / "objects" / f"{'0' * 64}.safetensors").write_bytes(b"left")
    assert fits("registry check", "--read-data")["findings"]
    assert fits("registry gc", "--older-than 0")["removed"]
    fits("registry export", "run-3 run.zip")
    fits("registry import", "run.zip --registry other")
    fits("registry upgrade")
    assert fits("registry delete", "run-3 --yes")["deleted"]
    next((registry.folder / "objects").iterdir()).unlink()
    assert fits("registry check", code=5)["findings"]
    assert fits("registry repair", code=5)["lost"]


def test_what_plays(fits: Any, tmp_path: Path) -> None:
    bundle = tmp_path / "BoxDoor.zip"
    bundle.write_bytes(gzip.decompress((BUNDLES / "BoxDoor-0002.zip.gz").read_bytes()))
    bundles.import_(lambda: Registry.open(tmp_path / "other"), bundle)
    fits("evaluate", "BoxDoor --episodes 2 --registry other")
    fits("watch", "BoxDoor --gif episode.gif --registry other")


@pytest.mark.parametrize(
    ("name", "line", "row"),
    [
        ("train", "BoxDoor", TRAINED),
        ("transfer", f"{ROOT / 'scenarios' / 'A.yaml'} --seed 0", TRANSFERRED),
        ("resume", "run-4", TRANSFERRED),
        ("resume", "run-4", TRAINED),
    ],
)
def test_what_learns(
    fits: Any, registry: Registry, monkeypatch: pytest.MonkeyPatch, name: str, line: str, row: dict[str, Any]
) -> None:
    """Real rows are held to the same schemas where there are some."""
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="BoxDoor",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )
    registry.finish_run(run.id, status="interrupted", frames=1, episodes=0, seconds=1.0, results={})

    def run_jobs(jobs: Sequence[Any], *_: object) -> list[Any]:
        return [row for _ in jobs]

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    fits(name, line)
    require_row(row, name)


def test_what_compares(fits: Any, tmp_path: Path) -> None:
    places = [("A", "paddle"), ("A", "hdm"), ("B", "paddle"), ("B", "hdm")]
    write_results(tmp_path / "many.json", results({cell: moved(0.1 * n) for n, cell in enumerate(places)}))
    write_results(tmp_path / "one.json", results({("A", "paddle"): SIX[:1], ("A", "hdm"): SIX[:1]}))
    write_results(tmp_path / "never.json", results({("A", "paddle"): [0.1, 0.2], ("A", "hdm"): [0.1, 0.3]}))
    for file in ("many.json", "one.json", "never.json"):
        fits("compare", file)
    pytest.importorskip("matplotlib")
    fits("plot", "many.json")


def test_a_study(fits: Any) -> None:
    assert fits("sweep", f"{ROOT / 'scenarios' / 'paper' / 'fig3.yaml'} --dry-run --seeds 0")["cells"]


def test_every_command_that_prints_json_has_a_schema_and_a_place_in_the_page() -> None:
    commands = typer.main.get_command(make_app(COMMANDS)).commands  # type: ignore[attr-defined]
    registry = commands.pop("registry").commands
    all_ = commands | {f"registry {name}": each for name, each in registry.items()}
    printing = {name for name, each in all_.items() if any(one.name == "as_json" for one in each.params)}
    assert (
        printing
        == fields.schemas().keys()
        == {path.stem.replace("registry-", "registry ") for path in FOLDER.iterdir()}
    )
    assert fields.PAGE.read_text(encoding="utf-8") == fields.page(), "run: python docs/fields.py"


def test_a_field_more_or_less_or_of_another_kind_is_noticed() -> None:
    schema = schema_of("transfer")
    document: Any = {"scenario": "A", "target": TARGET, "runs": [TRANSFERRED], "failed": []}
    assert misfits(document, schema) == []
    for change, told in (
        ({"mean_score": 1.0}, ".runs[0]: has mean_score, which no schema tells"),
        ({"success_rate": None}, ".runs[0].success_rate: None is no number"),
        ({"seed": True}, ".runs[0].seed: True is no integer"),
    ):
        changed = copy.deepcopy(document)
        changed["runs"][0] |= change
        assert misfits(changed, schema) == [told]
    del document["failed"]
    assert misfits(document, schema) == [": lacks failed"]
