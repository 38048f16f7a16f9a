"""Connections to a PostgreSQL server that may never answer.

psycopg's own timeout is for one address of one host, and not for finding it: hence a thread for the whole.
"""

import threading
import time
from collections.abc import Sequence
from typing import Any

import psycopg

from paddlectl.errors import RegistryBusyError
from paddlectl.registry.index import database
from paddlectl.registry.index.addresses import without


class _Connection(psycopg.Connection[Any]):
    """One on which no answer takes longer than the longest wait for a lock and a bit."""

    place = ""

    def wait(self, gen: Any, interval: float = 0.1, timeout: float | None = None) -> Any:
        began, patience = time.monotonic(), timeout or database.WAIT + database.CONNECTING
        try:
            return super().wait(gen, interval, patience)
        except psycopg.OperationalError:
            if time.monotonic() - began < patience:
                raise
            self.close()
            raise _silent(self.place, patience) from None

    def rollback(self) -> None:
        if not self.closed:
            super().rollback()


def connected(place: str, secrets: Sequence[str], given: dict[str, Any]) -> Any:
    """A connection to a server.

    Args:
        place: The registry, for messages.
        secrets: What no message may hold.
        given: What `psycopg.connect` takes.

    Raises:
        RegistryBusyError: If there is none after 10 s.
        psycopg.Error: If the server can't be reached, or lets nobody in.
    """
    told: list[Any] = []

    def connect() -> None:
        try:
            told.append(_Connection.connect(**{"connect_timeout": int(database.CONNECTING), **given}))
        except Exception as error:
            told.append(error)

    thread = threading.Thread(target=connect, daemon=True)
    thread.start()
    thread.join(database.CONNECTING)
    found = told[0] if told else psycopg.errors.ConnectionTimeout()
    if isinstance(found, psycopg.errors.ConnectionTimeout):
        raise _silent(place, database.CONNECTING)
    if isinstance(found, psycopg.Error):
        raise type(found)(without(str(found), secrets)) from None
    if isinstance(found, Exception):
        raise found
    found.place = place
    return found


def _silent(place: str, seconds: float) -> RegistryBusyError:
    return RegistryBusyError(
        f"the registry {place} didn't answer within {seconds:g} s",
        "check the address, or try again when that server is well",
    )
