"""Settings of a method: frozen dataclasses in each other, changed by name and brought back from JSON."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

RENAMED: Mapping[str, str] = {
    "lanes": "num_envs",
    "block": "rollout_steps",
    "repeat": "action_repeat",
    "fading": "similarity_decay",
    "curiosity": "target_floor",
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
        if unknown := sorted(map(str, today.keys() - known)):
            raise ValueError(f"{name} have no {', '.join(unknown)[:60]}")
        if len(today) < len(stored):
            raise ValueError(f"{name} can't be {str(stored)[:60]}")
        return replace(
            usual, **{each: restored(getattr(usual, each), value, each) for each, value in today.items()}
        )
    if isinstance(usual, tuple) and isinstance(stored, list | tuple):
        return tuple(restored(0, value, name) for value in stored)
    if kind_of(stored) is not kind_of(usual):
        raise ValueError(f"{name} can't be {str(stored)[:60]}")
    return in_place_of(usual, stored)


def kind_of(value: Any) -> type:
    """Its type; whole numbers are numbers like others."""
    return float if type(value) is int else type(value)


def changed(settings: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a settings dataclass with other values, also in the settings within it."""
    return replace(
        settings, **{name: in_place_of(getattr(settings, name), value) for name, value in changes.items()}
    )


def in_place_of(usual: Any, value: Any) -> Any:
    """A value as settings have it: those within others are changed, lists are tuples, 0 may be 0.0."""
    if isinstance(value, Mapping):
        return changed(usual, value)
    if type(usual) is float and type(value) is int:
        return float(value)
    return tuple(value) if isinstance(value, list) else value


def leaves(settings: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Each setting by its name, those within others as `low_level.learning_rate`."""
    if not is_dataclass(settings):
        return
    for each in fields(settings):
        name, value = before + each.name, getattr(settings, each.name)
        if is_dataclass(value):
            yield from leaves(value, f"{name}.")
        else:
            yield name, value


def with_defaults(settings: Any) -> Any:
    """Settings of the same classes, each number as its class has it: what older versions did without it."""
    inner = {each.name: getattr(settings, each.name) for each in fields(settings)}
    given = {name: with_defaults(value) for name, value in inner.items() if is_dataclass(value)}
    return type(settings)(**given)
