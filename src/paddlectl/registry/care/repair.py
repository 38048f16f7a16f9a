"""`registry repair`: makes the index again from manifests and objects. It tells all that it does.

Nothing is thrown away: a damaged index stays beside the new one; what can't be used is moved into `aside/`.
Rows that can't be kept leave the index only if that was asked for.
"""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, insert, update

from paddlectl.errors import IntegrityError
from paddlectl.registry.care import tombstones
from paddlectl.registry.care.check import check
from paddlectl.registry.care.findings import Finding, Report
from paddlectl.registry.files import layout, manifests
from paddlectl.registry.files.rights import make_folder
from paddlectl.registry.index.entry import manifest_of, publish
from paddlectl.registry.index.faults import faults
from paddlectl.registry.index.index import Index
from paddlectl.registry.index.queries import rows_of
from paddlectl.registry.names import is_id, number_of
from paddlectl.registry.schema import ROW_TABLES, policy_record, run_records, runs

Rows = dict[str, dict[str, Any]]
_MOVED = {"stray file", "strange file", "unsealed file", "damaged manifest", "lost run"}
_REBUILT = {"damaged index", "missing index", "missing database index"}
_LOST = {"missing file", "changed size", "changed bytes", "strange file", "wrong name"}

_ADDED = {"resumes": 0, "name": None, "tags": "[]"}
"""What manifests of older registries don't tell of a run."""


@dataclass
class Repaired:
    """What was done, and what a check finds afterwards.

    Attributes:
        done: One line for each thing that was changed.
        lost: One line for each row that can't be kept; nothing was changed then.
        left: What couldn't be mended.
    """

    done: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    left: list[Finding] = field(default_factory=list)


def repair(location: str | Path, *, drop_lost: bool = False) -> Repaired:
    """Mends a registry as far as its manifests and objects allow.

    Args:
        location: The registry.
        drop_lost: Whether rows that can't be kept may leave the index.

    Raises:
        NotFoundError: If there is none.
        SchemaVersionError: If a newer paddlectl wrote it.
        IntegrityError: If there is nothing to mend it from, or its folder isn't its own.
    """
    index = Index(location)
    told = Repaired()
    report = check(location, read_data=True)
    kinds = {finding.kind for finding in report.findings}
    if not report.readable and not report.manifests and not report.older:
        raise IntegrityError(
            f"{index.shown}: its index is damaged, and there are no manifests to make it from",
            f"restore {index.database.file} from a copy",
        )
    if not report.faults and not kinds & {"stopped run", "other labels"}:
        _end_deletions(index, told)
        return told
    rows, before = _desired(report, told), report.rows
    if told.lost and not drop_lost:
        return Repaired(lost=told.lost, left=report.faults)
    told.done += [f"{line}; it is gone from the index" for line in told.lost]
    told.lost = []
    with faults(index.shown):
        layout.make(index.folder)
        if kinds & _REBUILT:
            old, before = index.database.renew("damaged"), {}
            told.done.append(f"a new index was made; the old one is {old}" if old else "a new index was made")
        elif rows != before:
            told.done.append(f"the index as it was is {index.database.copy('repaired')}")
        with index.writing() as connection:
            _move_aside(report, rows, index.folder, told)
            changed = _enter(index, connection, before, rows)
            _seal(index.folder, connection, rows, changed, report, told)
        _end_deletions(index, told)
    told.left = check(location, read_data=True).faults
    return told


def _end_deletions(index: Index, told: Repaired) -> None:
    with faults(index.shown):
        told.done += [f"{path}: removed; a deletion was stopped" for path, _ in tombstones.finish(index)]


def _desired(report: Report, told: Repaired) -> Rows:
    """The rows that the index shall have, runs first."""
    lost = {finding.where for finding in report.faults if finding.kind in _LOST}
    leftover = {finding.where for finding in report.findings if finding.kind == "leftover"}
    named = {name for name in report.rows if is_id(name)}  # pages of zeros read as rows of number 0
    names = sorted({*named, *report.manifests} - leftover, key=lambda name: (name[0] != "r", _number(name)))
    rows: Rows = {}
    for name in names:
        row = _better(name, report.rows.get(name), report.manifests.get(name))
        if row is None:
            told.lost.append(f"{name}: neither its row nor its manifest can be read")
        elif name.startswith("policy-") and f"objects/{row['checkpoint']}.safetensors" in lost:
            told.lost.append(f"{name}: its checkpoint is lost")
        else:
            if name not in report.rows:
                told.done.append(f"{name}: entered again from its manifest")
            elif row != report.rows[name]:
                told.done.append(f"{name}: entered as its manifest says")
            rows[name] = row
    if not report.readable:
        told.lost += _without_manifest(report, {*report.rows, *report.manifests})
    _known_by_their_policies(rows, told)
    for finding in report.findings:
        if finding.kind == "stopped run" and rows.get(finding.where, {}).get("status") == "running":
            rows[finding.where] |= {"status": "interrupted", "finished": _now()}
            told.done.append(f"{finding.where}: no process goes on with it; it is interrupted")
    return dict(sorted(rows.items(), key=lambda item: (item[0][0] != "r", _number(item[0]))))


def _without_manifest(report: Report, known: set[str]) -> list[str]:
    """What an index that can't be read must have held, but no manifest tells."""
    found = {f.where for f in report.faults if f.kind in ("damaged manifest", "lost run") and is_id(f.where)}
    return [f"{name}: neither its row nor its manifest can be read" for name in sorted(found - known)]


