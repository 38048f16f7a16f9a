"""The index as a SQLite file, `registry.db`: connections, transactions, its creation and its upgrades."""

import fcntl
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, Engine, NullPool, create_engine, event

from paddlectl.errors import IntegrityError
from paddlectl.registry import schema
from paddlectl.registry.files import layout
from paddlectl.registry.files.objects import sync_folder
from paddlectl.registry.files.rights import make_file, opened
from paddlectl.registry.index import database, identity
from paddlectl.registry.index.entry import publish_all
from paddlectl.registry.index.faults import busy


class SqliteDatabase:
    """`registry.db` in the registry's folder (`database.Database`)."""

    file = "registry.db"

    def __init__(self, folder: Path) -> None:
        self.shown = str(folder)
        self.folder = folder
        self.path = folder / self.file
        self.advice = "put registry.db back into its own folder"

    def reading(self) -> Engine:
        return _engine(self.path, "BEGIN", "PRAGMA foreign_keys=ON")

    def writing(self) -> Engine:
        """Takes the write lock first.

        Taking it later, after a read, is where SQLite loses updates or fails at once with "database is
        locked". The rollback journal is set because the WAL of SQLite 3.7.0 to 3.51.2 can corrupt a database.
        """
        return _engine(self.path, "BEGIN IMMEDIATE", *_WRITING, "PRAGMA foreign_keys=ON")

    def exists(self) -> bool:
        return self.path.exists()

    def create(self) -> None:
        """It is built under another name and then renamed: `registry.db` is never half-made.

        Raises:
            IntegrityError: If the folder holds what was learned already, whose database must have been lost.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with _locked(self.folder):
            if not self.exists():
                identity.require_unowned(self)
                layout.refuse_orphans(self.folder)
                layout.make(self.folder)
                self._build(new=True)

    def upgrade(self) -> None:
        """A copy, `registry.db.<old revision>.<time>`, is made first and stays."""
        with _locked(self.folder), _migrating(self.path).begin() as connection:
            found = database.stamp(connection, self.file)
            if found in schema.REVISIONS[:-1]:  # else another process was first
                identity.require_before_upgrade(self, connection)
                self.copy(found)
                _migrate(connection)
                layout.make(self.folder)
                identity.give(self, connection)
                publish_all(self.folder, connection)

    def copy(self, label: str) -> str:
        copy = self._aside(label)
        make_file(copy)
        with closing(_connect(self.path)) as source, closing(sqlite3.connect(copy)) as target:
            source.backup(target)
        sync_folder(self.folder)
        return copy.name

    def renew(self, label: str) -> str:
        with _locked(self.folder):
            identity.require_unowned(self)
            aside = self._aside(label)
            for suffix in ("-journal", "-wal", "-shm"):  # else they would be taken for the new file's
                side = self.path.with_name(self.path.name + suffix)
                if side.exists():
                    side.rename(aside.with_name(aside.name + suffix))
            if self.exists():
                self.path.rename(aside)
            layout.make(self.folder)
            self._build(new=False)
        return aside.name if aside.exists() else ""

    def count_from(self, connection: Connection, kind: str, number: int) -> None:
        pass  # AUTOINCREMENT does

    def faults(self) -> list[str]:
        with closing(_connect(self.path)) as connection:
            found = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(20)")]
            orphans = len(connection.execute("PRAGMA foreign_key_check").fetchall())
            page = connection.execute("PRAGMA page_size").fetchone()[0]
        told = [] if found == ["ok"] else found
        if self.path.stat().st_size % page:  # SQLite reads zeros there
            told.append("its last page is cut off")
        return [*told, f"{orphans} rows whose run is missing"] if orphans else told

    def _aside(self, label: str) -> Path:
        moment = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
        return self.path.with_name(f"{self.path.name}.{label}.{moment}")

    def _build(self, *, new: bool) -> None:
        fresh = self.path.with_name("registry.db.new")
        for leftover in self.folder.glob("registry.db.new*"):
            leftover.unlink()
        make_file(fresh)
        with _migrating(fresh).begin() as connection:
            _migrate(connection)
            identity.give(self, connection, new=new)
        fresh.rename(self.path)
        sync_folder(self.folder)


_WRITING = ("PRAGMA journal_mode=DELETE", "PRAGMA synchronous=FULL")


def _migrating(path: Path) -> Engine:
    # Without foreign keys, since a batch migration replaces whole tables; no transaction can switch them off.
    return _engine(path, "BEGIN IMMEDIATE", *_WRITING)


def _migrate(connection: Connection) -> None:
    database.migrate(connection)
    if connection.exec_driver_sql("PRAGMA foreign_key_check").first():
        raise IntegrityError("registry.db has rows whose run is missing", "restore it from a copy")


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
    connection = sqlite3.connect(address, uri=True, timeout=database.WAIT, isolation_level=None)
    try:
        for pragma in ("PRAGMA trusted_schema=OFF", "PRAGMA cell_size_check=ON", *pragmas):
            connection.execute(pragma)
    except BaseException:
        connection.close()
        raise
    return connection


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds the folder's lock file, across processes; the system frees it when its holder dies.

    POSIX only, and no better than the file system's own locks, as SQLite itself.
    """
    deadline = time.monotonic() + database.WAIT
    with opened(folder / "registry.lock", "ab") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise busy(str(folder)) from None
                time.sleep(0.02)
        yield
