"""The index in PostgreSQL, for registries that several machines share; the files stay in a shared folder."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, NullPool, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import SQLAlchemyError

from paddlectl.errors import UsageError
from paddlectl.registry import schema
from paddlectl.registry.files import layout
from paddlectl.registry.index import database, identity
from paddlectl.registry.index.addresses import is_clear, secrets_of
from paddlectl.registry.index.entry import publish_all

_LOCK = 7_052_391_164  # any number; names the advisory lock of registries
_TABLES = ("runs", "policies", "identity", "alembic_version")


class PostgresDatabase:
    """A database at `postgresql://user@host/name?files=FOLDER` (`database.Database`).

    Raises:
        UsageError: If the address makes no sense, or the extra `postgres` isn't installed.
    """

    def __init__(self, address: str) -> None:
        url, folder = _parsed(address)
        host = url.host or "local"
        self.shown = f"postgresql://{host}/{url.database}"
        self.file = f"the database {url.database}"
        self.folder = folder
        self.advice = "check files= and the database in the address"
        self._url, self._secrets = url, secrets_of(address)

    def reading(self) -> Engine:
        return self._engine("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY")

    def writing(self) -> Engine:
        """One writer at a time, as with SQLite; what it reads stays as it is meanwhile."""
        return self._engine(
            f"SET LOCAL lock_timeout = '{int(database.WAIT * 1000)}ms'",
            f"SELECT pg_advisory_xact_lock({_LOCK})",
        )

    def exists(self) -> bool:
        with self.reading().begin() as connection:
            return _has(connection, "alembic_version")

    def create(self) -> None:
        with self.writing().begin() as connection:
            if not _has(connection, "alembic_version"):
                identity.require_unowned(self)
                self.folder.mkdir(parents=True, exist_ok=True)
                layout.refuse_orphans(self.folder)
                layout.make(self.folder)
                database.migrate(connection)
                identity.give(self, connection, new=True)

    def upgrade(self) -> None:
        """Copies the tables into a schema of their own first."""
        with self.writing().begin() as connection:
            found = database.stamp(connection, self.file)
            if found in schema.REVISIONS[:-1]:  # else another process was first
                identity.require_before_upgrade(self, connection)
                self._copy(connection, found)
                database.migrate(connection)
                layout.make(self.folder)
                identity.give(self, connection)
                publish_all(self.folder, connection)

    def copy(self, label: str) -> str:
        with self.writing().begin() as connection:
            return self._copy(connection, label)

    def renew(self, label: str) -> str:
        """Where there is no index at all, another database may still have it; it loses the folder then."""
        with self.writing().begin() as connection:
            identity.require_unowned(self)
            missing = not _has(connection, "identity")
            name = self._copy(connection, label)
            for table in reversed(_TABLES):
                connection.exec_driver_sql(f"DROP TABLE IF EXISTS {table} CASCADE")
            layout.make(self.folder)
            database.migrate(connection)
            identity.give(self, connection, new=missing)
            return name

    def count_from(self, connection: Connection, kind: str, number: int) -> None:
        table = schema.ROW_TABLES[kind].name
        sequence = f"pg_get_serial_sequence('{table}', 'id')"
        connection.exec_driver_sql(
            f"SELECT setval({sequence}, greatest({int(number)}, nextval({sequence}) - 1))"
        )

    def faults(self) -> list[str]:
        return []  # its pages are the server's to check

    def _copy(self, connection: Connection, label: str) -> str:
        name = f"paddlectl_{label}_{datetime.now(UTC).strftime('%Y%m%dt%H%M%S%f')}".lower()
        connection.exec_driver_sql(f"CREATE SCHEMA {name}")
        for table in _TABLES:
            if _has(connection, table):
                connection.exec_driver_sql(f"CREATE TABLE {name}.{table} AS TABLE {table}")
        return f"the schema {name}"

    def _engine(self, *begin: str) -> Engine:
        engine = create_engine(self._url, poolclass=NullPool)

        @event.listens_for(engine, "do_connect")
        def _connect(_: Any, __: Any, ___: Any, named: dict[str, Any]) -> Any:
            from paddlectl.registry.index.connecting import connected  # psycopg, which few registries need

            return connected(self.shown, self._secrets, named)

        @event.listens_for(engine, "begin")
        def _begin(connection: Connection) -> None:
            for statement in begin:
                connection.exec_driver_sql(statement)

        return engine


def _has(connection: Connection, table: str) -> bool:
    return connection.exec_driver_sql(f"SELECT to_regclass('{table}')").scalar() is not None


def _parsed(address: str) -> tuple[URL, Path]:
    try:
        import psycopg  # noqa: F401
    except ImportError:
        raise UsageError(
            "PostgreSQL needs an extra", "install it: pip install 'paddlectl[postgres]'"
        ) from None
    if not is_clear(address):
        raise UsageError(
            "that address can be read in more than one way",
            "write @ / ? # in user and password, and @ in files=, as %40 %2F %3F %23",
        )
    try:
        url = make_url(address)
    except (SQLAlchemyError, ValueError):
        raise UsageError("that is no address of a database", _EXAMPLE) from None
    files = url.query.get("files")
    if not isinstance(files, str) or not files or not url.database:
        raise UsageError("a database's address names the folder of the registry's files too", _EXAMPLE)
    url = url.difference_update_query(["files"]).set(drivername="postgresql+psycopg")
    return url, Path(files)


_EXAMPLE = "as in: postgresql://host/paddlectl?files=/shared/registry"
