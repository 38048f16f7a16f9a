"""Lists of things as tables."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType
from rich.filesize import decimal

from paddlectl.report.grid import Grid, Head, Row
from paddlectl.report.output import clean


def words(value: Any) -> str:
    """Text that may break."""
    return "–" if value is None else str(value)


def label(value: Any) -> str:
    """An id or a name, which never breaks."""
    return words(value)


def seed(value: Any) -> str:
    """A number as it is typed."""
    return words(value)


def count(value: Any) -> str:
    return "–" if value is None else f"{value:,}"


def percent(share: Any) -> str:
    """Of what isn't all it never says 100 %."""
    if share is None:
        return "–"
    return f"{math.floor(1000 * share) / 10:.1f} %" if 0.995 <= share < 1.0 else f"{100 * share:.0f} %"


def figure(value: Any) -> str:
    return "–" if value is None else f"{value:.2f}"


def significant(value: Any) -> str:
    """Of a size that isn't known beforehand."""
    return "–" if value is None else f"{value:.3g}"


def thousandths(value: Any) -> str:
    return "–" if value is None else f"{value:.3f}"


def tenths(value: Any) -> str:
    return "–" if value is None else f"{value:.1f}"


def size(items: Any) -> str:
    return "–" if items is None else str(len(items))


def listing(values: Any) -> str:
    return ", ".join(values or ()) or "–"


def file_size(count: int) -> str:
    """Bytes as `15.1 MB`."""
    return decimal(count)


def yes(value: Any) -> str:
    return "yes" if value else "no"


@dataclass(frozen=True)
class Column:
    """A heading, the field below it, and how that is written.

    Words and labels are aligned left, numbers right. Where there is no room, numbers are left out, and what
    else is spare.
    One that needn't be there is left out where no row has anything in it.
    """

    title: str
    field: str
    written: Callable[[Any], str] = label
    optional: bool = False
    spare: bool = False

    @property
    def head(self) -> Head:
        number = self.written not in (words, label, yes, listing)
        return Head(self.title, right=number, breaks=self.written is words, spare=number or self.spare)


def table(columns: Iterable[Column], rows: Iterable[Mapping[str, Any]], title: str = "") -> Grid:
    """A table of rows by their fields; a field that a row lacks is shown as a dash."""
    rows = list(rows)
    columns = [each for each in columns if not each.optional or any(row.get(each.field) for row in rows)]
    cells = [Row([clean(column.written(row.get(column.field))) for column in columns]) for row in rows]
    return Grid([column.head for column in columns], cells, title, gap=2)


def listed(columns: Iterable[Column], rows: Sequence[Mapping[str, Any]], total: int) -> list[RenderableType]:
    """A table of the newest of so many rows, and how to see the others."""
    if not rows:
        return ["there are none"]
    more = total - len(rows)
    return [table(columns, rows), *([f"{more:,} more; --all lists them"] if more > 0 else [])]


FIGURES = (
    Column("jump-start", "jump_start", figure),
    Column("final score", "final_score", figure),
    Column("final success", "final_success", percent),
    Column("area under the curve", "area_under_curve", figure),
    Column("unseen success", "success_rate", percent),
    Column("unseen score", "mean_score", figure),
    Column("unseen length", "mean_length", tenths),
    Column("crisp", "crispness", figure),
)
"""A run's results."""


def figures_of(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What each of them is called, and how it is written."""
    return [(each.title, each.written(results[each.field])) for each in FIGURES if each.field in results]


def figures_text(results: Mapping[str, Any]) -> str:
    """All of them in a line."""
    return ", ".join(f"{name} {value}" for name, value in figures_of(results))


TASKS = (
    Column("task", "name"),
    Column("domain", "domain"),
    Column("horizon", "horizon", count),
    Column("subgoals", "heads", size),
    Column("facts", "vocabulary", size),
    Column("what it is", "summary", words),
)
POLICIES = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("method", "method"),
    Column("seed", "seed", seed),
    Column("frames", "frames", count),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
    Column("crisp", "crispness", figure),
    Column("run", "run"),
)
RUNS = (
    Column("run", "run"),
    Column("name", "name", optional=True),
    Column("method", "method"),
    Column("task", "task"),
    Column("scenario", "scenario"),
    Column("seed", "seed", seed),
    Column("status", "status"),
    Column("success", "success_rate", percent),
    Column("frames", "frames", count),
    Column("policy", "policy"),
    Column("tags", "tags", listing, optional=True, spare=True),
)
LABELLED = (
    Column("run", "run"),
    Column("name", "name"),
    Column("tags", "tags", listing),
    Column("method", "method"),
    Column("task", "task"),
    Column("seed", "seed", seed),
)
TRAINED = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("seed", "seed", seed),
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
    Column("seed", "seed", seed),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("jump-start", "jump_start", figure),
    Column("final", "final_score", figure),
    Column("area", "area_under_curve", figure),
    Column("unseen success", "success_rate", percent),
    Column("policy", "policy"),
)
EVALUATED = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("episodes", "episodes", count),
    Column("seed", "seed", seed),
    Column("success", "success_rate", percent),
    Column("score", "mean_score", figure),
    Column("length", "mean_length", tenths),
)
UNUSUAL = (
    Column("name", "name"),
    Column("here", "value", words),
    Column("usually", "usual", words),
)
SIMILAR = (
    Column("policy", "policy"),
    Column("task", "task"),
    Column("mean ψ", "similarity", thousandths),
)
FINDINGS = (
    Column("fault", "fault", yes),
    Column("kind", "kind"),
    Column("where", "where"),
    Column("what", "what", words),
)
RESUMED = (
    Column("run", "run"),
    Column("policy", "policy"),
    Column("seed", "seed", seed),
    Column("frames", "frames", count),
    Column("seconds", "seconds", tenths),
    Column("success", "success_rate", percent),
)
