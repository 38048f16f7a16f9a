"""What may stand in each field of a run and of a policy, told once for commands, registry and bundles."""

import re
import sys
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from paddlectl.registry.records import RUN_STATES

SEEDS = 2**32
"""All seeds are below it."""

MOST_SEEDS = 1000
MOST_SOURCES = 100
MOST_FRAMES = 10**12
BUDGET = range(1, MOST_FRAMES + 1)
"""Frames that a run may be given."""

LONGEST_SCENARIO = 80
"""Characters of a scenario's name."""

SCENARIO = rf"[A-Za-z0-9][A-Za-z0-9 _.,+-]{{0,{LONGEST_SCENARIO - 1}}}"
TASK = r"[A-Za-z][A-Za-z0-9_-]{0,63}"
METHOD = r"[a-z][a-z0-9_-]{0,31}"
POLICY_ID = r"policy-[1-9][0-9]{0,17}"
LABEL = r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}"
"""A run's name, or one of its tags."""
MOST_TAGS = 32
TIME = r"[0-9T:.+-]{19,32}"
TABLE = r"[a-z][a-z0-9_]{0,63}"
"""A run's table or document, without its suffix."""


class Numbers(NamedTuple):
    """The floats from the lowest to the highest."""

    low: float
    high: float


class Many(NamedTuple):
    """A list of at most so many that match a pattern."""

    pattern: str
    most: int


_COUNT = range(2**63)
_RATE = Numbers(0.0, 1.0)
_FINITE = Numbers(-sys.float_info.max, sys.float_info.max)

RUN = {
    "kind": r"train|transfer",
    "method": METHOD,
    "task": TASK,
    "scenario": SCENARIO,
    "sources": Many(POLICY_ID, MOST_SOURCES),
    "seed": range(SEEDS),
    "status": "|".join(RUN_STATES[1:]),
    "settings": dict,
    "versions": dict,
    "frames": _COUNT,
    "episodes": _COUNT,
    "seconds": Numbers(0.0, sys.float_info.max),
    "created": TIME,
    "finished": TIME,
}
LABELS = {"name": LABEL, "tags": Many(LABEL, MOST_TAGS)}
"""They belong to the registry, and don't leave it with a run that is exported."""
POLICY = {
    "task": TASK,
    "method": METHOD,
    "seed": range(SEEDS),
    "frames": _COUNT,
    "created": TIME,
    "domain": TASK,
    "metadata": dict,
}
FIGURES = {"success_rate": _RATE, "mean_score": _FINITE, "mean_length": _FINITE, "crispness": _RATE}
FIGURE = r"[a-z][a-z0-9_]{0,63}"
"""The name of any figure of a run."""
OPTIONAL = frozenset({"scenario", "finished", "crispness", "name"})


def misfit(
    values: Mapping[str, Any], kinds: Mapping[str, Any], optional: Collection[str] = OPTIONAL
) -> str | None:
    """The first of the values that its field can't hold, in words; None if all fit."""
    for name, value in values.items():
        if not (value is None and name in optional) and not _fits(kinds[name], value):
            return f"{name} can't be {_odd(kinds[name], value)}"
    return None


def _odd(kind: Any, value: Any) -> str:
    """What doesn't fit, or of a list the first item that doesn't."""
    if isinstance(kind, Many) and isinstance(value, list) and len(value) <= kind.most:
        value = next(item for item in value if not _fits(kind.pattern, item))
    return repr(str(value)[:60])


def odd_figure(results: Mapping[str, Any]) -> str | None:
    """The first of a run's results that is no figure, in words; None if all are."""
    for name, value in results.items():
        if re.fullmatch(FIGURE, name) is None:
            return f"{name[:60]!r} is no name of a figure"
        number = float(value) if type(value) is int and abs(value) in _COUNT else value
        if not (value is None or _fits(FIGURES.get(name, _FINITE), number)):
            return f"{name} can't be {str(value)[:60]!r}"
    return None


def _fits(kind: Any, value: Any) -> bool:
    match kind:
        case str():
            return isinstance(value, str) and re.fullmatch(kind, value) is not None
        case range():
            return type(value) is int and value in kind
        case Numbers():
            return type(value) is float and kind.low <= value <= kind.high
        case Many():
            return (
                isinstance(value, list)
                and len(value) <= kind.most
                and all(_fits(kind.pattern, item) for item in value)
            )
    return type(value) is kind
