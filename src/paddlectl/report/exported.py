"""A run's tables for other programs: the same rows as CSV, as Parquet, and as TensorBoard's events."""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from itertools import chain
from typing import Any

from paddlectl.errors import PaddlectlError
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

Row = dict[str, Any]
Tables = Mapping[str, Sequence[Row]]

_OLDER = {"success_rate": "latest_success", "mean_score": "latest_score"}
"""What columns of `progress` were called once."""


def tables_of(registry: Registry, run: str) -> dict[str, list[Row]]:
    """The run's tables by name, all rows of one with the same fields; None is what a row lacks.

    Raises:
        IntegrityError: If the run has ended, and they aren't what they were then.
    """
    found = {name: registry.files.read_rows(run, name) for name in registry.files.table_names(run)}
    if "progress" in found:
        found["progress"] = [
            {_OLDER.get(name, name): value for name, value in row.items()} for row in found["progress"]
        ]
    return {name: _filled(rows) for name, rows in found.items()}


def _filled(rows: Sequence[Row]) -> list[Row]:
    fields = dict.fromkeys(chain.from_iterable(rows))
    return [{field: row.get(field) for field in fields} for row in rows]


def files_of(kind: str, run: RunRecord, tables: Tables) -> dict[str, bytes]:
    """The files of one of `KINDS`, by name.

    Raises:
        PaddlectlError: If the package isn't installed that writes them.
    """
    return KINDS[kind](run, tables)


def _csv(run: RunRecord, tables: Tables) -> dict[str, bytes]:
    return {
        f"{name}.csv": _csv_text(rows).encode("utf-8", "backslashreplace") for name, rows in tables.items()
    }


def _csv_text(rows: Sequence[Row]) -> str:
    """Numbers as JSON has them, lists and mappings as JSON, nothing for None."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0] if rows else ())
    for row in rows:
        writer.writerow("" if value is None else _text(value) for value in row.values())
    return text.getvalue()


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _parquet(run: RunRecord, tables: Tables) -> dict[str, bytes]:
    """Lists and mappings are texts, as in CSV."""
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError:
        raise _missing("Parquet needs pyarrow", "parquet") from None

    def column(values: Sequence[Any]) -> Any:
        if not any(isinstance(value, list | dict) for value in values):
            with suppress(arrow.ArrowException, OverflowError):  # of several kinds, or too large
                return arrow.array(values)
        return arrow.array([None if value is None else _text(value) for value in values])

    files = {}
    for name, rows in tables.items():
        columns = {field: column([row[field] for row in rows]) for field in (rows[0] if rows else ())}
        file = io.BytesIO()
        parquet.write_table(arrow.table(columns), file)
        files[f"{name}.parquet"] = file.getvalue()
    return files


def _tensorboard(run: RunRecord, tables: Tables) -> dict[str, bytes]:
    """Every number as a scalar over the frames, with the digits that TensorBoard has: those of a float32.

    What isn't a number in a row, as the scene and the policy, and which scene it is by number, is a part of
    its name.
    """
    try:
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.compat.proto.summary_pb2 import Summary
        from tensorboard.summary.writer.record_writer import RecordWriter
    except ImportError:
        raise _missing("TensorBoard's events need tensorboard", "tensorboard") from None

    began = datetime.fromisoformat(run.created).timestamp()
    file = io.BytesIO()
    writer = RecordWriter(file)
    writer.write(Event(wall_time=began, file_version="brain.Event:2").SerializeToString())
    for name, rows in tables.items():
        for number, row in enumerate(rows):
            values = [Summary.Value(tag=tag, simple_value=value) for tag, value in _scalars(name, row)]
            event = Event(
                wall_time=began + (row.get("seconds") or 0.0),
                step=row.get("frames", number),
                summary=Summary(value=values),
            )
            writer.write(event.SerializeToString())
    return {f"events.out.tfevents.{run.id}": file.getvalue()}


def _scalars(table: str, row: Row) -> Iterator[tuple[str, float]]:
    """Name and value of each number: `weights/chosen/late/has_key(agent)/policy-1`."""
    named = [value for name, value in row.items() if isinstance(value, str | list) or name == "scene"]
    place = "/".join(["", *(",".join(value) if isinstance(value, list) else str(value) for value in named)])
    for name, value in row.items():
        inner = value.items() if isinstance(value, dict) else [("", value)]
        for part, number in inner:
            if isinstance(number, int | float) and name not in ("frames", "scene"):
                yield f"{table}/{name}{part and f'.{part}'}{place}", float(number)


def _missing(what: str, extra: str) -> PaddlectlError:
    return PaddlectlError(f"{what}, which isn't installed", f"run: pip install 'paddlectl[{extra}]'")


KINDS: dict[str, Callable[[RunRecord, Tables], dict[str, bytes]]] = {
    "csv": _csv,
    "parquet": _parquet,
    "tensorboard": _tensorboard,
}
"""How a run can be written into files."""
