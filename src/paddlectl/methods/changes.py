"""Changes to the numbers of a method, as a user writes them."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from paddlectl.agents.settings import in_place_of, kind_of
from paddlectl.registry.names import nearest, shown


def misfits(settings: Any, changes: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Where changes can't be made to settings, and why: a name that there isn't, or another kind of value."""
    known = {each.name for each in fields(settings)} if is_dataclass(settings) else set()
    for name, value in changes.items():
        if name not in known:
            near = nearest(name, sorted(known))
            there = f"{near}there are: {', '.join(sorted(known))}" if known else "it has none of that kind"
            yield (name,), f"no setting {shown(name)}; {there}"
            continue
        usual = getattr(settings, name)
        if is_dataclass(usual) and isinstance(value, Mapping):
            yield from (((name, *place), why) for place, why in misfits(usual, value))
        elif is_dataclass(usual) or not _alike(in_place_of(None, value), usual):
            yield (name,), f"{name} is {_usually(usual)}"


def _alike(value: Any, usual: Any) -> bool:
    return type(value) is type(usual) if type(usual) is int else kind_of(value) is kind_of(usual)


def _usually(usual: Any) -> str:
    if is_dataclass(usual):
        return f"a mapping of {', '.join(each.name for each in fields(usual))}"
    return f"usually {list(usual) if isinstance(usual, tuple) else usual!r}"
