"""The database file: connections, transactions, its schema's stamp, its creation and its upgrades."""

import fcntl
import re
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, Engine, NullPool, create_engine, event

from paddlectl.errors import IntegrityError, SchemaVersionError
from paddlectl.registry import schema
from paddlectl.registry.faults import busy
from paddlectl.registry.objects import sync_folder

WAIT = 60.0  # seconds for a lock
MIGRATIONS = Path(__file__).parent / "migrations"
_STAMP = re.compile(r"[0-9A-Za-z_]{1,40}")


def database_path(folder: Path) -> Path:
    """The registry's database in its folder."""
    return folder / "registry.db"


def reading(path: Path) -> Engine:
    """An engine whose transactions read one state of the database."""
    return _engine(path, "BEGIN", "PRAGMA foreign_keys=ON")


def writing(path: Path) -> Engine:
    """An engine whose transactions hold the write lock from their first moment.

    Taking it later, after a read, is where SQLite loses updates or fails at once with "database is locked".
    The rollback journal is set because the WAL of SQLite 3.7.0 to 3.51.2 can corrupt a database.
    """
    return _engine(
        path,
        "BEGIN IMMEDIATE",
        "PRAGMA journal_mode=DELETE",
        "PRAGMA synchronous=FULL",
        "PRAGMA foreign_keys=ON",
    )


def _migrating(path: Path) -> Engine:
    # Without foreign keys, since a batch migration replaces whole tables; no transaction can switch them off.
    return _engine(path, "BEGIN IMMEDIATE", "PRAGMA journal_mode=DELETE", "PRAGMA synchronous=FULL")


def _engine(path: Path, begin: str, *pragmas: str) -> Engine:
    # No pool: no handle outlives its transaction, so none leaks, and none crosses a fork.
    engine = create_engine("sqlite://", creator=lambda: _connect(path, *pragmas), poolclass=NullPool)

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        connection.exec_driver_sql(begin)

    return engine


def _connect(path: Path, *pragmas: str) -> sqlite3.Connection:
    """A connection to a file that exists; the driver begins no transactions of its own."""
    address = f"{path.absolute().as_uri()}?mode=rw"
    connection = sqlite3.connect(address, uri=True, timeout=WAIT, isolation_level=None)
    try:
        for pragma in ("PRAGMA trusted_schema=OFF", "PRAGMA cell_size_check=ON", *pragmas):
            connection.execute(pragma)
    except BaseException:
        connection.close()
        raise
    return connection


def stamp(connection: Connection) -> str:
    """The revision of the schema in the file, by plain SQL.

    Raises:
        IntegrityError: If there isn't exactly one that could be a revision.
    """
    found = connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalars().all()
    if len(found) != 1 or not isinstance(found[0], str) or not _STAMP.fullmatch(found[0]):
        raise IntegrityError(
            "registry.db says nothing about its schema: damaged or no registry", "restore it from a copy"
        )
    return found[0]


def require_current(connection: Connection) -> None:
    """Refuses a schema that isn't this version's.

    Raises:
        SchemaVersionError: If it is another one.
    """
    found = stamp(connection)
    if found != schema.REVISIONS[-1]:
        raise SchemaVersionError(
            f"registry.db has schema {found}; this paddlectl works with {schema.REVISIONS[-1]}",
            "use the version of paddlectl that wrote it last",
        )


def create(folder: Path) -> None:
    """Makes the database unless another process was first.

    It is built under another name and then renamed: `registry.db` is never half-made.

    Raises:
        IntegrityError: If the folder holds runs or objects already, whose database must have been lost.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder):
        path = database_path(folder)
        if path.exists():
            return
        _refuse_orphans(folder)
        fresh = folder / "registry.db.new"
        for leftover in folder.glob("registry.db.new*"):
            leftover.unlink()
        fresh.touch()
        with _migrating(fresh).begin() as connection:
            _migrate(connection)
        for name in ("objects", "runs"):
            (folder / name).mkdir(exist_ok=True)
        fresh.rename(path)
        sync_folder(folder)


def _refuse_orphans(folder: Path) -> None:
    for name in ("objects", "runs"):
        if (folder / name).is_dir() and any((folder / name).iterdir()):
            raise IntegrityError(
                f"{folder} holds {name}, but its registry.db is missing",
                "restore registry.db from a copy, or move the folder aside",
            )


def upgrade(folder: Path) -> None:
    """Brings an older database to this version's schema: wholly, or not at all.

    A copy, `registry.db.<old revision>.<time>`, is made first and stays.
    """
    path = database_path(folder)
    with _locked(folder), _migrating(path).begin() as connection:
        found = stamp(connection)
        if found in schema.REVISIONS[:-1]:  # else another process was first
            _copy(path, found)
            _migrate(connection)


def _copy(path: Path, revision: str) -> None:
    moment = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    copy = path.with_name(f"{path.name}.{revision}.{moment}")
    with closing(_connect(path)) as source, closing(sqlite3.connect(copy)) as target:
        source.backup(target)
    sync_folder(path.parent)


def _migrate(connection: Connection) -> None:
    from alembic import command  # 0.2 s, and only this needs it
    from alembic.config import Config

    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    command.upgrade(config, "head")
    if connection.exec_driver_sql("PRAGMA foreign_key_check").first():
        raise IntegrityError("registry.db has rows whose run is missing", "restore it from a copy")


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds the folder's lock file, across processes; the system frees it when its holder dies.

    POSIX only, and no better than the file system's own locks, as SQLite itself.
    """
    deadline = time.monotonic() + WAIT
    with (folder / "registry.lock").open("ab") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise busy(str(folder)) from None
                time.sleep(0.02)
        yield
