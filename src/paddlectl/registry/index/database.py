"""What SQLite and PostgreSQL have in common: the stamp, the migrations, and what a database offers."""

import re
from pathlib import Path
from typing import Protocol

from sqlalchemy import Connection, Engine

from paddlectl.errors import IntegrityError, SchemaVersionError
from paddlectl.registry import schema

WAIT = 60.0  # seconds for a lock
CONNECTING = 10.0  # seconds until a server must have let one in
MIGRATIONS = Path(__file__).parents[1] / "migrations"
_STAMP = re.compile(r"[0-9A-Za-z_]{1,40}")


class Database(Protocol):
    """Where the index of a registry is kept.

    Attributes:
        shown: Its place for messages, without a password.
        file: What the database is called in messages.
        folder: Where the registry's files are.
        advice: What to do if the folder isn't its own.
    """

    shown: str
    file: str
    folder: Path
    advice: str

    def reading(self) -> Engine:
        """An engine whose transactions read one state of the database."""

    def writing(self) -> Engine:
        """An engine whose transactions are alone: one writes at a time, from its first moment."""

    def exists(self) -> bool:
        """Whether there is a registry."""

    def create(self) -> None:
        """Makes it, unless another process was first."""

    def upgrade(self) -> None:
        """Brings an older one to this version's schema: wholly, or not at all; a copy is made first."""

    def copy(self, label: str) -> str:
        """Keeps a copy of the index and gives its name."""

    def renew(self, label: str) -> str:
        """Puts what is there aside, makes an empty index, and gives the old one's new name."""

    def count_from(self, connection: Connection, kind: str, number: int) -> None:
        """Lets the ids of new runs or policies go on after that number."""

    def faults(self) -> list[str]:
        """What the database itself finds wrong with its pages and indices."""


def stamp(connection: Connection, file: str) -> str:
    """The revision of the schema in the database, by plain SQL.

    Raises:
        IntegrityError: If there isn't exactly one that could be a revision.
    """
    found = connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalars().all()
    if len(found) != 1 or not isinstance(found[0], str) or not _STAMP.fullmatch(found[0]):
        raise IntegrityError(
            f"{file} says nothing about its schema: damaged or no registry", "restore it from a copy"
        )
    return found[0]


def require_current(connection: Connection, file: str) -> None:
    """Refuses a schema that isn't this version's.

    Raises:
        SchemaVersionError: If it is another one.
    """
    found = stamp(connection, file)
    if found != schema.REVISIONS[-1]:
        raise SchemaVersionError(
            f"{file} has schema {found}; this paddlectl works with {schema.REVISIONS[-1]}",
            "use the version of paddlectl that wrote it last",
        )


def migrate(connection: Connection) -> None:
    """Runs every migration that the database lacks, within the connection's transaction."""
    from alembic import command  # 0.2 s, and only this needs it
    from alembic.config import Config

    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    command.upgrade(config, "head")
