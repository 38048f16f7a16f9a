"""`registry gc`: frees what no run and no policy needs any more, and tells what."""

import time
from collections.abc import Iterator
from pathlib import Path

from paddlectl.errors import IntegrityError
from paddlectl.registry import checkpoints, layout, manifests
from paddlectl.registry.check import check
from paddlectl.registry.findings import Report
from paddlectl.registry.store import Registry

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
    with Registry.open(location, create=False) as registry:
        report = check(location)
        if report.faults:
            raise IntegrityError(
                f"{registry.shown} has faults, so nothing was removed: {report.faults[0].what}",
                "run: paddlectl registry check, then paddlectl registry repair",
            )
        removed = []
        with registry.alone() as needed:
            for path in dict.fromkeys(_unneeded(report, registry.folder)):
                found = path.lstat()
                if path.name in needed or time.time() - found.st_mtime < grace:
                    continue
                removed.append((path.relative_to(registry.folder).as_posix(), found.st_size))
                if not dry:
                    path.rmdir() if path.is_dir() else path.unlink()
        return removed


def _unneeded(report: Report, folder: Path) -> Iterator[Path]:
    for finding in report.findings:
        if finding.kind == "leftover":
            yield from _of_leftover(folder, finding.where)
    for run in sorted((folder / "runs").iterdir()):
        numbers = {str(number) for number in checkpoints.numbers(run)}
        ended = run.name in report.rows and report.rows[run.name]["status"] == "finished"
        for path in sorted((run / "checkpoints").glob("*")):
            if ended or path.stem not in numbers:
                yield path


def _of_leftover(folder: Path, where: str) -> Iterator[Path]:
    """What a leftover consists of: a file, or the manifest and the empty folder of a run that never was."""
    run = folder / "runs" / where
    if run.is_dir() and layout.is_held(run):
        return
    files = sorted(run.iterdir()) if run.is_dir() else []
    for path in (manifests.path_of(folder, where), *files, run, folder / where):
        if path.exists():
            yield path
