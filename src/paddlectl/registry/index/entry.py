"""How rows come into the index: each with its manifest, which is written in the same transaction."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, delete, insert, select

from paddlectl.registry.files import layout, manifests
from paddlectl.registry.files.objects import object_path
from paddlectl.registry.index.database import Database
from paddlectl.registry.names import number_of
from paddlectl.registry.schema import ROW_TABLES


def enter(database: Database, connection: Connection, kind: str, row: Mapping[str, Any]) -> int:
    """Adds a row under a number that no manifest has, not even one that the index lost; gives the number.

    Args:
        database: The index.
        connection: A writing transaction of it.
        kind: `run` or `policy`.
        row: The values, column by column.
    """
    table, folder = ROW_TABLES[kind], database.folder
    number = _inserted(connection.execute(insert(table).values(row)).inserted_primary_key)
    if manifests.path_of(folder, f"{kind}-{number}").exists():
        connection.execute(delete(table).where(table.c.id == number))
        numbers = (number_of(name, kind) for name in manifests.names(folder))
        number = 1 + max(found for found in numbers if found)
        connection.execute(insert(table).values({**row, "id": number}))
        database.count_from(connection, kind, number)
    return number


def _inserted(key: Sequence[Any] | None) -> int:
    assert key is not None
    return int(key[0])


def publish(folder: Path, connection: Connection, name: str) -> None:
    """Writes the manifest of a row; what it says is true once the transaction is committed."""
    manifests.write(folder, manifest_of(folder, connection, name))


def publish_all(folder: Path, connection: Connection) -> None:
    """Writes the manifest of every row, its files as they are now."""
    for kind, table in ROW_TABLES.items():
        for number in connection.scalars(select(table.c.id)).all():
            publish(folder, connection, f"{kind}-{number}")


def manifest_of(folder: Path, connection: Connection, name: str) -> manifests.Manifest:
    """The manifest of a row with its files as they are now; those of a run that goes on aren't sealed."""
    kind, _, number = name.partition("-")
    table = ROW_TABLES[kind]
    row = connection.execute(select(table).where(table.c.id == int(number))).one()
    values = dict(zip(table.columns.keys(), row, strict=True))
    if values.get("status") == "running":
        return manifests.Manifest(name, values, None)
    if kind == "run":
        files = layout.run_files(folder, name)
    else:
        files = [object_path(folder / "objects", str(values["checkpoint"]))]
    return manifests.Manifest(name, values, manifests.sealed(folder, filter(Path.is_file, files)))
