"""A PostgreSQL server of the tests' own: no network, no durability, gone when they end."""

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def binaries() -> Path | None:
    """Where `initdb` and `postgres` are; Debian doesn't put them on the path."""
    found = [Path(name).parent for name in [shutil.which("initdb")] if name]
    found += sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    return next((folder for folder in reversed(found) if (folder / "initdb").exists()), None)


def _user() -> str | None:
    """The server refuses to run as root."""
    if os.getuid():
        return None
    names = {entry.pw_name for entry in pwd.getpwall()}
    return "postgres" if "postgres" in names else "nobody"


class Server:
    """A server that is up.

    Attributes:
        socket: The folder of its socket.
    """

    def __init__(self, socket: Path, programs: Path) -> None:
        self.socket = socket
        self._programs = programs

    def new(self, files: Path, password: str = "") -> str:
        """The address of an empty database, for a registry with its files in that folder."""
        name = f"t{uuid.uuid4().hex}"
        self.run(f"CREATE DATABASE {name}", "postgres")
        secret = f":{password}" if password else ""
        return f"postgresql://paddle{secret}@/{name}?host={self.socket}&files={files}"

    def run(self, statement: str, database: str) -> None:
        import psycopg

        with psycopg.connect(
            host=str(self.socket), user="paddle", dbname=database, autocommit=True
        ) as connection:
            connection.execute(statement)  # type: ignore[call-overload]


@contextmanager
def server() -> Iterator[Server]:
    programs = binaries()
    if programs is None:
        pytest.skip("no PostgreSQL server: apt install postgresql")
    pytest.importorskip("psycopg", reason="no psycopg: pip install 'paddlectl[postgres]'")
    user = _user()
    folder = Path(tempfile.mkdtemp(prefix="paddlectl-pg-"))
    try:
        if user:
            shutil.chown(folder, user)
        data = folder / "data"
        options = ["-A", "trust", "-U", "paddle", "--no-sync", "-E", "UTF8", "--no-locale"]
        make = [programs / "initdb", "-D", data, *options]
        subprocess.run(make, user=user, check=True, capture_output=True, cwd=folder)
        quick = ["-c", "fsync=off", "-c", "full_page_writes=off", "-c", "max_connections=200"]
        line = [programs / "postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", *quick]
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(line, user=user, stdout=log, stderr=log, cwd=folder)
        try:
            _wait(folder, process)
            yield Server(folder, programs)
        finally:
            process.send_signal(signal.SIGQUIT)  # at once: nothing is written that is thrown away then
            process.wait(20)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _wait(folder: Path, process: subprocess.Popen[bytes]) -> None:
    import psycopg

    for _ in range(300):
        assert process.poll() is None, (folder / "log").read_text()
        try:
            psycopg.connect(host=str(folder), user="paddle", dbname="postgres").close()
        except psycopg.OperationalError:
            time.sleep(0.05)
        else:
            return
    raise AssertionError("the server didn't come up: " + (folder / "log").read_text())
