"""The folders of a registry, and who holds a run's."""

import fcntl
from pathlib import Path
from typing import BinaryIO

from paddlectl.errors import IntegrityError, RegistryBusyError
from paddlectl.registry.files import manifests
from paddlectl.registry.files.objects import sync_folder
from paddlectl.registry.files.rights import make_folder, opened

FOLDERS = ("objects", "runs", manifests.FOLDER)


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


def make_run(folder: Path, run: str) -> Path:
    """Makes the folder of a run that was just entered.

    Raises:
        IntegrityError: If there is one that isn't empty.
    """
    made = folder / "runs" / run
    make_folder(made)
    if any(made.iterdir()):
        raise IntegrityError(
            f"{made} is there, but registry.db doesn't know it: is that an older copy?",
            "move that folder aside",
        )
    sync_folder(made.parent)
    return made


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
