"""Checkpoints as files named by their SHA-256: written once, verified on every read."""

import hashlib
import os
import re
import uuid
from contextlib import suppress
from pathlib import Path

from paddlectl.errors import IntegrityError
from paddlectl.registry.files.rights import share

_DIGEST = re.compile(r"[0-9a-f]{64}")


def publish(folder: Path, data: bytes) -> str:
    """Stores bytes so that they are whole on the disk, or not there at all.

    Args:
        folder: The registry's `objects` folder.
        data: What to store.

    Returns:
        The SHA-256 of the bytes in hexadecimal, which names the file.
    """
    digest = hashlib.sha256(data).hexdigest()
    write_atomically(object_path(folder, digest), data)
    return digest


def bring(folder: Path, data: bytes) -> str:
    """Publishes an object before the transaction of its row, so that none waits for it, and gives its name.

    `gc` may come first and take it away again, even half-written.
    """
    with suppress(FileNotFoundError):
        publish(folder, data)
    return hashlib.sha256(data).hexdigest()


def keep(folder: Path, data: bytes) -> None:
    """Makes sure in the transaction of its row that the object is there, from now on for good."""
    if not object_path(folder, hashlib.sha256(data).hexdigest()).exists():
        publish(folder, data)


def read(folder: Path, digest: str, owner: str, hint: str = "") -> bytes:
    """Reads an object and makes sure that it is what was published.

    Args:
        folder: The registry's `objects` folder.
        digest: The object's name, as `publish` returned it.
        owner: Whose object it is, for the message: `policy-7`.
        hint: What to do if it is damaged.

    Raises:
        IntegrityError: If the object is missing or was changed.
    """
    if not _DIGEST.fullmatch(digest):
        raise IntegrityError(f"{owner}: {digest[:80]!r} names no object", hint)
    path = object_path(folder, digest)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise IntegrityError(f"{owner}: its checkpoint {path} is missing", hint) from None
    if hashlib.sha256(data).hexdigest() != digest:
        raise IntegrityError(f"{owner}: its checkpoint {path} isn't what was stored (SHA-256 differs)", hint)
    return data


def object_path(folder: Path, digest: str) -> Path:
    """Where the object of that digest stands."""
    return folder / f"{digest}.safetensors"


def write_atomically(path: Path, data: bytes, *, shared: bool = True) -> None:
    """Replaces a file by a temporary one: synced, renamed, and the folder synced too.

    Args:
        path: The file.
        data: What it shall hold.
        shared: Whether it is a registry's, as open to others as its folder.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
    try:
        with temporary.open("xb") as file:
            if shared:
                share(temporary)
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Makes new and renamed entries of a folder survive a loss of power."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
