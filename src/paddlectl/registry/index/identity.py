"""Which folder and which index make a registry: both hold one identity, so that no other two are mixed.

The folder's is its file `identity`, which names the index too: `<id> registry.db`, `<id> the database x`.
"""

import hashlib
import uuid
from pathlib import Path

from sqlalchemy import Connection, delete, insert, inspect, select

from paddlectl.errors import IntegrityError
from paddlectl.registry.files import manifests
from paddlectl.registry.files.objects import object_path, write_atomically
from paddlectl.registry.index.database import Database
from paddlectl.registry.names import quoted
from paddlectl.registry.schema import identity

FILE = "identity"


def of_index(connection: Connection) -> str | None:
    """The identity that the index holds; None if it isn't exactly one, or damaged."""
    found = connection.scalars(select(identity.c.id)).all()
    return found[0] if len(found) == 1 and found[0] == _with_digest(str(found[0])[:32]) else None


def give(index: Database, connection: Connection, *, new: bool = False) -> None:
    """Gives the index its folder's identity, or both a new one; the folder's is on the disk first."""
    known = "" if new else _of_folder(index.folder).partition(" ")[0]
    if known != _with_digest(known[:32]):
        known = _with_digest(uuid.uuid4().hex)
        write_atomically(index.folder / FILE, f"{known} {index.file}\n".encode())
    connection.execute(delete(identity))
    connection.execute(insert(identity).values(id=known))


def require(index: Database, found: str | None) -> None:
    """Refuses an index of the identity `found` with a folder that isn't its own.

    Raises:
        IntegrityError: If the folder has another identity or none, or the index has none.
    """
    if found is None:
        raise IntegrityError(f"{index.file} doesn't say which folder is its own", _REPAIR)
    told, line = _of_folder(index.folder), f"{found} {index.file}"
    if told != line:
        why = f"its file {FILE} says otherwise" if told else f"it has no file {FILE}"
        path = quoted(str(index.folder / FILE))
        raise IntegrityError(
            _apart(index, why), f"{index.advice}; if it does, run: echo {quoted(line)} > {path}"
        )


def require_unowned(index: Database) -> None:
    """Refuses to make an index for a folder that has another one.

    Raises:
        IntegrityError: If it has.
    """
    told = _of_folder(index.folder)
    owner = told.partition(" ")[2]
    if told and owner != index.file:
        path = quoted(str(index.folder / FILE))
        raise IntegrityError(
            _apart(index, f"its index is {owner or 'another'}"),
            f"use that one; if it is lost for good, run: rm {path}",
        )


def require_before_upgrade(index: Database, connection: Connection) -> None:
    """Refuses an index of an older schema with a folder that isn't its own.

    One without an identity is known by what was learned: the folder must hold some of it, and no other.

    Raises:
        IntegrityError: If the folder isn't its own.
    """
    if inspect(connection).has_table(identity.name):
        return require(index, of_index(connection))
    require_unowned(index)
    runs = connection.exec_driver_sql("SELECT id, created FROM runs").all()
    policies = connection.exec_driver_sql("SELECT id, created, checkpoint FROM policies").all()
    rows = {f"run-{row[0]}": row[1] for row in runs} | {f"policy-{row[0]}": row[1] for row in policies}
    told = {name: _created(index.folder, name) for name in manifests.names(index.folder) if name in rows}
    same = {moment == rows[name] for name, moment in told.items() if moment is not None}
    if not same:  # the first schema had no manifests
        objects = [object_path(index.folder / "objects", str(row[2])) for row in policies]
        files = objects or [index.folder / "runs" / f"run-{row[0]}" for row in runs]
        same = {any(path.exists() for path in files)}
    if rows and same != {True}:
        raise IntegrityError(_apart(index, "it doesn't hold its runs"), index.advice)


def _with_digest(text: str) -> str:
    """An identity that tells by itself whether it is whole."""
    return f"{text}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _of_folder(folder: Path) -> str:
    """What the folder's file says; nothing if there is none."""
    try:
        return (folder / FILE).read_text(errors="replace").removesuffix("\n")
    except (FileNotFoundError, NotADirectoryError):
        return ""


def _created(folder: Path, name: str) -> object:
    """When the run or policy was made, as its manifest says; None if that can't be read."""
    try:
        return manifests.read(folder, name).row.get("created")
    except IntegrityError:
        return None


def _apart(index: Database, why: str) -> str:
    return f"the folder {index.folder} doesn't belong to {index.file}: {why}"


_REPAIR = "run: paddlectl registry repair"
