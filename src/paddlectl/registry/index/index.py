"""The index of a registry: how it is opened, and its transactions."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Self

from sqlalchemy import Connection, Engine

from paddlectl.errors import NotFoundError
from paddlectl.registry.files import layout
from paddlectl.registry.index import identity
from paddlectl.registry.index.database import require_current, stamp
from paddlectl.registry.index.faults import faults
from paddlectl.registry.index.location import database_of
from paddlectl.registry.schema import REVISIONS


class Index:
    """The rows of a registry. It holds no connection between transactions.

    Attributes:
        database: Where they are kept.
        shown: The registry's place for messages.
        folder: Where the registry's files are.
    """

    def __init__(self, location: str | Path) -> None:
        self.database = database_of(location)
        self.shown, self.folder = self.database.shown, self.database.folder
        self._readers, self._writers = self.database.reading(), self.database.writing()

    def open(self, *, create: bool) -> Self:
        """Makes the index, or brings an older one up to date, where needed.

        Raises:
            NotFoundError: If there is none and none shall be made.
            SchemaVersionError: If a newer paddlectl wrote it; nothing is touched then.
            IntegrityError: If it is damaged, or its folder isn't its own.
        """
        database = self.database
        with faults(self.shown):
            if not database.exists():
                identity.require_unowned(database)
                if not create:
                    layout.refuse_orphans(self.folder)
                    raise NotFoundError(f"no registry at {self.shown}", "run: paddlectl train BoxDoor")
                database.create()
            with self._readers.begin() as connection:
                found = stamp(connection, database.file)
            if found in REVISIONS[:-1]:
                database.upgrade()
        with self.reading() as connection:
            identity.require(database, identity.of_index(connection))
        return self

    def close(self) -> None:
        """Ends the use of the index."""
        self._readers.dispose()
        self._writers.dispose()

    def reading(self) -> AbstractContextManager[Connection]:
        """A transaction that reads one state of the rows."""
        return self._transaction(self._readers)

    def writing(self) -> AbstractContextManager[Connection]:
        """A transaction that is alone: nobody else writes meanwhile."""
        return self._transaction(self._writers)

    @contextmanager
    def _transaction(self, engine: Engine) -> Iterator[Connection]:
        with faults(self.shown), engine.begin() as connection:
            require_current(connection, self.database.file)
            yield connection
