"""Who was followed, over training and in which scenes, and what else a method has to tell: for any method."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import RenderableType

from paddlectl.registry.names import shortened
from paddlectl.report.grid import Grid, Head, Heading, Prose, Row
from paddlectl.report.mapping import Labels, scene_text
from paddlectl.report.output import clean
from paddlectl.report.tables import count, percent, significant, yes

MOST_PERIODS = 20
MOST_CANDIDATES = 8
MOST_SCENES = 10
MOST_VALUES = 20

OTHERS = "others"
SHARES = ("share", "success")
"""How the names of a document's fields begin whose numbers are written in percent."""

Document = Mapping[str, Any]
Context = tuple[str, ...]


def followed_parts(rows: Sequence[Document], labels: Labels) -> list[RenderableType]:
    """The share of each candidate in the choices of each period, and the last period by scene.

    Args:
        rows: Of a run's table `reuse`, checked.
        labels: Short names for its policies.
    """
    periods = sorted({row["frames"] for row in rows})
    shown = periods[-MOST_PERIODS:]
    earlier = len(periods) - len(shown)
    more = [f"{earlier:,} earlier periods are told by --json only."] if earlier else []
    return [
        Heading("Who was followed over training, share of the choices"),
        _periods_table([row for row in rows if row["frames"] >= shown[0]], shown, labels),
        *more,
        *_scenes_parts([row for row in rows if row["frames"] == periods[-1]], labels),
    ]


def shown_contexts(rows: Sequence[Document]) -> list[Context]:
    """Those that are scenes, of all that `followed_parts` tells of."""
    last = max((row["frames"] for row in rows), default=0)
    scenes = _by_context([row for row in rows if row["frames"] == last])
    return [context for context in [*scenes][:MOST_SCENES] if _is_scene(context)]


def document_parts(documents: Mapping[str, Document], labels: Labels) -> list[RenderableType]:
    """A method's own documents: plain values, and plain values by name; the rest is for `--json`."""
    parts: list[RenderableType] = []
    for name, document in documents.items():
        parts += [Heading(words(name)), *value_lines(document, labels)]
    return parts


def value_lines(document: Document, labels: Labels) -> list[str]:
    """A line for each of the first of its values."""
    told = [f"{_words(field)}: {_value(field, value, labels)}" for field, value in document.items()]
    more = [f"and {len(told) - MOST_VALUES:,} more; --json has all"] if len(told) > MOST_VALUES else []
    return told[:MOST_VALUES] + more


def words(name: str) -> str:
    """A document's name as a heading."""
    return _words(name).capitalize()


def _periods_table(rows: Sequence[Document], periods: Sequence[int], labels: Labels) -> Grid:
    chosen: dict[int, Counter[str]] = {frames: Counter() for frames in periods}
    for row in rows:
        chosen[row["frames"]][row["source"]] += row["chosen"]
    candidates = _most_followed(chosen.values())
    left = len({row["source"] for row in rows}) - len(candidates)
    lines = []
    for frames, of_period in chosen.items():
        total = of_period.total()
        shares = [of_period[candidate] for candidate in candidates]
        shares += [total - sum(shares)] if left else []
        lines.append(Row((count(frames), count(total), *(_share(part, total) for part in shares))))
    names = [*map(labels, candidates), *([OTHERS] if left else [])]
    return Grid([Head(name, right=True) for name in ("until frame", "choices", *names)], lines)


def _most_followed(chosen: Iterable[Counter[str]]) -> list[str]:
    """Candidates in the order of the rows; of too many those that were followed most."""
    total: Counter[str] = Counter()
    for of_period in chosen:
        total.update(of_period)
    most = {candidate for candidate, _ in total.most_common(MOST_CANDIDATES)}
    return [candidate for candidate in total if candidate in most]