def _better(
    name: str, row: dict[str, Any] | None, manifest: manifests.Manifest | None
) -> dict[str, Any] | None:
    """The manifest's, which is written first; the row, where that is damaged or older."""
    told = None if manifest is None else _ADDED | manifest.row if name[0] == "r" else manifest.row
    usable = [values for values in (told, row) if values is not None and _is_row(name, values)]
    if len(usable) == 2 and usable[0].get("status") == "running" and usable[1].get("status") == "finished":
        usable.reverse()
    if not usable:
        return None
    table = ROW_TABLES[name.partition("-")[0]]
    return {column: usable[0][column] for column in table.columns.keys()}  # noqa: SIM118 - not a dict


def _is_row(name: str, row: dict[str, Any]) -> bool:
    kind, _, number = name.partition("-")
    columns = ROW_TABLES[kind].columns.keys()
    if row.keys() != set(columns) or row["id"] != int(number):
        return False
    values = [row[column] for column in columns]
    try:
        run_records([[*values, None, None]]) if kind == "run" else policy_record(values)
    except IntegrityError:
        return False
    return True


def _known_by_their_policies(rows: Rows, told: Repaired) -> None:
    """Enters a run of which only a policy is left, so that the policy can be used."""
    for policy in [row for name, row in rows.items() if name.startswith("policy-")]:
        name = f"run-{policy['run']}"
        if name not in rows:
            shared = {key: policy[key] for key in ("method", "task", "seed", "frames", "created")}
            lost = {"scenario": None, "sources": "[]", "status": "failed", "settings": "{}", "versions": "{}"}
            counts = {"episodes": 0, "seconds": 0.0, "results": "{}"} | _ADDED
            ends = {"id": policy["run"], "kind": "train", "finished": policy["created"]}
            rows[name] = {column: (shared | lost | counts | ends)[column] for column in runs.columns.keys()}  # noqa: SIM118
            told.done.append(f"{name}: only policy-{policy['id']} is left of it")


def _move_aside(report: Report, rows: dict[str, Any], folder: Path, told: Repaired) -> None:
    gone = {name for name in report.manifests if name not in rows}
    leftover = {finding.where for finding in report.findings if finding.kind == "leftover"}
    paths = [folder / f.where for f in report.faults if f.kind in _MOVED and f.kind != "damaged manifest"]
    paths += [folder / "runs" / f.where for f in report.faults if f.kind == "lost run"]
    paths += [folder / f.where for f in report.faults if f.kind in _LOST and f.where.startswith("objects/")]
    paths += [
        manifests.path_of(folder, f.where)
        for f in report.faults
        if f.kind == "damaged manifest" and not _is_whole(folder, f.where)
    ]
    paths += [manifests.path_of(folder, name) for name in gone - leftover]
    paths += [_of_checkpoint(folder, f.where) for f in report.faults if f.kind == "damaged checkpoint"]
    aside = folder / "aside" / datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    for path in dict.fromkeys(paths):
        if path.exists() or path.is_symlink():
            place = aside / path.relative_to(folder)
            make_folder(place.parent)
            path.rename(place)
            told.done.append(f"{path.relative_to(folder)}: moved to {place.relative_to(folder)}")


def _is_whole(folder: Path, name: str) -> bool:
    """Whether a manifest that was damaged has been written again meanwhile."""
    try:
        manifests.read(folder, name)
    except IntegrityError:
        return False
    return True


def _of_checkpoint(folder: Path, where: str) -> Path:
    run, _, number = where.partition(", checkpoint ")
    return folder / "runs" / run / "checkpoints" / f"{number}.json"


def _enter(index: Index, connection: Connection, before: Rows, rows: Rows) -> list[str]:
    """Brings the index from the rows that were looked at to those that it shall have; gives what changed.

    A row that another process has changed meanwhile stays as it is.
    """
    now = rows_of(connection)
    changed = [name for name in {**before, **rows} if rows.get(name) != before.get(name)]
    changed = [name for name in changed if now.get(name) == before.get(name)]
    for name in changed:
        table = ROW_TABLES[name.partition("-")[0]]
        if name not in rows:
            connection.execute(delete(table).where(table.c.id == _number(name)))
    for name in sorted(set(changed) & set(rows), key=lambda name: name[0] != "r"):  # runs first
        kind, table = name.partition("-")[0], ROW_TABLES[name.partition("-")[0]]
        if name in now:
            connection.execute(update(table).where(table.c.id == _number(name)).values(rows[name]))
        else:
            connection.execute(insert(table).values(rows[name]))
            index.database.count_from(connection, kind, _number(name))
    return changed


def _seal(
    folder: Path, connection: Connection, rows: Rows, changed: list[str], report: Report, told: Repaired
) -> None:
    """Writes the manifests that are missing, or say otherwise than their rows."""
    for name in rows:
        if name.startswith("run-"):
            make_folder(folder / "runs" / name)
        manifest = report.manifests.get(name)
        if manifest is None and not manifests.path_of(folder, name).exists():
            publish(folder, connection, name)
            told.done.append(f"{name}: a new manifest, of its files as they are")
        elif manifest is not None and manifest.row != rows[name] and name in changed:
            files = manifest.files
            if files is None and rows[name].get("status") != "running":
                files = manifest_of(folder, connection, name).files
            manifests.write(folder, manifests.Manifest(name, rows[name], files))


def _number(name: str) -> int:
    return number_of(name, name.partition("-")[0]) or 0


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
