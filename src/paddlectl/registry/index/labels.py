"""What users call runs: a name that one run has at most, and tags."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select, update

from paddlectl.errors import UsageError
from paddlectl.registry import fields
from paddlectl.registry.files import manifests
from paddlectl.registry.index.entry import manifest_of
from paddlectl.registry.names import is_id, number_of, shown
from paddlectl.registry.records import RunRecord
from paddlectl.registry.schema import runs

RESERVED = ("latest",)


def row_of(name: str | None, tags: Sequence[str]) -> dict[str, Any]:
    """Both as columns; tags in their order, each once.

    Raises:
        UsageError: If one can't be a label.
    """
    row: dict[str, Any] = {"name": name, "tags": list(dict.fromkeys(tags))}
    if wrong := fields.misfit(row, fields.LABELS):
        raise UsageError(wrong, f"use at most 64 letters, digits, _ and -; {fields.MOST_TAGS} tags at most")
    if name is not None and (is_id(name) or name in RESERVED):
        raise UsageError(f"no run can be called {name}", "choose another name")
    return {**row, "tags": json.dumps(row["tags"])}


def require_free(connection: Connection, name: str | None, of: int = 0) -> None:
    """Refuses the name of another run than the one of that number.

    Raises:
        UsageError: If it is one.
    """
    other = connection.scalar(select(runs.c.id).where(runs.c.name == name, runs.c.id != of))
    if name is not None and other is not None:
        raise UsageError(f"run-{other} is called {shown(name)}", "choose another name")


def put(folder: Path, connection: Connection, run: RunRecord, name: str | None, tags: Sequence[str]) -> None:
    """Stores both with the row and in the manifest, whose seals stay what they were.

    Raises:
        UsageError: If one can't be a label, or another run has the name.
    """
    number, row = number_of(run.id, "run") or 0, row_of(name, tags)
    require_free(connection, name, number)
    connection.execute(update(runs).where(runs.c.id == number).values(row))
    before, now = manifests.read(folder, run.id), manifest_of(folder, connection, run.id)
    manifests.write(folder, manifests.Manifest(run.id, now.row, before.files))