def _scenes_parts(rows: Sequence[Document], labels: Labels) -> Iterator[RenderableType]:
    scenes = _by_context(rows)
    totals = {context: _total(of_scene) for context, of_scene in scenes.items()}
    everything = sum(totals.values())
    yield Heading("Who was followed in which scene in the last period; * marks who was followed most")
    yield "Each weight, and the terms that it is made of, are means over the choices in that scene."
    for context in [*scenes][:MOST_SCENES]:
        share = f"{_share(totals[context], everything)} of the choices"
        yield Prose(scene_text(context) if _is_scene(context) else clean(", ".join(context)), style="bold")
        yield Prose(f"{totals[context]:,} choices, {share}.", 2)
        yield _scene_table(scenes[context], labels)
    rest = [*totals.values()][MOST_SCENES:]
    if rest:
        yield f"Less frequent, and told by --json only: {len(rest):,} scenes, {sum(rest):,} choices."


def _by_context(rows: Iterable[Document]) -> dict[Context, list[Document]]:
    """Its rows for each context in which somebody was followed, the most frequent first."""
    grouped: dict[Context, list[Document]] = {}
    for row in rows:
        grouped.setdefault(tuple(row["context"]), []).append(row)
    met = [(context, of_scene) for context, of_scene in grouped.items() if _total(of_scene)]
    return dict(sorted(met, key=lambda one: -_total(one[1])))


def _scene_table(rows: Sequence[Document], labels: Labels) -> Grid:
    """A line for each candidate, the one that was followed most first."""
    terms = dict.fromkeys(term for row in rows for term in row["terms"])
    total = _total(rows)
    reached = any(row.get("reached") is not None for row in rows)
    ordered = sorted(rows, key=lambda row: -row["chosen"])
    lines = []
    for place, row in enumerate(ordered[:MOST_CANDIDATES]):
        cells = [labels(row["source"]) + (" *" if place == 0 else ""), _share(row["chosen"], total)]
        cells += [significant(row["weight"]), *(significant(row["terms"].get(term)) for term in terms)]
        cells += [_reached(row)] if reached else []
        lines.append(Row(cells, "bold" if place == 0 else ""))
    if left := ordered[MOST_CANDIDATES:]:
        lines.append(Row([OTHERS, _share(_total(left), total), *[""] * (1 + len(terms) + reached)]))
    titles = ("followed", "weight", *map(clean, terms), *(["reached"] if reached else []))
    heads = [Head(title, right=True, spare=place > 0) for place, title in enumerate(titles)]
    return Grid([Head("policy"), *heads], lines, indent=2)


def _reached(row: Document) -> str:
    """How often it then reached what was wanted."""
    reached = row.get("reached")
    return "–" if reached is None else _share(reached, row["chosen"])


def _total(rows: Iterable[Document]) -> int:
    return sum(row["chosen"] for row in rows)


def _share(part: int, total: int) -> str:
    return percent(part / total if total else None)


def _is_scene(context: Context) -> bool:
    """Whether it is made of literals; else it is a name."""
    return all(literal.endswith(")") for literal in context)


def _value(field: str, value: Any, labels: Labels) -> str:
    share = field.startswith(SHARES)
    if not isinstance(value, dict):
        return _plain(value, labels, share)
    told = [f"{_name(name, labels)} {_plain(one, labels, share)}" for name, one in value.items()]
    more = [f"and {len(told) - MOST_VALUES:,} more"] if len(told) > MOST_VALUES else []
    return ", ".join(told[:MOST_VALUES] + more)


def _plain(value: Any, labels: Labels, share: bool) -> str:
    match value:
        case bool():
            return yes(value)
        case float() if share and 0.0 <= value <= 1.0:
            return percent(value)
        case str():
            return _name(value, labels)
        case int() | float() | None:
            return significant(value)
    return "see --json"


def _name(text: str, labels: Labels) -> str:
    return labels(shortened(text))


def _words(name: str) -> str:
    return clean(shortened(name).replace("_", " "))
