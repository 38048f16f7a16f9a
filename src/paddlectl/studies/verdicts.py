"""What a comparison allows to say, in words; and what limits it."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from paddlectl.experiments.curves import WINDOW
from paddlectl.statistics import COVERAGE
from paddlectl.studies.grouped import SCORES, Grouped
from paddlectl.whole import ranges

FEW = 5
"""Seeds below which intervals are too short to rely on."""
ALIKE = 1.05
"""Of two runs' lengths, at most; those of one budget end with their last whole round."""
LISTED = 4  # of one kind of note
TITLES = {
    "area_under_curve": "area under the curve",
    "jump_start": "jump-start",
    "final_score": "final score",
    "frames_to_success": "frames to 0.9",
}
UNDECIDED = "undecided"


def verdict_of(above: Mapping[str, Any], separable: bool) -> str:
    """`ahead`, `behind` or `level` by the interval of P(improvement); `undecided` with too few seeds."""
    if above["low"] is None or not separable:
        return UNDECIDED
    if above["low"] > 0.5:
        return "ahead"
    return "behind" if above["high"] < 0.5 else "level"


def sentences(chosen: str, against: Sequence[Mapping[str, Any]], figure: str) -> list[str]:
    """Of each other label `paddle is ahead of cup in A, B; level in C (area under the curve, 6 seeds)`."""
    others = dict.fromkeys(row["label"] for row in against)
    return [
        _sentence(chosen, other, [row for row in against if row["label"] == other], figure)
        for other in others
    ]


_OVER_ALL = {
    "ahead": "over all ahead",
    "level": "over all level",
    "behind": "over all behind",
    UNDECIDED: "too few seeds over all",
}
_FIRST = {"ahead": "is ahead of {}", "level": "is level with {}", "behind": "is behind {}"}


def _sentence(chosen: str, other: str, rows: Sequence[Mapping[str, Any]], figure: str) -> str:
    places: dict[str, list[str]] = {}
    for row in rows:
        if row["scenario"] is not None:
            places.setdefault(row[figure]["verdict"], []).append(row["scenario"])
    parts: list[str] = []
    for verdict, first in _FIRST.items():
        if verdict in places:
            said = verdict if parts else f"{chosen} {first.format(other)}"
            parts.append(f"{said} in {', '.join(places[verdict])}")
    if UNDECIDED in places:
        said = "too few seeds" if parts else f"too few seeds to tell {chosen} from {other}"
        parts.append(f"{said} in {', '.join(places[UNDECIDED])}")
    parts += [_OVER_ALL[row[figure]["verdict"]] for row in rows if row["scenario"] is None]
    counts = {n for row in rows if row["scenario"] is not None for n in row["n"]}
    return f"{'; '.join(parts)} ({TITLES[figure]}, {_seeds(counts)})"


def _seeds(counts: Iterable[int]) -> str:
    least, most = min(counts), max(counts)
    return f"{least} seed{'s' * (least != 1)}" if least == most else f"{least} to {most} seeds"


def notes_of(grouped: Grouped, chosen: str, older: int, short: int = 0) -> list[str]:
    """Few or unequal seeds, missing cells, short or unequal runs, several scales or versions."""
    found = [_few(grouped), _unequal(grouped), _absent(grouped), _frames(grouped), _scale(grouped)]
    if short:
        found.append(f"runs left out, as they are too short to have figures: {short}")
    found.append(_short(grouped))
    if older:
        found.append(f"older results left out: {older}; of a scenario, method and seed the newest run counts")
    found.append(_versions(grouped))
    if len(grouped.labels) == 1:
        found.append(f"there is nothing but {chosen} to compare")
    return [note for note in found if note]


def _cells(grouped: Grouped) -> Iterable[tuple[str, str, Mapping[int, Any]]]:
    for place in grouped.places:
        for label in grouped.labels:
            if cell := grouped.cell(place, label):
                yield place, label, cell


def _versions(grouped: Grouped) -> str:
    """A method may have changed between two versions without that its settings tell it."""
    versions = Counter(result.code for _, _, cell in _cells(grouped) for result in cell.values())
    told = [f"{version} ({count})" for version, count in sorted(versions.items())]
    return f"runs of several versions of paddlectl: {_listed(told)}" if len(told) > 1 else ""


def _few(grouped: Grouped) -> str:
    few = [f"{label} in {place} ({len(cell)})" for place, label, cell in _cells(grouped) if len(cell) < FEW]
    short = f"at four an interval covers {100 * COVERAGE[4][0]:.0f} % only"
    return f"fewer than {FEW} seeds, and {short}: {_listed(few)}" if few else ""


def _short(grouped: Grouped) -> str:
    short = [
        f"{label} in {place}"
        for place, label, cell in _cells(grouped)
        if any(result.episodes < WINDOW for result in cell.values())
    ]
    return (
        f"runs of fewer than {WINDOW} episodes, whose figures are of few: {_listed(short)}" if short else ""
    )


def _unequal(grouped: Grouped) -> str:
    unequal = []
    for place, label, cell in _cells(grouped):
        if lacking := [seed for seed in grouped.seeds(place) if seed not in cell]:
            unequal.append(f"{label} in {place} lacks {ranges(lacking)}")
    return f"unequal seeds: {_listed(unequal)}" if unequal else ""


def _absent(grouped: Grouped) -> str:
    absent = [
        f"{label} in {place}"
        for place in grouped.places
        for label in grouped.labels
        if not grouped.cell(place, label)
    ]
    if not absent:
        return ""
    shared = grouped.shared()
    over = f"over all is over {', '.join(shared)}" if len(shared) > 1 else "nothing is said over all"
    return f"no results of {_listed(absent)}; {over}"


def _frames(grouped: Grouped) -> str:
    unequal = []
    for place in grouped.places:
        frames = {
            label: [result.frames for result in grouped.cell(place, label).values()]
            for label in grouped.labels
            if grouped.cell(place, label)
        }
        lengths = [count for counts in frames.values() for count in counts]
        if max(lengths) > ALIKE * min(lengths):
            told = ", ".join(f"{label} {_range(counts)}" for label, counts in frames.items())
            unequal.append(f"{place} ({told})")
    return f"runs of unequal length, whose figures don't compare: {_listed(unequal)}" if unequal else ""


def _range(counts: Sequence[int]) -> str:
    least, most = min(counts), max(counts)
    return f"{most:,}" if most <= ALIKE * least else f"{least:,} to {most:,}"


def _scale(grouped: Grouped) -> str:
    scores = (
        values
        for figure in SCORES
        for label in grouped.labels
        for values in grouped.sample(figure, label, grouped.shared())
    )
    if all(((values >= 0) & (values <= 1)).all() for values in scores):
        return ""
    return "scores outside [0, 1]: no optimality gap, and means over all depend on each task's scale"


def _listed(texts: Sequence[str]) -> str:
    more = len(texts) - LISTED
    return "; ".join(texts[:LISTED]) + (f"; and {more} more" if more > 0 else "")
