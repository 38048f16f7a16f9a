"""Servers that accept and say nothing, or say what no PostgreSQL says: an error soon, and a hint."""

import socket
import sqlite3
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli import completion
from paddlectl.errors import PaddlectlError, RegistryBusyError
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.index import database
from paddlectl.registry.store import Registry

pytest.importorskip("psycopg", reason="no psycopg: pip install 'paddlectl[postgres]'")
GREETING = b"".join(
    kind + struct.pack("!i", len(body) + 4) + body
    for kind, body in ((b"R", struct.pack("!i", 0)), (b"S", b"server_version\x0016.0\x00"), (b"Z", b"I"))
)
"""Let in, and ready for questions."""


@contextmanager
def listening(answer: Callable[[socket.socket], Any]) -> Iterator[int]:
    """The port of a server that gives every client to `answer` and then says nothing more."""
    with ExitStack() as stack, socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    client = stack.enter_context(server.accept()[0])
                    answer(client)
                except OSError:
                    return

        threading.Thread(target=serve, daemon=True).start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)


def silent(_: socket.socket) -> None:
    pass


def letting_in(client: socket.socket) -> None:
    (length,) = struct.unpack("!i", client.recv(4))
    if length == 8:  # a wish for TLS or GSS
        client.recv(4)
        client.sendall(b"N")
        return letting_in(client)
    client.recv(length)
    client.sendall(GREETING)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> float:
    monkeypatch.setattr(database, "CONNECTING", 0.4)
    monkeypatch.setattr(database, "WAIT", 0.2)
    monkeypatch.setattr(completion, "PATIENCE", 0.2)
    return 10.0  # even on a busy machine; whoever is patient takes far longer


def expect_busy(address: str, seconds: float) -> None:
    for work in (Registry.open, check, repair):
        began = time.monotonic()
        with pytest.raises(RegistryBusyError, match=r"didn't answer within 0\.[46] s") as caught:
            work(address)
        assert time.monotonic() - began < seconds
        assert "check the address" in caught.value.hint
    for names in (completion.policy_names, completion.transfer_names, completion.ended_names):
        began = time.monotonic()
        assert names(address) == []
        assert time.monotonic() - began < seconds / 2


@pytest.mark.parametrize("hosts", [1, 50])
def test_a_server_that_accepts_and_says_nothing(hosts: int, impatient: float, tmp_path: Path) -> None:
    with listening(silent) as port:
        several = "&".join(f"host=127.0.0.1:{port}" for _ in range(hosts))
        expect_busy(f"postgresql://me@/db?{several}&files={tmp_path}/files", impatient)
    assert not (tmp_path / "files").exists()


def test_one_that_lets_in_and_answers_no_question(impatient: float, tmp_path: Path) -> None:
    with listening(letting_in) as port:
        expect_busy(f"postgresql://me@127.0.0.1:{port}/db?files={tmp_path}/files", impatient)


def test_a_name_that_nobody_resolves(
    impatient: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socket.getaddrinfo", lambda *_, **__: time.sleep(30))
    expect_busy(f"postgresql://me@nowhere.invalid/db?files={tmp_path}/files", impatient)


@pytest.mark.parametrize(
    "garbage",
    [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0" * 100, b"S\xff\xfe\x1b[2J", b"N", b"E\xff\xff\xff\xff\x80"],
)
def test_one_that_says_what_no_server_says(garbage: bytes, impatient: float, tmp_path: Path) -> None:
    def answer(client: socket.socket) -> None:
        client.sendall(garbage)
        client.shutdown(socket.SHUT_WR)

    with listening(answer) as port, pytest.raises(PaddlectlError) as caught:
        Registry.open(f"postgresql://me@127.0.0.1:{port}/db?files={tmp_path}/files")
    assert caught.value.exit_code in (1, 6)
    assert caught.value.message.isprintable() and caught.value.hint
    assert not (tmp_path / "files").exists()


def test_a_writer_that_holds_the_index_doesnt_hold_completion(
    registry: Registry, impatient: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "WAIT", 30.0)
    with closing(sqlite3.connect(registry.folder / "registry.db", isolation_level=None)) as connection:
        connection.execute("BEGIN EXCLUSIVE")
        began = time.monotonic()
        assert completion.transfer_names(registry.location) == []
        assert time.monotonic() - began < impatient
