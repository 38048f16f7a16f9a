"""Keeps stdout for the answer, whatever the packages below print while they are imported or run."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout


@contextmanager
def stdout_kept() -> Iterator[None]:
    """Sends what is printed meanwhile to stderr, and asks pygame not to greet, here or in a child process."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    with redirect_stdout(sys.stderr):
        yield
