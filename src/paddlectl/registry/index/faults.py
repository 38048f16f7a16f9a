"""Faults of the database and the disk, told as what they mean for the user."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy.exc import DBAPIError

from paddlectl.errors import IntegrityError, PaddlectlError, RegistryBusyError
from paddlectl.registry.files.faults import disk_faults, full
from paddlectl.registry.files.rights import refused

_BUSY = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
_CLOSED = {sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_AUTH}

_WAITED = {"55P03", "57014", "40P01"}
_NOT_THERE = {"08", "28", "3D", "57", "53", "25"}


@contextmanager
def faults(place: str) -> Iterator[None]:
    """Turns faults of SQLite and the file system in its block into children of PaddlectlError.

    Args:
        place: The registry's location, for the messages.

    Raises:
        RegistryBusyError: If another process held the database for too long.
        IntegrityError: If the database is damaged.
        PaddlectlError: If the disk is full, or the registry can't be written or opened.
    """
    try:
        with disk_faults(place):
            yield
    except DBAPIError as error:
        raise _database_fault(place, error.orig) from error
    except (sqlite3.Error, UnicodeDecodeError) as error:  # the latter where SQLite's message quotes damage
        raise _database_fault(place, error) from error


def _database_fault(place: str, error: BaseException | None) -> PaddlectlError:
    if (state := getattr(error, "sqlstate", "")) != "":
        return _server_fault(place, state, error)
    # The low byte is the kind of fault. The driver's own errors, such as text that isn't UTF-8, have none.
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
    what = _printable(error)
    if code in _BUSY:
        return busy(place)
    if code == sqlite3.SQLITE_FULL:
        return full(place)
    if code in _CLOSED:
        for name in ("registry.db", "registry.db-journal"):  # the latter is made for every write
            if refusal := refused(Path(place) / name):
                return PaddlectlError(refusal.what, refusal.hint)
        return PaddlectlError(
            f"the registry {place} can't be opened or written: {what}",
            "check that it is there and that you may write to it",
        )
    if code == sqlite3.SQLITE_IOERR:
        return PaddlectlError(f"the disk failed under the registry {place}: {what}", "nothing was changed")
    from_manifests = any((Path(place) / "manifests").glob("*.json"))
    return IntegrityError(
        f"{place}/registry.db is damaged or no registry: {what}",
        "run: paddlectl registry repair" if from_manifests else "restore it from a copy",
    )


def _server_fault(place: str, state: str | None, error: BaseException | None) -> PaddlectlError:
    """PostgreSQL's, by the class of its SQLSTATE; None while there is no connection."""
    if state in _WAITED:
        return busy(place)
    if state == "53100":
        return full(place)
    what = _printable(error)
    if state is None or state[:2] in _NOT_THERE:
        return PaddlectlError(
            f"the registry {place} can't be opened or written: {what}", "check the address and your rights"
        )
    return IntegrityError(f"{place} is damaged or no registry: {what}", "run: paddlectl registry repair")


def _printable(error: BaseException | None) -> str:
    return "".join(c if c.isprintable() else " " for c in str(error).strip()[:200])


def busy(place: str) -> RegistryBusyError:
    """The error for a registry that another process holds."""
    return RegistryBusyError(
        f"the registry {place} was held by another process for too long", "try again when that one is done"
    )
