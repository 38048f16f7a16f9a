"""Lists of things as Rich tables."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import RenderableType
from rich.table import Table

from paddlectl.report.output import clean, width

NARROWEST = 8  # columns of a text that has to break
BLOCK = 100  # lines that Rich gets as one row, where none breaks: it takes 0.1 ms for each cell

Row = Mapping[str, Any]


def words(value: Any) -> str:
    return "–" if value is None else str(value)


def label(value: Any) -> str:
    return words(value)


def count(value: Any) -> str:
    return "–" if value is None else f"{value:,}"


def percent(share: Any) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def figure(value: Any) -> str:
    return "–" if value is None else f"{value:.2f}"


def tenths(value: Any) -> str:
    return "–" if value is None else f"{value:.1f}"


def size(items: Any) -> str:
    return str(len(items))


def yes(value: Any) -> str:
    return "yes" if value else "no"


@dataclass(frozen=True)
class Column:
    """A heading, the field below it, and how that is written.

    Words and labels are aligned left, numbers right. In 80 columns only words break: half an id or number is
    of no use. In fewer all may, for else Rich leaves columns out.
    """

    title: str
    field: str
    written: Callable[[Any], str] = words

    def cell(self, row: Row) -> str:
        return clean(self.written(row.get(self.field)))


def table(columns: Iterable[Column], rows: Iterable[Row], title: str = "") -> Table:
    """A table of rows by their fields; a field that a row lacks is shown as a dash."""
    columns = tuple(columns)
    wide = width() >= 80
    drawn = Table(
        title=title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    for column in columns:
        drawn.add_column(
            column.title,
            justify="left" if column.written in (words, label, yes) else "right",
            overflow="fold",
            no_wrap=wide and column.written is not words,
            min_width=NARROWEST if wide and column.written is words else None,
        )
    lines = [[column.cell(row) for column in columns] for row in rows]
    block = BLOCK if _fit(columns, lines) else 1
    for start in range(0, len(lines), block):
        drawn.add_row(*("\n".join(cells) for cells in zip(*lines[start : start + block], strict=True)))
    return drawn


def _fit(columns: Sequence[Column], lines: Sequence[Sequence[str]]) -> bool:
    """Whether surely no cell has to break."""
    titles = [column.title for column in columns]
    widest = [max(map(cell_len, cells)) for cells in zip(titles, *lines, strict=True)]
    broken = any("\n" in cell for line in lines for cell in line)
    return not broken and sum(max(wide, NARROWEST) + 2 for wide in widest) <= width()


def listed(columns: Iterable[Column], rows: Sequence[Row], total: int) -> list[RenderableType]:
    """A table of the newest of so many rows, and how to see the others."""
    more = total - len(rows)
    return [table(columns, rows), *([f"{more:,} more; --all lists them"] if more > 0 else [])]


TASKS = (
    Column("task", "name"),
    Column("domain", "domain", label),
    Column("horizon", "horizon", count),
    Column("heads", "heads", size),
    Column("facts", "vocabulary", size),
    Column("what it is", "summary"),
)
POLICIES = (
    Column("policy", "policy", label),
    Column("task", "task"),
    Column("method", "method", label),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
    Column("crisp", "crispness", figure),
    Column("run", "run", label),
)
RUNS = (
    Column("run", "run", label),
    Column("method", "method", label),
    Column("task", "task"),
    Column("scenario", "scenario"),
    Column("seed", "seed", count),
    Column("status", "status", label),
    Column("frames", "frames", count),
    Column("success", "success_rate", percent),
    Column("policy", "policy", label),
)
TRAINED = (
    Column("policy", "policy", label),
    Column("task", "task"),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("crisp", "crispness", figure),
    Column("run", "run", label),
)
TRANSFERRED = (
    Column("run", "run", label),
    Column("method", "method", label),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("jump-start", "jump_start", figure),
    Column("final", "final_score", figure),
    Column("success", "success_rate", percent),
    Column("area", "area_under_curve", figure),
    Column("policy", "policy", label),
)
EVALUATED = (
    Column("policy", "policy", label),
    Column("task", "task"),
    Column("episodes", "episodes", count),
    Column("seed", "seed", count),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
)
FINDINGS = (
    Column("fault", "fault", yes),
    Column("kind", "kind", label),
    Column("where", "where"),
    Column("what", "what"),
)
RESUMED = (
    Column("run", "run", label),
    Column("policy", "policy", label),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("success", "success_rate", percent),
)
