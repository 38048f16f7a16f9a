"""What stdout and stderr show in each encoding that Python has: symbols that it lacks are spelled."""

import codecs
import encodings
import io
import pkgutil
import string
import sys
from collections.abc import Callable

import pytest
from rich.console import Console

from paddlectl.cli import app
from paddlectl.registry.store import Registry
from paddlectl.report.explained import explanation_parts
from paddlectl.report.explanation import explanation_document
from paddlectl.report.output import print_text
from paddlectl.report.spelling import ERRORS, spelled
from samples import Command

Shown = Callable[[str, str], tuple[str, str]]
SYMBOLS = "ΨψΦΛγ→←≥≤×·–…²─"


def works(name: str) -> bool:
    """Whether Python itself could print a line in it and read it back; punycode, for one, has no lines."""
    try:
        line = f"{string.ascii_letters}{string.digits} ()-+|\n"
        return codecs.lookup(name)._is_text_encoding and (line * 2).encode(name).decode(name) == line * 2
    except (LookupError, UnicodeError):
        return False


ENCODINGS = [
    name
    for name in sorted(module.name for module in pkgutil.iter_modules(encodings.__path__))
    if works(name) and name not in ("idna", "punycode", "unicode_escape")
]


def test_there_are_many_encodings() -> None:
    assert len(ENCODINGS) > 100 and {"ascii", "latin_1", "cp437", "koi8_r", "cp864", "utf_16"} <= {*ENCODINGS}


@pytest.mark.parametrize("name", ENCODINGS)
def test_no_symbol_is_lost_and_no_two_look_alike(name: str) -> None:
    shown = [spelled(symbol, name) for symbol in SYMBOLS if symbol not in "–─"]
    assert len({*shown}) == len(shown) and all(shown) and "?" not in "".join(shown)
    assert spelled("é", name) != spelled("è", name)
    assert spelled("100 %", name) in ("100 %", "100 pct")
    assert spelled(string.ascii_letters, name) == string.ascii_letters


@pytest.fixture
def shown(registry: Registry, command: Command, monkeypatch: pytest.MonkeyPatch) -> Shown:
    """What a command line prints in an encoding, decoded again."""

    def run(line: str, encoding: str) -> tuple[str, str]:
        files = io.BytesIO(), io.BytesIO()
        with monkeypatch.context() as patched:
            for name, file in zip(("stdout", "stderr"), files, strict=True):
                patched.setattr(sys, name, io.TextIOWrapper(file, encoding, newline="\n", write_through=True))
            patched.setattr(sys, "argv", ["paddlectl", *line.split()])
            app.main()
            out, err = (file.getvalue().decode(encoding) for file in files)
        return out, err

    return run


def test_every_column_can_be_told_from_the_others(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = registry.run("run-3")
    parts = explanation_parts(explanation_document(registry, run), run)
    for name in ENCODINGS:
        file = io.BytesIO()
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", io.TextIOWrapper(file, name, ERRORS, newline="\n"))
            print_text(parts)
            out = file.getvalue().decode(name)
        assert not {"?", "\N{REPLACEMENT CHARACTER}"} & {*out}, name
        heads = next(line for line in out.splitlines() if "phase" in line and "chosen" in line)
        figures = [spelled(symbol, name) for symbol in "ψΦΛ"]
        assert heads.replace("|", " ").split() == ["phase", "policy", *figures, "chosen", "reached"]


def test_help_and_errors_are_spelled_too(shown: Shown) -> None:
    for name in ("ascii", "cp437", "cp864", "cp037", "gbk", "utf_16"):
        for line in ("--help", "similarity --help", "explain", "explain --full"):
            out, err = shown(line, name)
            assert err == "" and "?" not in out, (name, line)
        out, err = shown("show →ψ×é", name)
        assert (out, err.splitlines()[0]) == ("", f"error: no policy for {spelled('→ψ×é', name)}")


def test_a_frame_is_drawn_in_what_the_encoding_has() -> None:
    lines = spelled("╭─ x ─╮", "ascii")
    assert lines == "+- x -+"
    assert Console(file=io.TextIOWrapper(io.BytesIO(), encoding="koi8_r", errors=ERRORS)).options.ascii_only
