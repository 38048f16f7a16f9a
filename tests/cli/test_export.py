"""`export`: every form of a run's tables tells the same."""

import csv
import json
import struct
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

from paddlectl.registry.store import Registry
from samples import Command, body, weight_rows

ROWS: dict[str, list[dict[str, Any]]] = {
    "episodes": [
        {"order": n, "started": 9 * n, "frames": 9 * n + 9, "score": 0.1 + n / 3, "success": n > 1}
        for n in range(3)
    ],
    "progress": [
        {"frames": 100, "episodes": 2, "seconds": 0.1, "latest_success": None, "latest_score": None},
        {"frames": 200, "episodes": 5, "seconds": 0.3, "latest_success": 1 / 3, "latest_score": 1, "x": 0.5},
    ],
    "moments": [
        {"frames": 100, "scene": 3, "policy": "policy-1", "similarity": 0.5, "weight": 1.25, "chosen": 7},
        {"frames": 100, "scene": 3, "policy": "target", "similarity": 0.7, "weight": 0.75, "chosen": 0},
    ],
    "reuse": [
        {
            "frames": 100, "context": body("GapBall", "E"), "source": "policy-2",
            "terms": {"advantage": 0.125}, "weight": -1.5, "chosen": 3, "reached": None,
        },
    ],
}  # fmt: skip
KEYS = {"phase", "scene", "policy", "task", "context", "source"}


