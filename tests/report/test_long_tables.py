"""Long tables are drawn in blocks of rows, and look as if they weren't."""

import io

import pytest
from rich.console import Console

from paddlectl.report import tables
from paddlectl.report.tables import RUNS, listed, table

ROW = {"run": "run-1", "method": "hdm", "task": "BoxDoor", "seed": 7, "status": "finished", "frames": 400_000}
ROWS = {
    "plain": {},
    "wide letters": {"scenario": "\N{CJK UNIFIED IDEOGRAPH-6F22}" * 6},
    "a line end": {"scenario": "a\nb"},
    "too long": {"scenario": "A, with GapBall, v2, " * 4},
    "one word": {"task": "x" * 64},
}


def drawn(rows: list[dict[str, object]]) -> str:
    file = io.StringIO()
    Console(file=file, markup=False, emoji=False, highlight=False, width=tables.width()).print(
        table(RUNS, rows)
    )
    return file.getvalue()


@pytest.mark.parametrize("width", ["40", "79", "80", "100", "200"])
@pytest.mark.parametrize("name", ROWS)
def test_blocks_arent_seen(monkeypatch: pytest.MonkeyPatch, name: str, width: str) -> None:
    monkeypatch.setenv("COLUMNS", width)
    rows = [ROW, ROW | ROWS[name], ROW] * 50
    in_blocks = drawn(rows)
    monkeypatch.setattr(tables, "BLOCK", 1)
    assert in_blocks == drawn(rows)


def test_what_isnt_listed_is_counted() -> None:
    assert len(listed(RUNS, [ROW], 1)) == 1
    assert listed(RUNS, [ROW], 1234)[1] == "1,233 more; --all lists them"
    assert len(listed(RUNS, [], 0)) == 1
