"""Settings of a method: frozen dataclasses in each other, changed by name and brought back from JSON."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from paddlectl.registry.names import nearest, shown

RENAMED: Mapping[str, str] = {
    "lanes": "num_envs",
    "block": "rollout_steps",
    "repeat": "action_repeat",
    "fading": "similarity_decay",
    "curiosity": "target_floor",
    "least_reached": "drop_below_success",
    "audition_samples": "target_samples",
    "forced_trial_samples": "target_samples",
    "tracking": "tau",
    "errands": "goal_exploration",
    "errand_steps": "goal_exploration_steps",
}
"""What a setting was called when older runs and policies were stored -> what it is called now."""


def restored(usual: Any, stored: Any, name: str) -> Any:
    """The values that were stored in the place of the usual ones; a name that isn't stored keeps its value.

    Names are those of today, or those of `RENAMED`.

    Raises:
        ValueError: If there is a name that this version doesn't know, or a value of another kind.
    """
    if is_dataclass(usual) and not isinstance(usual, type):
        known = {each.name for each in fields(usual)}
        if not isinstance(stored, Mapping):
            raise ValueError(f"{name} can't be {str(stored)[:60]}")
        today = {each if each in known else RENAMED.get(each, each): value for each, value in stored.items()}
        if len(today) < len(stored) or not today.keys() <= known:
            raise ValueError(f"{name} can't be {str(stored)[:60]}")
        return replace(
            usual, **{each: restored(getattr(usual, each), value, each) for each, value in today.items()}
        )
    if isinstance(usual, tuple) and isinstance(stored, list | tuple):
        return tuple(restored(0, value, name) for value in stored)
    if _kind(stored) is not _kind(usual):
        raise ValueError(f"{name} can't be {str(stored)[:60]}")
    return stored


def _kind(value: Any) -> type:
    """Its type; whole numbers are numbers like others."""
    return float if type(value) is int else type(value)


def changed(settings: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a settings dataclass with other values, also in the settings within it."""
    return replace(
        settings, **{name: _in_place_of(getattr(settings, name), value) for name, value in changes.items()}
    )


def _in_place_of(usual: Any, value: Any) -> Any:
    if isinstance(value, Mapping):
        return changed(usual, value)
    return tuple(value) if isinstance(value, list) else value


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
        elif is_dataclass(usual) or _kind(_in_place_of(None, value)) is not _kind(usual):
            yield (name,), f"{name} is {_usually(usual)}"


def _usually(usual: Any) -> str:
    if is_dataclass(usual):
        return f"a mapping of {', '.join(each.name for each in fields(usual))}"
    return f"usually {list(usual) if isinstance(usual, tuple) else usual!r}"
