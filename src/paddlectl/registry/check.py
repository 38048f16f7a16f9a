"""`registry check`: everything that the registry holds against everything that it says of it.

Nothing is changed. Structure is quick: rows, manifests, that each file is there and has its size. The data
are all bytes, by their SHA-256.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, inspect, select

from paddlectl.errors import IntegrityError, InvalidFileError, NotFoundError, PaddlectlError
from paddlectl.logic.syntax import parse_program
from paddlectl.registry import identity, layout, manifests
from paddlectl.registry.database import Database, require_current, stamp
from paddlectl.registry.faults import faults
from paddlectl.registry.files import OBJECT, check_contents, check_files
from paddlectl.registry.findings import Report, entries, inside
from paddlectl.registry.manifests import Manifest
from paddlectl.registry.names import ELSEWHERE, is_id
from paddlectl.registry.records import RUN_STATES
from paddlectl.registry.schema import REVISIONS, metadata, policy_record, run_records
from paddlectl.registry.store import database_of

_RATES = ("success_rate", "crispness")


def check(location: str | Path, *, read_data: bool = False) -> Report:
    """Examines a registry.

    Raises:
        NotFoundError: If there is none.
        SchemaVersionError: If a newer paddlectl wrote it.
        IntegrityError: If its folder isn't its own.
    """
    index = database_of(location)
    report = Report()
    with faults(index.shown):
        if not index.exists():
            identity.require_unowned(index)
            _missing_index(report, index)
            _read_manifests(report, index.folder)
            check_files(report, index.folder)
        else:
            _under_lock(report, index)
        if read_data and not report.older:
            check_contents(report, index.folder)
    return report


def _under_lock(report: Report, index: Database) -> None:
    with _looked_into(report, index) as connection:
        if connection is not None:
            _require_own_folder(index, connection)
            _index(report, index, connection)
        if report.older:  # and has no manifests yet
            return
        _read_manifests(report, index.folder)
        if connection is not None:
            _agreement(report, index.folder)
        check_files(report, index.folder)


@contextmanager
def _looked_into(report: Report, index: Database) -> Iterator[Connection | None]:
    """A transaction that keeps writers waiting; None if the index can't be read."""
    try:
        with faults(index.shown):
            for what in index.faults():
                report.add("damaged index", index.file, what)
        engine = index.writing() if os.access(index.folder, os.W_OK) else index.reading()
        with faults(index.shown):
            connection = engine.connect()
            connection.begin()
    except IntegrityError as error:
        report.add("damaged index", index.file, error.message)
        yield None
        return
    with connection:
        yield connection


def _require_own_folder(index: Database, connection: Connection) -> None:
    """Unless the index can't tell, which is found as damage, or is older."""
    found = None
    with suppress(IntegrityError), faults(index.shown):
        if inspect(connection).has_table("identity"):
            found = identity.of_index(connection)
    if found is not None:
        identity.require(index, found)


def _missing_index(report: Report, index: Database) -> None:
    try:
        layout.refuse_orphans(index.folder)
    except IntegrityError as error:
        report.add("missing index", index.file, error.message)
        return
    raise NotFoundError(f"no registry at {index.shown}", "run: paddlectl train BoxDoor")


# The index


def _index(report: Report, index: Database, connection: Connection) -> None:
    try:
        with faults(index.shown):
            found = stamp(connection, index.file)
            if found not in REVISIONS:
                require_current(connection, index.file)
            if found != REVISIONS[-1]:
                report.add(
                    "older schema", index.file, f"schema {found}: the next use upgrades it", fault=False
                )
                return
            _tables(report, index, connection)
            report.readable = True
    except IntegrityError as error:
        report.add("damaged index", index.file, error.message)


def _tables(report: Report, index: Database, connection: Connection) -> None:
    there = inspect(connection)
    known = set(there.get_table_names())
    for table in metadata.sorted_tables:
        if table.name not in known:
            raise IntegrityError(f"the table {table.name} is missing")
        if lost := {c.name for c in table.columns} - {c["name"] for c in there.get_columns(table.name)}:
            raise IntegrityError(f"the table {table.name} lacks the column {min(lost)}")
        if {str(i.name) for i in table.indexes} - {str(i["name"]) for i in there.get_indexes(table.name)}:
            report.add("missing database index", index.file, f"an index of {table.name} is missing")
    if identity.of_index(connection) is None:
        raise IntegrityError("it doesn't say which folder is its own")
    for kind, table in layout.ROW_TABLES.items():
        for row in connection.execute(select(table)):
            values = dict(zip(table.columns.keys(), row, strict=True))
            report.rows[f"{kind}-{values['id']}"] = values
    for name in list(report.rows):
        _row(report, name)


