"""How a run that ended elsewhere is entered here: with its tables and its policy, wholly or not at all."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, update

from paddlectl.registry.files import documents, layout, manifests, objects
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.index import labels
from paddlectl.registry.index.entry import enter, publish
from paddlectl.registry.index.index import Index
from paddlectl.registry.index.queries import same_runs
from paddlectl.registry.schema import runs


def adopt(
    index: Index,
    run: Mapping[str, Any],
    tables: Mapping[str, bytes],
    policy: Mapping[str, Any] | None,
    checkpoint: bytes,
) -> dict[str, Any]:
    """Enters a run, the files of its folder by name, its policy and the bytes of that one's checkpoint.

    Returns:
        `{run, policy, known}`: the ids, and whether they were here already.

    Raises:
        UsageError: If a run here is called as the task is.
    """
    row = {**run, "resumes": 0}
    for name in ("sources", "settings", "versions", "results"):
        row[name] = documents.to_json(row[name], name)
    folder, learned = index.folder, None
    if policy is not None:
        extra = documents.to_json(policy["metadata"], "metadata")
        with disk_faults(index.shown):
            digest = objects.bring(folder / "objects", checkpoint)
        learned = {**policy, "metadata": extra, "checkpoint": digest}
    with index.writing() as connection:
        for known in same_runs(connection, row, learned):
            if all((folder / "runs" / known["run"] / table).exists() for table in tables):
                return {**known, "known": True}
        labels.require_free(connection, None, [run["task"]])
        published: list[str] = []
        if policy is not None:
            objects.keep(folder / "objects", checkpoint)
        try:
            return _adopt(index, connection, row, tables, learned, published)
        except BaseException:
            _withdraw(folder, published)
            raise


def _adopt(
    index: Index,
    connection: Connection,
    run: Mapping[str, Any],
    tables: Mapping[str, bytes],
    policy: Mapping[str, Any] | None,
    published: list[str],
) -> dict[str, Any]:
    number = enter(index.database, connection, "run", {**run, "status": "running"})
    name = f"run-{number}"
    adopted = {"run": name, "policy": None, "known": False}
    published.append(name)
    publish(index.folder, connection, name)  # as one that goes on, until all of it is there
    run_folder = layout.make_run(index.folder, name)
    for table, data in tables.items():
        objects.write_atomically(run_folder / table, data)
    connection.execute(update(runs).where(runs.c.id == number).values(status=run["status"]))
    if policy is not None:
        learned = f"policy-{enter(index.database, connection, 'policy', {**policy, 'run': number})}"
        adopted["policy"] = learned
        published.append(learned)
        publish(index.folder, connection, learned)
    publish(index.folder, connection, name)
    return adopted


def _withdraw(folder: Path, names: Sequence[str]) -> None:
    """Takes back the manifests and folders of rows that weren't committed."""
    for name in reversed(names):
        run_folder = folder / "runs" / name
        shutil.rmtree(run_folder, ignore_errors=True)
        if not run_folder.exists():  # else the manifest tells `gc` of it
            manifests.path_of(folder, name).unlink(missing_ok=True)
