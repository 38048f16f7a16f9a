"""`registry gc`: frees what no run and no policy needs any more, and tells what."""

import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

from sqlalchemy import Connection, select

from paddlectl.errors import IntegrityError
from paddlectl.registry.care import tombstones
from paddlectl.registry.care.check import check
from paddlectl.registry.care.files import Rows
from paddlectl.registry.care.findings import Report, entries, inside
from paddlectl.registry.files import checkpoints, layout, manifests
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.files.runfiles import kept_still
from paddlectl.registry.index.index import Index
from paddlectl.registry.schema import ROW_TABLES, policies

GRACE = 3600.0
"""Seconds for which a file without an owner may belong to a writer who isn't done yet."""


def collect(location: str | Path, *, grace: float = GRACE, dry: bool = False) -> list[tuple[str, int]]:
    """Removes what is left over, and says what: path within the registry, and bytes.

    Args:
        location: The registry.
        grace: Seconds; younger files stay.
        dry: Only says it.

    Raises:
        IntegrityError: If the index is damaged: it couldn't be known what is needed.
    """
    index = Index(location).open(create=False)
    report, folder = check(location), index.folder
    if report.faults:
        raise IntegrityError(
            f"{index.shown} has faults, so nothing was removed: {report.faults[0].what}",
            "run: paddlectl registry check, then paddlectl registry repair",
        )
    with disk_faults(index.shown):
        removed = tombstones.finish(index, dry=dry)
    told = {name for name, _ in removed}
    unneeded = [path for path in dict.fromkeys(_unneeded(report, folder)) if inside(folder, path) not in told]
    with index.writing() as connection:
        needed = _needed(connection)
        for path in unneeded:
            with suppress(FileNotFoundError), _kept_free(folder, report.rows, path, needed, dry) as free:
                found = path.lstat()
                if free and time.time() - found.st_mtime >= grace:
                    if not dry:
                        path.rmdir() if path.is_dir() else path.unlink()
                    removed.append((inside(folder, path), found.st_size))
    return removed


def _needed(connection: Connection) -> set[str]:
    """The names of all files that rows need."""
    digests = connection.scalars(select(policies.c.checkpoint)).all()
    rows = {
        f"{kind}-{number}"
        for kind, table in ROW_TABLES.items()
        for number in connection.scalars(select(table.c.id))
    }
    return {f"{digest}.safetensors" for digest in digests} | rows | {f"{row}.json" for row in rows}


def _unneeded(report: Report, folder: Path) -> Iterator[Path]:
    for finding in report.findings:
        if finding.kind == "leftover" and not finding.where.startswith(tombstones.FOLDER):
            yield from _of_leftover(folder, finding.where)
    for run in entries(folder / "runs"):
        for path in entries(run / "checkpoints"):
            if run.name in report.rows and not _belongs(path, report.rows[run.name]["status"]):
                yield path


def _belongs(path: Path, status: str) -> bool:
    """Whether a file in a run's `checkpoints` is one that the run may go on from."""
    return status != "finished" and path.stem in map(str, checkpoints.numbers(path.parents[1]))


@contextmanager
def _kept_free(folder: Path, rows: Rows, path: Path, needed: Collection[str], dry: bool) -> Iterator[bool]:
    """Whether still nobody needs the file; within the block nobody begins to."""
    run = path.parents[1] if path.parent.name == "checkpoints" else path.parent
    if run.parent != folder / "runs":
        yield path.name not in needed
    elif run.name not in needed:  # nor can a process begin with it
        yield not layout.is_held(run)
    else:
        status = rows[run.name]["status"] if run.name in rows else "running"
        with nullcontext(not layout.is_held(run)) if dry else kept_still(run) as still:
            of_checkpoint = path.parent != run and not _belongs(path, status)
            yield still and (path.name.endswith(".part") or of_checkpoint)


def _of_leftover(folder: Path, where: str) -> Iterator[Path]:
    """What a leftover consists of: a file, or the manifest and the empty folder of a run that never was."""
    run = folder / "runs" / where
    for path in (manifests.path_of(folder, where), *entries(run), run, folder / where):
        if path.exists():
            yield path
