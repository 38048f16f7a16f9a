"""Lists of things as Rich tables."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.table import Table

from paddlectl.report.output import clean

Row = Mapping[str, Any]


def words(value: Any) -> str:
    return "–" if value is None else str(value)


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


@dataclass(frozen=True)
class Column:
    """A heading, the field below it, and how that is written; what isn't words is aligned right."""

    title: str
    field: str
    written: Callable[[Any], str] = words

    def cell(self, row: Row) -> str:
        return clean(self.written(row.get(self.field)))


def table(columns: Iterable[Column], rows: Iterable[Row], title: str = "") -> Table:
    """A table of rows by their fields; a field that a row lacks is shown as a dash."""
    columns = tuple(columns)
    drawn = Table(
        title=title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    for column in columns:
        drawn.add_column(
            column.title, justify="left" if column.written is words else "right", overflow="fold"
        )
    for row in rows:
        drawn.add_row(*(column.cell(row) for column in columns))
    return drawn


TASKS = (
    Column("task", "name"),
    Column("domain", "domain"),
    Column("horizon", "horizon", count),
    Column("heads", "heads", size),
    Column("facts", "vocabulary", size),
    Column("what it is", "summary"),
)
POLICIES = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("method", "method"),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
    Column("crisp", "crispness", figure),
    Column("run", "run"),
)
RUNS = (
    Column("run", "run"),
    Column("kind", "kind"),
    Column("method", "method"),
    Column("task", "task"),
    Column("scenario", "scenario"),
    Column("seed", "seed", count),
    Column("status", "status"),
    Column("frames", "frames", count),
    Column("success", "success_rate", percent),
    Column("policy", "policy"),
)
TRAINED = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("crisp", "crispness", figure),
    Column("run", "run"),
)
TRANSFERRED = (
    Column("run", "run"),
    Column("method", "method"),
    Column("seed", "seed", count),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("jump-start", "jump_start", figure),
    Column("final", "final_score", figure),
    Column("success", "success_rate", percent),
    Column("area", "area_under_curve", figure),
    Column("policy", "policy"),
)
EVALUATED = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("episodes", "episodes", count),
    Column("seed", "seed", count),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
)
