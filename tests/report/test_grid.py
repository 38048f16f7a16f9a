"""Tables at every width: ids and names stay whole, no line is too long, and what is left out is said."""

import io
import re

import pytest
from rich.console import Console, RenderableType

from paddlectl.report import tables
from paddlectl.report.grid import Prose
from paddlectl.report.mapping import Labels, mapping_table
from paddlectl.report.tables import Column, percent, table
from samples import TARGET

WIDTHS = (*range(20, 101, 2), *range(110, 201, 15))
NAMES = {
    "policy": "policy-123456789", "run": "run-123456789", "name": TARGET, "task": TARGET, "method": "paddle",
    "scenario": "A scenario of a long name, with spaces and 5 commas", "domain": "minigrid",
    "status": "interrupted", "kind": "changed object",
    "where": f"objects/{'0123456789abcdef' * 4}.safetensors",
}  # fmt: skip
OTHERS = {
    "seed": 4_294_967_295, "frames": 1_000_000_000_000, "episodes": 1_000_000, "seconds": 123_456.7,
    "success_rate": 1.0, "mean_score": 0.99, "final_score": 0.99, "jump_start": 0.99, "mean_length": 320.0,
    "area_under_curve": 0.99, "crispness": 0.99, "horizon": 1000, "heads": range(7), "vocabulary": range(6),
    "fault": True,
    "summary": "Clear the door, take the key out of its box, open the door, fetch the green ball.",
    "what": f"no process goes on with it; run: paddlectl resume run-123456789 {'x' * 60}",
}  # fmt: skip
SHORT = {
    "policy": "policy-1",
    "run": "run-1",
    "task": "GapBall",
    "name": "GapBall",
    "seed": 0,
    "fault": False,
}
TABLES = {name: value for name, value in vars(tables).items() if name.isupper()}


def drawn(part: RenderableType, width: int) -> list[str]:
    file = io.StringIO()
    Console(file=file, width=width, markup=False, highlight=False).print(part, crop=False)
    return [line.rstrip() for line in file.getvalue().splitlines()]


def holds(lines: list[str], name: str) -> bool:
    whole = re.compile(rf"(?<!\S){re.escape(name)}(?!\S)")
    return any(whole.search(line) for line in lines)


@pytest.mark.parametrize("columns", TABLES.values(), ids=TABLES)
def test_at_every_width_ids_and_names_are_whole(columns: tuple[Column, ...]) -> None:
    rows = [NAMES | OTHERS, SHORT, NAMES | OTHERS | {"run": "run-7", "policy": "policy-7"}]
    shown = [column for column in columns if column.written is tables.label]
    for width in WIDTHS:
        lines = drawn(table(columns, rows), width)
        names = [str(row[column.field]) for column in shown for row in rows if column.field in row]
        assert all(holds(lines, name) for name in names), width
        assert all(len(line) <= width or line in names or "xxx" in line for line in lines), width


@pytest.mark.parametrize("columns", TABLES.values(), ids=TABLES)
def test_a_column_is_there_or_said_to_be_left_out(columns: tuple[Column, ...]) -> None:
    for width in WIDTHS:
        lines = drawn(table(columns, [NAMES | OTHERS]), width)
        told = " ".join(lines)
        columns = tuple(column for column in columns if not column.optional)
        assert all(column.title in told for column in columns), width
        out = [column.title for column in columns if column.title not in told.partition("Too narrow for")[0]]
        assert all(title in told.partition("Too narrow for")[2] for title in out)
        assert ("--json has all" in told) == bool(out)


def test_a_seed_is_shown_as_it_is_typed() -> None:
    lines = drawn(table(tables.EVALUATED, [NAMES | OTHERS]), 100)
    assert holds(lines, "4294967295") and holds(lines, "1,000,000")


def test_the_last_numbers_are_left_out_first() -> None:
    lines = drawn(table(tables.POLICIES, [NAMES | OTHERS | {"policy": "policy-1", "run": "run-1"}]), 80)
    assert lines[-1] == "Too narrow for success, score, length, crisp; --json has all."


def test_where_names_alone_are_too_wide_each_row_is_lines_with_all_of_it() -> None:
    lines = drawn(table(tables.RUNS, [SHORT | {"frames": 2048}, SHORT]), 20)
    assert lines[:3] == ["", "run: run-1", "name: GapBall"]
    assert "frames: 2,048" in lines and lines.count("policy: policy-1") == 2


def test_psi_keeps_its_numbers_and_its_atoms() -> None:
    tied = [["has_key(env)", "has_key(agent)"]] * 3
    scenes = [
        {
            "body": ["has_blockage(agent)", "is_blocked(door)", "!is_open(door)"],
            "self_similarity": 0.7,
            "matches": [
                {
                    "policy": f"policy-{n}",
                    "similarity": n / 10,
                    "scenes": tied,
                }
                for n in (6, 7)
            ],
        }
    ] * 2
    part = mapping_table(scenes, Labels({"policy-6": TARGET, "policy-7": TARGET}))
    for width in WIDTHS:
        lines = drawn(part, width)
        for word in (f"{TARGET} (policy-6)", f"{TARGET} (policy-7) *", "0.600", "0.700", "and 1 more"):
            assert any(word in line for line in lines) or width < len(word), (width, word)
        for atom in ("{has_blockage(agent),", "is_blocked(door)}", "{has_key(env),", "has_key(agent)}"):
            assert any(atom in line for line in lines), (width, atom)
        assert all(len(line) <= max(width, 36) for line in lines), width


def test_prose_breaks_between_words_only() -> None:
    text = "next: paddlectl explain run-123456789012345678901"
    assert drawn(Prose(text, 6), 20) == [
        "      next:",
        "      paddlectl",
        "      explain",
        "run-123456789012345678901",
    ]
    assert drawn(Prose(""), 20) == [""]


def test_what_is_not_all_is_never_called_a_hundred_percent() -> None:
    shares = (None, 0.0, 0.004, 0.5, 0.994, 0.995, 0.9996, 1.0)
    assert [*map(percent, shares)] == ["–", "0 %", "0 %", "50 %", "99 %", "99.5 %", "99.9 %", "100 %"]