@pytest.fixture
def tables(registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """run-3's tables: those of a run by any method at once."""
    monkeypatch.chdir(tmp_path)
    for name, rows in ROWS.items():
        registry.files.append_rows("run-3", name, rows)
    with registry.index.writing() as connection:
        from paddlectl.registry.index.entry import publish

        publish(registry.folder, connection, "run-3")
    more = [{"x": None, **row} for row in ROWS["progress"]]
    return {**ROWS, "progress": more, "weights": weight_rows()}


def alike(found: Any, tables: Any) -> bool:
    return {name: [dict(row) for row in rows] for name, rows in found.items()} == tables


def of_text(text: str) -> Any:
    """A cell of CSV."""
    if text in ("", "true", "false") or text[0] in "-0123456789[{":
        return json.loads(text or "null")
    return text


def test_json_is_all_of_it(tables: Any, command: Command) -> None:
    answer = command("export", "run-3", "--json")
    assert (answer.code, answer.err) == (0, "")
    assert list(answer.json) == ["run", "tables", "files"]
    assert alike(answer.json["tables"], tables)
    assert answer.json["run"] == command("runs", "--json").json["runs"][0]
    assert answer.json["files"] == [] and not Path("data").exists()


def test_csv_tells_the_same(tables: Any, command: Command) -> None:
    answer = command("export", "run-3")
    assert (answer.code, answer.err) == (0, "")
    assert answer.out.split() == [f"data/run-3/{name}.csv" for name in sorted(tables)]
    found = {}
    for name, path in zip(sorted(tables), answer.out.split(), strict=True):
        rows = csv.DictReader(Path(path).read_text().splitlines())
        found[name] = [{k: of_text(v) for k, v in row.items()} for row in rows]
    assert alike(found, tables)
    again = command("export", "run-3", "--csv", "--to", "a/b", "--json").json
    assert again["files"] == [f"a/b/run-3/{name}.csv" for name in sorted(tables)]


def test_parquet_tells_the_same(tables: Any, command: Command) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    paths = command("export", "run-3", "--parquet").out.split()
    assert paths == [f"data/run-3/{name}.parquet" for name in sorted(tables)]
    found = {}
    for name, path in zip(sorted(tables), paths, strict=True):
        nested = {k for row in tables[name] for k, value in row.items() if isinstance(value, list | dict)}
        rows = parquet.read_table(path).to_pylist()
        found[name] = [{k: json.loads(v) if k in nested else v for k, v in row.items()} for row in rows]
    assert alike(found, tables)


def test_parquet_takes_columns_of_several_kinds(registry: Registry, tmp_path: Path, command: Command) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    run = registry.add_run(
        kind="train",
        method="lean",
        task="GapBall",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )
    mixed: list[Any] = [1, "a", None, 2**70, [1], True]
    registry.files.append_rows(run.id, "own", [{"mixed": value, "none": None} for value in mixed])
    command("export", run.id, "--parquet", "--to", tmp_path)
    found = parquet.read_table(tmp_path / run.id / "own.parquet").to_pydict()
    assert found == {"mixed": ["1", "a", None, str(2**70), "[1]", "true"], "none": [None] * 6}


def test_tensorboard_tells_the_same_numbers(tables: Any, command: Command, registry: Registry) -> None:
    """Over the frames, by as many digits as it has."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    (path,) = command("export", "run-3", "--tensorboard").out.split()
    assert "tfevents" in path
    assert command("export", "run-3", "--tensorboard").code == 0, "it takes the place of the first"
    read = accumulator.EventAccumulator("data/run-3", {"scalars": 0})
    read.Reload()
    found = {tag: [(e.step, e.value) for e in read.Scalars(tag)] for tag in read.Tags()["scalars"]}
    expected: dict[str, list[tuple[int, float]]] = defaultdict(list)
    for table, rows in tables.items():
        for row in rows:
            told = [",".join(v) if isinstance(v, list) else str(v) for k, v in row.items() if k in KEYS]
            flat = {k: v for k, v in row.items() if not isinstance(v, dict)}
            flat |= {
                f"{k}.{part}": v for k, inner in row.items() if k not in flat for part, v in inner.items()
            }
            for name, value in flat.items():
                if isinstance(value, int | float) and name not in (*KEYS, "frames"):
                    (rounded,) = struct.unpack("f", struct.pack("f", value))
                    expected["/".join([table, name, *told])].append((row["frames"], rounded))
    assert found == expected
    assert found["progress/latest_success"] == [(200, pytest.approx(1 / 3))]


def test_older_progress_has_todays_names(registry: Registry, command: Command) -> None:
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="GapBall",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )
    registry.files.append_rows(run.id, "progress", [{"frames": 1, "success_rate": 0.5, "mean_score": 0.4}])
    registry.files.append_rows(run.id, "progress", [{"frames": 2, "latest_success": 1, "latest_score": 0.9}])
    assert command("export", run.id, "--json").json["tables"]["progress"] == [
        {"frames": 1, "latest_success": 0.5, "latest_score": 0.4},
        {"frames": 2, "latest_success": 1, "latest_score": 0.9},
    ]


def test_a_run_without_tables(registry: Registry, command: Command) -> None:
    assert command("export", "run-1").out == "run-1 has no tables\n"
    assert command("export", "run-1", "--json").json["tables"] == {}


@pytest.mark.parametrize(
    ("package", "what"),
    [("pyarrow", "Parquet needs pyarrow"), ("tensorboard", "TensorBoard's events need tensorboard")],
)
def test_what_isnt_installed_is_asked_for_and_nothing_is_written(
    tables: Any, command: Command, monkeypatch: pytest.MonkeyPatch, package: str, what: str
) -> None:
    for name in (package, "tensorboard.compat.proto.event_pb2"):
        monkeypatch.setitem(sys.modules, name, None)
    extra = {"pyarrow": "parquet", "tensorboard": "tensorboard"}[package]
    answer = command("export", "run-3", "--csv", f"--{extra}")
    assert (answer.code, answer.out) == (1, "")
    assert answer.err.splitlines() == [
        f"error: {what}, which isn't installed",
        f"run: pip install 'paddlectl[{extra}]'",
    ]
    assert not Path("data").exists()


def test_what_cant_be_exported(tables: Any, command: Command) -> None:
    Path("file").write_text("")
    for line, code, told in (
        ("run-9", 4, "run: paddlectl runs"),
        ("policy-1", 4, "run: paddlectl runs"),
        ("run-3 --to file", 2, "file is not a folder"),
    ):
        answer = command("export", *line.split())
        assert (answer.code, answer.out) == (code, "") and told in answer.err
    assert Path("file").read_text() == ""
