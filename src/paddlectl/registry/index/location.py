"""Where an index is: the database that a registry's location names."""

import re
from pathlib import Path

from paddlectl.errors import UsageError
from paddlectl.registry.index.addresses import is_like_one
from paddlectl.registry.index.database import Database
from paddlectl.registry.index.postgres import PostgresDatabase
from paddlectl.registry.index.sqlite import SqliteDatabase
from paddlectl.registry.names import shown

_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_PLACES = "give a folder, or postgresql://…?files=FOLDER"


def database_of(location: str | Path) -> Database:
    """The index that a location names.

    Raises:
        UsageError: If it names none.
    """
    text = str(location).removeprefix("sqlite:///")
    if re.match(r"postgres(ql)?(\+psycopg)?://", text):
        return PostgresDatabase("postgresql" + text[text.index("://") :])
    if address := _ADDRESS.match(text):
        raise UsageError(f"a registry can't be at a {address[1]} address", _PLACES)
    if is_like_one(text):
        raise UsageError("that is no place for a registry: it looks like an address", _PLACES)
    if not text or "\0" in text:
        raise UsageError("that is no place for a registry", "give a folder")
    folder = Path(text)
    taken = folder.is_symlink() or folder.exists()  # asked first: another process may make it meanwhile
    if taken and not folder.is_dir():
        raise UsageError(f"{shown(text)} is no folder", _PLACES)
    return SqliteDatabase(folder)
