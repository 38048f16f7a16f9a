"""Whole numbers and seeds as they are typed, and what to type instead of other ways to write them."""

import re
from collections.abc import Iterable
from decimal import Decimal

from paddlectl.errors import UsageError
from paddlectl.registry.fields import MOST_SEEDS, SEEDS
from paddlectl.registry.names import shortened

MOST_DIGITS = 18

_DECIMAL = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]{1,3})?")
_GROUPED = re.compile(r"[-+]?[0-9]{1,3}([,'_ \u00a0\u202f][0-9]{3})+|[-+]?[0-9]+(_[0-9]+)+")
_SUFFIXED = re.compile(r"([0-9]+(?:\.[0-9]+)?) ?([kKmM])")
_POWERS = {"k": 3, "m": 6}
_TO = re.compile(r"\s*(?:\.{2,3}|[-:\u2013\u2014\u2212]|\bto\b)\s*")


def whole(text: str) -> int | None:
    """The number that a decimal text is exactly, such as `400000`, `4e5` and `400000.0`; None of others."""
    if not _DECIMAL.fullmatch(text) or len(text) > 100:
        return None
    value = Decimal(text)
    if value.adjusted() >= MOST_DIGITS or value != value.to_integral_value():
        return None
    return int(value)


def advice(text: str) -> str:
    """What to write for a whole number instead of this text: `write 400000` for `400k`."""
    number = _meant(text[:100].strip(" \"'"))
    return "write it in digits" if number is None else f"write {number}"


def _meant(text: str) -> int | None:
    """The number of `400k`, `400,000`, `400_000`, `0400000`, or of other scripts' digits."""
    if _GROUPED.fullmatch(text):
        text = re.sub(r"[^-+0-9]", "", text)
    if found := _SUFFIXED.fullmatch(text):
        text = f"{found[1]}e{_POWERS[found[2].lower()]}"
    return int(text) if re.fullmatch(rf"[-+]?\d{{1,{MOST_DIGITS}}}", text) else whole(text)


def seeds(text: str) -> tuple[int, ...]:
    """`0-5` or `0,3,7` or both mixed, in the order written.

    Raises:
        UsageError: If it isn't that, a seed stands twice, or there are more than MOST_SEEDS.
    """
    found = [seed for part in text.split(",") for seed in _range(part.strip(), text)]
    if len(set(found)) != len(found):
        raise UsageError(f"a seed stands twice in {shortened(text)!r}", "write it once")
    if len(found) > MOST_SEEDS:
        raise UsageError(f"more than {MOST_SEEDS} seeds in {shortened(text)!r}", "write fewer")
    return tuple(found)


def ranges(seeds: Iterable[int]) -> str:
    """Seeds as they are typed, in order: `0-2,7`."""
    rows: list[list[int]] = []
    for seed in sorted(seeds):
        if rows and seed == rows[-1][-1] + 1:
            rows[-1].append(seed)
        else:
            rows.append([seed])
    return ",".join(f"{row[0]}-{row[-1]}" if row[1:] else f"{row[0]}" for row in rows)


def _range(part: str, text: str) -> range:
    first, dash, last = part.partition("-")
    low, high = whole(first), whole(last if dash else first)
    if low is None or high is None:
        raise UsageError(f"not seeds: {shortened(text)!r}", _advice_on_seeds(text))
    if low > high or low < 0 or high >= SEEDS:
        raise UsageError(f"not seeds: {shortened(text)!r}", "the lower one first, all below 2^32")
    return range(low, high + 1)[: MOST_SEEDS + 1]


def _advice_on_seeds(text: str) -> str:
    """What to write instead of `0..5`, `0 to 5`, `[0, 3, 7]` or `0 3 7`."""
    near = re.sub(r"[\s,;]+", ",", _TO.sub("-", text[:200].strip(" []()\"'"))).strip(",")
    try:
        if near != text and seeds(near):
            return f"write {near}"
    except UsageError:
        pass
    return "write them as 0-5 or 0,3,7"
