"""The folders of a registry, and the seals of what an older version left in them."""

import fcntl
from pathlib import Path
from typing import BinaryIO

from sqlalchemy import Connection, select

from paddlectl.errors import IntegrityError, RegistryBusyError
from paddlectl.registry.files import manifests
from paddlectl.registry.files.objects import object_path
from paddlectl.registry.files.rights import make_folder, opened
from paddlectl.registry.schema import policies, runs

FOLDERS = ("objects", "runs", manifests.FOLDER)
ROW_TABLES = {"run": runs, "policy": policies}


def make(folder: Path) -> None:
    """Makes the folders that are missing."""
    for name in FOLDERS:
        make_folder(folder / name)


def refuse_orphans(folder: Path) -> None:
    """Refuses a folder that holds what was learned, but isn't known to any index.

    Raises:
        IntegrityError: If it does.
    """
    for name in FOLDERS:
        if (folder / name).is_dir() and any((folder / name).iterdir()):
            raise IntegrityError(
                f"{folder} holds {name}, but its registry.db is missing",
                "restore registry.db from a copy, or run: paddlectl registry repair",
            )


def seal_all(folder: Path, connection: Connection) -> None:
    """Writes the manifest of every row, its files as they are now."""
    for kind, table in ROW_TABLES.items():
        for number in connection.scalars(select(table.c.id)).all():
            manifests.write(folder, manifest_of(folder, connection, f"{kind}-{number}"))


def manifest_of(folder: Path, connection: Connection, name: str) -> manifests.Manifest:
    """The manifest of a row with its files as they are now; those of a run that goes on aren't sealed."""
    kind, _, number = name.partition("-")
    table = ROW_TABLES[kind]
    row = connection.execute(select(table).where(table.c.id == int(number))).one()
    values = dict(zip(table.columns.keys(), row, strict=True))
    if values.get("status") == "running":
        return manifests.Manifest(name, values, None)
    if kind == "run":
        files = run_files(folder, name)
    else:
        files = [object_path(folder / "objects", str(values["checkpoint"]))]
    return manifests.Manifest(name, values, manifests.sealed(folder, filter(Path.is_file, files)))


def run_files(folder: Path, run: str) -> list[Path]:
    """The tables and documents of a run."""
    found = (folder / "runs" / run).glob("*.json*")
    return sorted(path for path in found if path.is_file() and not path.name.startswith("."))


def take(run_folder: Path) -> BinaryIO:
    """The lock of a run, which is free again when the file is closed or the process has died.

    Raises:
        RegistryBusyError: If another process has it.
    """
    file = opened(run_folder / "lock", "ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise RegistryBusyError(
            f"{run_folder.name} goes on in another process", "wait for it, or stop that process"
        ) from None
    return file


def is_held(run_folder: Path) -> bool:
    """Whether a process has the run's lock."""
    try:
        with (run_folder / "lock").open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
