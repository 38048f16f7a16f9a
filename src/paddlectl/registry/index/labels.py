"""What users call runs: a name that one run has at most, and tags."""

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select, update

from paddlectl.errors import UsageError
from paddlectl.registry import fields
from paddlectl.registry.files import manifests
from paddlectl.registry.index.entry import manifest_of
from paddlectl.registry.index.queries import find_run
from paddlectl.registry.names import LATEST, is_like_id, number_of, shown
from paddlectl.registry.schema import ROW_TABLES, runs


def row_of(name: str | None, tags: Sequence[str], whose: str = "a run") -> dict[str, Any]:
    """Both as columns; tags in their order, each once.

    Raises:
        UsageError: If one can't be a label; with `whose` it would be.
    """
    row: dict[str, Any] = {"name": name, "tags": list(dict.fromkeys(tags))}
    if (count := len(row["tags"])) > fields.MOST_TAGS:
        raise UsageError(f"{whose} would have {count} tags; {fields.MOST_TAGS} at most", "give fewer tags")
    if wrong := fields.misfit(row, fields.LABELS):
        raise UsageError(wrong, "use at most 64 letters, digits, _ and -")
    if name is not None and (is_like_id(name) or name.casefold() == LATEST):
        raise UsageError(f"no run can be called {name}", "choose another name")
    return {**row, "tags": json.dumps(row["tags"])}


def require_free(connection: Connection, name: str | None, tasks: Collection[str] = (), of: int = 0) -> None:
    """Refuses a name that a run or task has, and tasks whose names runs have.

    Args:
        connection: A transaction.
        name: Of a run.
        tasks: Those that are to be learned.
        of: The number of the run that may have the name already.

    Raises:
        UsageError: If it is one, or one of them is a run's name.
    """
    if name is not None:
        other = connection.scalar(select(runs.c.id).where(runs.c.name == name, runs.c.id != of))
        if other is not None:
            raise UsageError(f"run-{other} is called {shown(name)}", "choose another name")
        if name in tasks or _is_task(connection, name):
            raise UsageError(f"{shown(name)} is a task", "choose another name for the run")
    named = connection.execute(select(runs.c.id, runs.c.name).where(runs.c.name.in_(tasks))).first()
    if named is not None:
        raise UsageError(
            f"run-{named.id} is called {shown(named.name)}, as the task is",
            f"call it otherwise: paddlectl label run-{named.id} --name ''",
        )


def _is_task(connection: Connection, name: str) -> bool:
    """Whether a run or policy is of a task of that name."""
    return any(
        connection.scalar(select(table.c.id).where(table.c.task == name).limit(1)) is not None
        for table in ROW_TABLES.values()
    )


def change(
    folder: Path,
    connection: Connection,
    named: Sequence[str],
    name: str | None,
    tags: Sequence[str],
    untagged: Collection[str],
) -> list[str]:
    """Stores labels with the rows and in the manifests, whose seals stay what they were.

    Args:
        folder: Where the manifests are.
        connection: A writing transaction.
        named: Runs, by id or name.
        name: What the one run shall be called; empty for nothing, None for what it is called.
        tags: To add.
        untagged: To take off.

    Returns:
        The ids of the runs.

    Raises:
        NotFoundError: If there is no such run.
        UsageError: If one can't be a label, or another run or a task has the name.
        IntegrityError: If a manifest isn't what was written.
    """
    found = {run.id: run for run in (find_run(connection, each) for each in named)}
    before = [manifests.read(folder, run) for run in found]
    for run in found.values():
        kept = [tag for tag in (*run.tags, *tags) if tag not in untagged]
        row, number = row_of(name or None, kept, run.id), number_of(run.id, "run") or 0
        if name is None:
            del row["name"]
        require_free(connection, name or None, of=number)
        connection.execute(update(runs).where(runs.c.id == number).values(row))
    done: list[manifests.Manifest] = []
    try:
        for old in before:
            done.append(old)
            now = manifest_of(folder, connection, old.name)
            manifests.write(folder, manifests.Manifest(old.name, now.row, old.files))
    except BaseException:
        for old in done:
            manifests.write(folder, old)
        raise
    return list(found)
