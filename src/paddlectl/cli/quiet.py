"""Standard streams: stdout is kept for the answer, and stderr stops nothing."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any, TextIO


@contextmanager
def stdout_kept() -> Iterator[None]:
    """Sends what is printed meanwhile to stderr, and asks pygame not to greet, here or in a child process."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    with redirect_stdout(sys.stderr):
        yield


class Courtesy:
    """A stream for messages. It leads nowhere once it can't be written: no run ends for want of it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError:
            self._lead_nowhere()
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            self._lead_nowhere()

    def _lead_nowhere(self) -> None:
        """What is left in the buffers goes there, too; it would be tried again at exit."""
        os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
