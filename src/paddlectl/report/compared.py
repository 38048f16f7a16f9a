"""A comparison for people: one figure of each method, each against the chosen one, and what that says."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import RenderableType

from paddlectl.report.grid import Heading
from paddlectl.report.output import clean
from paddlectl.report.tables import Column, count, percent, table
from paddlectl.studies.verdicts import TITLES

FRAMES = "frames_to_success"
BEST, TIE = "*", "="
_P = "P is the probability that it does better than the other; the difference is of pairs of seeds."
_LEGEND = f"{BEST} the best; {TIE} the best and what the seeds don't tell apart from it."


def compared_parts(document: Mapping[str, Any], figure: str) -> list[RenderableType]:
    """Tables and verdicts of one figure, and what limits them."""
    title = TITLES[figure]
    parts: list[RenderableType] = [f"{title[0].upper()}{title[1:]}, with 95 % intervals over seeds"]
    parts.append(table(_columns(figure), _cells(document, figure)))
    if document["overall"]["labels"]:
        parts += [f"Over all: {', '.join(map(clean, document['overall']['scenarios']))}"]
        parts.append(table(_overall_columns(figure), _overall(document, figure)))
    parts.append(_LEGEND)
    if document["against"]:
        parts += [Heading(clean(f"{document['of']} against the others"))]
        parts.append(table(_against_columns(figure), _against(document, figure)))
        parts += [_P, ""]
        parts += map(clean, document["verdicts"][figure])
    return [*parts, "", *(f"note: {clean(note)}" for note in document["notes"]), _coverage(document)]


def estimate(value: Any) -> str:
    """`0.81 [0.78, 0.84]`; without the interval where one seed gives none."""
    return _written(value, "{:.2f}".format)


def change(value: Any) -> str:
    """The same with a sign."""
    return _written(value, "{:+.2f}".format)


def frames(value: Any) -> str:
    """`241,000 [201,000, never]`."""
    return _written(value, lambda number: f"{round(number):,}" if math.isfinite(number) else "never")


def frames_change(value: Any) -> str:
    """The same with a sign."""
    return _written(value, lambda number: f"{round(number):+,}")


def _written(value: Mapping[str, Any] | None, written: Any) -> str:
    if value is None:
        return "–"
    ends = f" [{written(value['low'])}, {written(value['high'])}]" if value["low"] is not None else ""
    return f"{written(value['value'])}{ends}"


def _columns(figure: str) -> tuple[Column, ...]:
    """What is spared in a narrow terminal comes last."""
    names = (Column("scenario", "scenario"), Column("method", "shown"), Column("n", "n", count))
    first, second, last = _kinds(figure)
    return (*names, first, second, Column("source frames", "source_frames", count), last)


def _overall_columns(figure: str) -> tuple[Column, ...]:
    first, second, last = _kinds(figure)
    gap = () if figure == FRAMES else (Column("gap", "optimality_gap", estimate),)
    return (Column("method", "shown"), Column("n", "n", count), first, second, *gap, last)


def _kinds(figure: str) -> tuple[Column, Column, Column]:
    if figure == FRAMES:
        median, middle = Column("median", "median", frames), Column("IQM", "iqm", frames)
        return Column("reached", "reached", count), median, middle
    iqm, mean = Column("IQM", "iqm", estimate), Column("mean", "mean", estimate)
    return iqm, mean, Column("median", "median", estimate)


def _against_columns(figure: str) -> tuple[Column, ...]:
    return (
        Column("scenario", "scenario"),
        Column("against", "label"),
        Column("it is", "verdict"),
        Column("P", "probability_of_improvement", estimate),
        Column("difference", "difference", frames_change if figure == FRAMES else change),
        Column("pairs", "pairs", count),
    )


def _cells(document: Mapping[str, Any], figure: str) -> Iterable[Mapping[str, Any]]:
    for cell in document["cells"]:
        yield cell | cell[figure] | {"shown": _marked(document, figure, cell["scenario"], cell["label"])}


def _overall(document: Mapping[str, Any], figure: str) -> Iterable[Mapping[str, Any]]:
    for row in document["overall"]["labels"]:
        yield row | row[figure] | {"shown": _marked(document, figure, None, row["label"])}


def _against(document: Mapping[str, Any], figure: str) -> Iterable[Mapping[str, Any]]:
    for row in document["against"]:
        yield row | row[figure] | {"scenario": row["scenario"] or "over all"}


def _marked(document: Mapping[str, Any], figure: str, scenario: str | None, label: str) -> str:
    """The label with a star if it is the best, with `=` if it is one of several that aren't told apart."""
    best = next(
        row["labels"] for row in document["best"] if (row["scenario"], row["figure"]) == (scenario, figure)
    )
    mark = "" if label not in best or len(document["labels"]) == 1 else BEST if len(best) == 1 else TIE
    return f"{label} {mark}".rstrip()


def _coverage(document: Mapping[str, Any]) -> str:
    shares = document["intervals"]["coverage"].items()
    told = ", ".join(f"{percent(low)} to {percent(high)} at {seeds} seeds" for seeds, (low, high) in shares)
    return f"In simulated studies such an interval covers the truth in {told}."
