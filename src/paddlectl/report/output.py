"""Where answers go: one JSON document, or text for people, on stdout; nothing stored is taken for markup."""

import json
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live

from paddlectl.report.grid import Prose

_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
_WIDTH = 100  # of a pipe or file; a terminal has its own


def clean(text: object) -> str:
    """The text without control characters and direction marks, so that it can't steer a terminal."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", str(text))


def console() -> Console:
    """A console on stdout that reads no markup, emoji codes or highlights into what it prints."""
    return Console(markup=False, emoji=False, highlight=False, width=width())


def print_json(document: Any) -> None:
    """One JSON document on stdout; numbers that JSON lacks become null."""
    text = json.dumps(_finite(document), indent=2, allow_nan=False)
    with _answered():
        sys.stdout.write(text + "\n")
        sys.stdout.flush()


def height(parts: Sequence[RenderableType]) -> int:
    """How many lines `print_text` makes of them."""
    out = console()
    with out.capture() as captured:
        _print(out, parts)
    return captured.get().count("\n")


def print_text(parts: Sequence[RenderableType]) -> None:
    """Renderables one below the other on stdout."""
    with _answered():
        _print(console(), parts)
        sys.stdout.flush()


@contextmanager
def _answered() -> Iterator[None]:
    """Tells apart a fault of stdout: the command has done its work before it answers."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        why = f"the answer can't be written to standard output: {error.strerror}; what was asked for is done"
        raise OSError(error.errno, why) from error


def print_paged(parts: Sequence[RenderableType]) -> None:
    """The same, on a terminal in the user's pager."""
    out = console()
    if not out.is_terminal:
        print_text(parts)
        return
    os.environ.setdefault("LESS", "-R")  # so that it shows colours
    with out.pager(styles=True):
        _print(out, parts)


class LivePictures:
    """Pictures in one place of the terminal, one after another, each with a caption below."""

    def __init__(self) -> None:
        self._live = Live(console=console(), auto_refresh=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    @property
    def encoding(self) -> str:
        """Of the terminal."""
        return self._live.console.encoding

    def show(self, picture: RenderableType, caption: str) -> None:
        """Puts this one in the place of the last."""
        self._live.update(Group(picture, Prose(clean(caption))), refresh=True)


def print_live(told: Callable[[], Sequence[RenderableType]], seconds: float) -> None:
    """What `told` gives, in the same place again and again until ^C."""
    with Live(console=console(), auto_refresh=False) as live:
        while True:
            live.update(
                Group(*(Prose(part) if isinstance(part, str) else part for part in told())), refresh=True
            )
            time.sleep(seconds)


def _print(out: Console, parts: Sequence[RenderableType]) -> None:
    for part in parts:
        out.print(Prose(part) if isinstance(part, str) else part, crop=False)


def width() -> int:
    """Columns to fill: those that COLUMNS says, else a terminal's own, else 100."""
    told = os.environ.get("COLUMNS", "")
    if told.isdecimal() and int(told) > 0:  # some shells say 0 for unknown, which would print nothing
        return int(told)
    return os.get_terminal_size(sys.stdout.fileno()).columns or _WIDTH if sys.stdout.isatty() else _WIDTH


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
