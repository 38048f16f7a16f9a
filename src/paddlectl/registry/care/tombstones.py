"""What is being deleted: a folder in the registry that tells it, and into which the folders of runs go.

It is written in the transaction that takes the rows out, before that is committed. So whoever finds it later
knows by the index whether it was: what the index doesn't have is deleted, and what it has stays.
"""

import re
import shutil
import uuid
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path

from sqlalchemy import select

from paddlectl.errors import IntegrityError
from paddlectl.registry.care.findings import inside
from paddlectl.registry.files import documents, manifests
from paddlectl.registry.files.objects import object_path, sync_folder, write_atomically
from paddlectl.registry.files.rights import make_folder
from paddlectl.registry.files.runfiles import bytes_of
from paddlectl.registry.index.index import Index
from paddlectl.registry.names import is_id
from paddlectl.registry.schema import ROW_TABLES, policies

FOLDER = "deleted-"
"""How their folders begin."""

Removed = list[tuple[str, int]]
"""Paths within the registry, and their bytes."""


def folders(registry: Path) -> list[Path]:
    """Of the deletions that go on or were stopped."""
    return sorted(registry.glob(f"{FOLDER}*"))


def begin(registry: Path, names: Iterable[str], digests: Iterable[str]) -> None:
    """Tells that these runs and policies are deleted, with these checkpoints unless others have them."""
    folder = registry / f"{FOLDER}{uuid.uuid4().hex}"
    make_folder(folder)
    told = {"names": sorted(names), "checkpoints": sorted(digests)}
    write_atomically(folder / "names.json", documents.with_hash(told, str(folder)))
    sync_folder(registry)


def dead(registry: Path, rows: Collection[str]) -> set[str]:
    """The runs and policies that were deleted and whose files may be left; `rows` has those of the index."""
    return {name for folder in folders(registry) for name in _told(folder)["names"]} - set(rows)


def finish(index: Index, *, dry: bool = False) -> Removed:
    """Ends the deletions that were stopped: what the index doesn't have goes, what it has stays.

    Args:
        index: It can be read.
        dry: Only says what would go.
    """
    if not folders(index.folder):
        return []
    removed: Removed = []
    with index.writing() as connection:  # so that none is between its tombstone and its commit
        registry, found = index.folder, folders(index.folder)
        needed = set(connection.scalars(select(policies.c.checkpoint)))
        rows = {
            f"{kind}-{id_}"
            for kind, table in ROW_TABLES.items()
            for id_ in connection.scalars(select(table.c.id))
        }
        for folder in found:
            removed += _files_in(registry, folder)
            told = _told(folder)
            gone = [name for name in told["names"] if name not in rows]
            digests = set(told["checkpoints"]) - needed if gone else set()
            files = [manifests.path_of(registry, name) for name in gone]
            files += [object_path(registry / "objects", digest) for digest in sorted(digests)]
            for path in filter(Path.exists, files):
                removed.append((inside(registry, path), path.lstat().st_size))
                if not dry:
                    path.unlink()
            for run in filter(Path.is_dir, (registry / "runs" / name for name in gone)):
                removed += _files_in(registry, run)
                if not dry:
                    run.rename(folder / run.name)
        for name in (manifests.FOLDER, "runs", "objects"):
            sync_folder(registry / name)  # before what tells of them goes
    for folder in () if dry else found:
        shutil.rmtree(folder, ignore_errors=True)
    return removed


def _told(folder: Path) -> dict[str, list[str]]:
    """What a tombstone says; nothing if its process was stopped before that, or it is damaged."""
    names: list[str] = []
    digests: list[str] = []
    with suppress(IntegrityError):
        if data := bytes_of(folder / "names.json"):
            told = documents.checked(data, str(folder))
            names = [name for name in told["names"] if is_id(name)]
            digests = [digest for digest in told["checkpoints"] if re.fullmatch(r"[0-9a-f]{64}", digest)]
    return {"names": names, "checkpoints": digests}


def _files_in(registry: Path, folder: Path) -> Removed:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return [(inside(registry, path), path.lstat().st_size) for path in files]