def _row(report: Report, name: str) -> None:
    """What can be wrong with one row by itself, and with what it refers to."""
    row = report.rows[name]
    try:
        if name.startswith("run-"):
            run = run_records([[*row.values(), None]])[0]
            _run_row(report, name, row, run.sources)
        else:
            policy_record(list(row.values()))
            _policy_row(report, name, row)
    except IntegrityError as error:
        report.add("damaged row", name, error.message)


def _run_row(report: Report, name: str, row: dict[str, Any], sources: Iterable[str]) -> None:
    if row["status"] not in RUN_STATES:
        report.add("impossible row", name, f"a run is never {row['status']!r}")
    if min(row["frames"], row["episodes"], row["seconds"], row["resumes"]) < 0:
        report.add("impossible row", name, "a count below zero")
    for source in sources:
        if not str(source).startswith(ELSEWHERE) and source not in report.rows:
            report.add("missing source", name, f"its source {source} isn't there")


def _policy_row(report: Report, name: str, row: dict[str, Any]) -> None:
    if f"run-{row['run']}" not in report.rows:
        report.add("missing run", name, f"its run run-{row['run']} isn't there")
    if not all(0.0 <= row[rate] <= 1.0 for rate in _RATES):
        report.add("impossible row", name, "a rate outside [0, 1]")
    if not OBJECT.fullmatch(f"{row['checkpoint']}.safetensors"):
        report.add("impossible row", name, "its checkpoint is no SHA-256")
    try:
        parse_program(row["program"])
    except InvalidFileError as error:
        report.add("damaged program", name, f"its program can't be read: {error.message}")


# Manifests


def _read_manifests(report: Report, folder: Path) -> None:
    for path in entries(folder / manifests.FOLDER):
        if path.name.endswith(".part"):
            report.add("leftover", inside(folder, path), "a writer was stopped", fault=False)
        elif path.suffix != ".json" or not is_id(path.stem):
            report.add("stray file", inside(folder, path), "nothing of the registry's is called so")
        else:
            _collect(report, folder, path.stem)


def _collect(report: Report, folder: Path, name: str) -> None:
    try:
        with faults(str(folder)):
            report.manifests[name] = manifests.read(folder, name)
    except PaddlectlError as error:
        report.add("damaged manifest", name, error.message)


def _agreement(report: Report, folder: Path) -> None:
    """Rows against manifests; nobody writes meanwhile."""
    if not report.readable:
        return
    for name, row in report.rows.items():
        manifest = report.manifests.get(name)
        if manifest is None and not manifests.path_of(folder, name).exists():
            report.add("missing manifest", name, "its manifest is missing")
        elif manifest is not None and manifest.row != row and not _ended_amid(row, manifest, folder):
            report.add("other row", name, "the index and the manifest don't say the same")
        if row.get("status") == "running" and not layout.is_held(folder / "runs" / name):
            what = f"no process goes on with it; run: paddlectl resume {name}"
            report.add("stopped run", name, what, fault=False)
    for name, manifest in report.manifests.items():
        if name not in report.rows:
            _lost_row(report, folder, name, manifest)


def _ended_amid(row: dict[str, Any], manifest: Manifest, folder: Path) -> bool:
    """Whether the process died between a run's manifest and its row: what neither can know differs."""
    changing = {"status", "frames", "episodes", "seconds", "results", "finished", "resumes"}
    told = manifest.row
    fixed = {k: v for k, v in row.items() if k not in changing}
    died = "running" in (row.get("status"), told.get("status"))
    return died and fixed == {k: v for k, v in told.items() if k not in changing}


def _lost_row(report: Report, folder: Path, name: str, manifest: Manifest) -> None:
    """A manifest without a row: what was published is lost, or a process died before it had published."""
    run = name if name.startswith("run-") else f"run-{manifest.row.get('run')}"
    row, told = report.rows.get(run), report.manifests.get(run)
    if row is not None:
        died = row["status"] != "finished"
    else:
        died = told is not None and told.row.get("status") == "running" and not _began(folder / "runs" / run)
    if died:
        report.add("leftover", name, "its process died before it was entered", fault=False)
    else:
        report.add("lost row", name, "it has a manifest, but isn't in the index")


def _began(run: Path) -> bool:
    """Whether a process has held the run: after it was entered, then."""
    return (run / "lock").exists() or (run / "checkpoints").exists()
