"""`registry check`: everything that the registry holds against everything that it says of it.

Nothing is changed. Structure is quick: rows, manifests, that each file is there and has its size. The data
are all bytes, by their SHA-256.
"""

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, inspect, select

from paddlectl.errors import IntegrityError, InvalidFileError, NotFoundError, PaddlectlError
from paddlectl.logic.syntax import parse_program
from paddlectl.registry.care import tombstones
from paddlectl.registry.care.files import (
    OBJECT,
    Rows,
    check_contents,
    files_of,
    objects_of,
    other_file,
    other_files,
)
from paddlectl.registry.care.findings import Finding, Report, entries
from paddlectl.registry.fields import LABELS
from paddlectl.registry.files import layout, manifests
from paddlectl.registry.files.manifests import Manifest
from paddlectl.registry.files.runfiles import goes_on
from paddlectl.registry.index import identity
from paddlectl.registry.index.database import Database, require_current, stamp
from paddlectl.registry.index.faults import faults
from paddlectl.registry.index.location import database_of
from paddlectl.registry.index.queries import rows_of
from paddlectl.registry.names import ELSEWHERE, is_id, number_of
from paddlectl.registry.records import RUN_STATES
from paddlectl.registry.schema import REVISIONS, metadata, policy_record, run_records, runs

Found = dict[str, list[Finding]]

_RATES = ("success_rate", "crispness")
_TURN = 0.3  # seconds for which others are kept from writing, beside the reading of the rows
_PAUSE = 0.2  # seconds in which they may
_LOOKS = 3


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
        if index.exists():
            _require_own_folder(index)
            _index(report, index)
        else:
            identity.require_unowned(index)
            _missing_index(report, index)
        if report.older:  # and has no manifests yet
            return report
        found = _look(report, index.folder)
        if report.readable:
            _look_again(report, index, found)
        report.findings += dict.fromkeys(finding for told in found.values() for finding in told)
        _stopped_runs(report, index)
        if read_data:
            check_contents(report, index.folder)
    return report


def _require_own_folder(index: Database) -> None:
    """Unless the index can't tell, which is found as damage."""
    found, older = None, False
    with suppress(IntegrityError), faults(index.shown), index.reading().begin() as connection:
        older = stamp(connection, index.file) in REVISIONS[:-1]
        if inspect(connection).has_table("identity"):
            found = identity.of_index(connection)
    if older:
        with faults(index.shown), index.reading().begin() as connection:
            identity.require_before_upgrade(index, connection)
    elif found is not None:
        identity.require(index, found)


def _missing_index(report: Report, index: Database) -> None:
    try:
        layout.refuse_orphans(index.folder)
    except IntegrityError as error:
        report.add("missing index", index.file, error.message)
        return
    raise NotFoundError(f"no registry at {index.shown}", "run: paddlectl train BoxDoor")


# The index


def _index(report: Report, index: Database) -> None:
    try:
        with faults(index.shown):
            for what in index.faults():
                report.add("damaged index", index.file, what)
            with index.reading().begin() as connection:
                found = stamp(connection, index.file)
                if found not in REVISIONS:
                    require_current(connection, index.file)
                if found != REVISIONS[-1]:
                    what = f"schema {found}: the next use upgrades it"
                    report.add("older schema", index.file, what, fault=False)
                    return
                _tables(report, index, connection)
                report.rows = rows_of(connection)
            report.readable = True
            for name in report.rows:
                _row(report, name)
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


def _row(report: Report, name: str) -> None:
    """What can be wrong with one row by itself, and with what it refers to."""
    row = report.rows[name]
    try:
        if name.startswith("run-"):
            run = run_records([[*row.values(), None, None]])[0]
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
    if not all(row[rate] is None or 0.0 <= row[rate] <= 1.0 for rate in _RATES):
        report.add("impossible row", name, "a rate outside [0, 1]")
    if not OBJECT.fullmatch(f"{row['checkpoint']}.safetensors"):
        report.add("impossible row", name, "its checkpoint is no SHA-256")
    try:
        parse_program(row["program"] or "")
    except InvalidFileError as error:
        report.add("damaged program", name, f"its program can't be read: {error.message}")


# Rows, manifests and files, one thing after another while others write


def _look(report: Report, folder: Path) -> Found:
    """What is found at each run, policy and other file; none is left out in which nothing is found."""
    rows = report.rows
    names = {*rows, *manifests.names(folder)}
    names |= {path.name for path in entries(folder / "runs") if number_of(path.name, "run")}
    names -= tombstones.dead(folder, rows)
    found = {
        name: _look_at(report, folder, name, rows.get(name), rows) for name in sorted(names, reverse=True)
    }  # runs before policies
    objects = objects_of(report, rows)
    return found | {path: list(other_file(folder, path, objects)) for path in other_files(folder)}


def _look_again(report: Report, index: Database, found: Found) -> None:
    """Where something was found, others may have been at it: it is looked at while nobody writes.

    Who may not write here can't keep others from it, and looks a few times instead.
    """
    alone = os.access(index.folder, os.W_OK)
    for _ in range(1 if alone else _LOOKS):
        left = [name for name in found if found[name]]
        while left:
            with (index.writing() if alone else index.reading()).begin() as connection:
                left = _looked_at(report, index.folder, found, left, rows_of(connection))
            if left or not alone:
                time.sleep(_PAUSE)


def _looked_at(
    report: Report, folder: Path, found: Found, left: list[str], rows: dict[str, dict[str, Any]]
) -> list[str]:
    """Looks at some of what is left, for a moment; gives the rest."""
    until, dead = time.monotonic() + _TURN, tombstones.dead(folder, rows)
    for done, name in enumerate(left):
        if done and time.monotonic() > until:
            return left[done:]
        if not is_id(name):
            found[name] = list(other_file(folder, name, objects_of(report, rows)))
            continue
        report.rows.pop(name, None)
        if name in dead:
            report.manifests.pop(name, None)
            found[name] = []
            continue
        if name in rows:
            report.rows[name] = rows[name]
        found[name] = _look_at(report, folder, name, rows.get(name), rows)
    return []


def _look_at(
    report: Report, folder: Path, name: str, row: Mapping[str, Any] | None, rows: Rows
) -> list[Finding]:
    report.manifests.pop(name, None)
    found: list[Finding] = []
    try:
        with faults(str(folder)):
            report.manifests[name] = manifests.read(folder, name)
    except PaddlectlError as error:
        if manifests.path_of(folder, name).exists():
            found.append(Finding("damaged manifest", name, error.message))
    if report.readable:
        found += _agreement(report, folder, name, row, rows)
    return found + list(files_of(report, folder, name, row))


def _agreement(
    report: Report, folder: Path, name: str, row: Mapping[str, Any] | None, rows: Rows
) -> Iterator[Finding]:
    """Row against manifest."""
    manifest = report.manifests.get(name)
    if row is None:
        if manifest is not None:
            yield _lost_row(report, folder, name, manifest, rows)
    elif manifest is None:
        if not manifests.path_of(folder, name).exists():
            yield Finding("missing manifest", name, "its manifest is missing")
    elif manifest.row != row and not _ended_amid(row, manifest):
        if _without_labels(manifest.row) == _without_labels(row):
            yield Finding("other labels", name, "the index and the manifest call it differently", fault=False)
        else:
            yield Finding("other row", name, "the index and the manifest don't say the same")


def _without_labels(row: Mapping[str, Any]) -> dict[str, Any]:
    return {column: value for column, value in row.items() if column not in LABELS}


def _stopped_runs(report: Report, index: Database) -> None:
    """Runs that are said to go on, but no process does: neither before nor after the row was read."""

    def left(names: Iterable[str]) -> list[str]:
        return [name for name in names if not goes_on(index.folder, name)]

    stopped = left(name for name, row in report.rows.items() if row.get("status") == "running")
    if stopped:
        with index.reading().begin() as connection:
            running = select(runs.c.id).where(runs.c.status == "running")
            known = {f"run-{number}" for number in connection.scalars(running)}
        for name in left(name for name in stopped if name in known):
            what = f"no process goes on with it; run: paddlectl resume {name}"
            report.add("stopped run", name, what, fault=False)


def _ended_amid(row: Mapping[str, Any], manifest: Manifest) -> bool:
    """Whether the process died between a run's manifest and its row: what neither can know differs."""
    changing = {"status", "frames", "episodes", "seconds", "results", "finished", "resumes"}
    told = manifest.row
    fixed = {k: v for k, v in row.items() if k not in changing}
    died = "running" in (row.get("status"), told.get("status"))
    return died and fixed == {k: v for k, v in told.items() if k not in changing}


def _lost_row(report: Report, folder: Path, name: str, manifest: Manifest, rows: Rows) -> Finding:
    """A manifest without a row: what was published is lost, or a process died before it had published."""
    run = name if name.startswith("run-") else f"run-{manifest.row.get('run')}"
    row, told = rows.get(run), report.manifests.get(run)
    if row is not None:
        died = row["status"] != "finished"
    else:
        died = told is not None and told.row.get("status") == "running" and not _began(folder / "runs" / run)
    if died:
        return Finding("leftover", name, "its process died before it was entered", fault=False)
    return Finding("lost row", name, "it has a manifest, but isn't in the index")


def _began(run: Path) -> bool:
    """Whether a process has held the run: after it was entered, then."""
    return (run / "lock").exists() or (run / "checkpoints").exists()
