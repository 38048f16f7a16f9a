"""Changes to the numbers of a method, as a user writes them: in a scenario, a study or after `--set`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from paddlectl.agents.settings import changed, in_place_of, kind_of, leaves
from paddlectl.errors import UsageError
from paddlectl.methods.base import Method
from paddlectl.ranges import Environments, Frames, Many, Range, Steps
from paddlectl.registry.names import nearest, shown
from paddlectl.tasks.base import Task
from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.yaml_files import MAX_DEPTH, value_of

RUN_BY: Mapping[str, Any] = {
    "frames": Frames,
    "num_envs": Environments,
    "rollout_steps": Steps,
    "action_repeat": Steps,
}
"""What a run itself reads of the settings of any method, those of plug-ins too."""


class Changes(NamedTuple):
    """Values by name, those within others as mappings in it: `{"low_level": {"learning_rate": 1e-3}}`.

    Attributes:
        settings: Of a method.
        rules: By which it reuses sources.
    """

    settings: Mapping[str, Any]
    rules: Mapping[str, Any]


RULES = "rules"
"""The first name of a rule after `--set`."""


def typed(given: Sequence[str]) -> Changes:
    """What `--set` asks for: `low_level.learning_rate=1e-3`, `rules.target_floor=0`, values as in YAML.

    Raises:
        UsageError: If one has no value or no YAML, or a name has two values.
    """
    tree: dict[str, Any] = {}
    for text in given:
        name, equals, written = text.partition("=")
        names = [part.strip() for part in name.split(".")]
        if not (equals and written.strip() and all(names)) or len(names) > MAX_DEPTH:
            raise UsageError(f"--set {shown(text)}: not NAME=VALUE", "write low_level.learning_rate=1e-3")
        try:
            value = value_of(written)
        except ValueError as error:
            raise UsageError(f"--set {shown(text)}: {error}", "write a value as in a scenario file") from None
        _put(tree, names, value, text)
    rules = tree.pop(RULES, {})
    if not isinstance(rules, Mapping):
        raise UsageError(f"--set {RULES}: rules have names", f"write {RULES}.target_floor=0")
    return Changes(tree, rules)


def _put(tree: dict[str, Any], names: Sequence[str], value: Any, text: str) -> None:
    for name in names[:-1]:
        tree = tree.setdefault(name, {})
        if not isinstance(tree, dict):
            raise _twice(text)
    if isinstance(value, Mapping):
        for name, inner in value.items():
            _put(tree, [names[-1], name], inner, text)
    elif names[-1] in tree:
        raise _twice(text)
    else:
        tree[names[-1]] = value


def _twice(text: str) -> UsageError:
    return UsageError(f"--set {shown(text)}: it has another value, too", "set it once")


def require_fit(
    method: Method, task: Task, scenario: Any, changes: Changes, preset: str | None = None
) -> None:
    """Refuses what can't be changed.

    Raises:
        UsageError: If there is such; with what can be.
    """
    for place, why in unfit(method, task, scenario, changes, preset):
        name = ".".join(place).removeprefix("settings.")
        message, _, hint = why.partition("; ")
        raise UsageError(f"{method.name} on {task.name}: --set {shown(name)}: {message}", hint)


class Misfit(NamedTuple):
    """What can't be changed so.

    Attributes:
        place: `settings` or `rules`, and the names that lead there.
        message: Why.
    """

    place: tuple[str, ...]
    message: str


def unfit(
    method: Method, task: Task, scenario: Any, changes: Changes, preset: str | None = None
) -> Iterator[Misfit]:
    """What can't be changed of a method's numbers for a task.

    Args:
        method: The method.
        task: To learn.
        scenario: That is transferred; None for a source.
        changes: To make.
        preset: Of the method, instead of its usual settings.
    """
    settings = method.presets(task)[preset] if preset else method.settings_for(task, scenario)
    rules = None if scenario is None else method.rules_for(task)
    found = [Misfit(("settings", *place), why) for place, why in misfits(settings, changes.settings)]
    if scenario is None and changes.rules:
        found += [Misfit((RULES,), "only a transfer has rules: a source reuses nothing")]
    found += [Misfit((RULES, *place), why) for place, why in misfits(rules, changes.rules)]
    yield from found
    if found or scenario is None:
        return
    if "frames" in changes.settings:
        yield Misfit(
            ("settings", "frames"), "frames is of sources alone; a transfer's are beside its settings"
        )
    if changes.rules and isinstance(rules, GuidanceSettings) and scenario.guidance.mode == "paper":
        yield Misfit((RULES, next(iter(changes.rules))), "rules are of guidance: default, not of paper")
    resolved = dict(leaves(method.settings_for(task, scenario, changes.settings)))
    for name, value in leaves(changed(settings, changes.settings)):
        if resolved[name] != value:
            yield Misfit(("settings", *name.split(".")), f"{name} is {resolved[name]}, by the scenario")


def misfits(settings: Any, changes: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Where changes can't be made to settings, and why: a name that there isn't, or a value that can't be."""
    return _misfits(settings, changes, "", [name for name, _ in leaves(settings)])


def _misfits(
    settings: Any, changes: Mapping[str, Any], before: str, paths: list[str]
) -> Iterator[tuple[tuple[str, ...], str]]:
    types = get_type_hints(type(settings), include_extras=True) if is_dataclass(settings) else {}
    known = sorted(each.name for each in fields(settings)) if is_dataclass(settings) else []
    for name, value in changes.items():
        if name not in known:
            yield (name,), f"no setting {shown(name)}; {_instead(name, before, known, paths)}"
            continue
        usual = getattr(settings, name)
        if is_dataclass(usual) and isinstance(value, Mapping):
            inner = _misfits(usual, value, f"{before}{name}.", paths)
            yield from (((name, *place), why) for place, why in inner)
        elif is_dataclass(usual) or not _alike(value, usual):
            yield (name,), f"{name} is {_kind(usual)}"
        elif allowed := _refused(value, types[name], before + name):
            yield (name,), f"{name} is {allowed}, {_usually(usual)}"


def _instead(name: str, before: str, known: list[str], paths: list[str]) -> str:
    if not known:
        return "it has none of that kind"
    near = nearest(name, known)
    elsewhere = [path for path in paths if path.rpartition(".")[2] == name and path != before + name]
    if not near and elsewhere:
        near = f"did you mean {' or '.join(elsewhere)}? or "
    return f"{near}there are: {', '.join(known)}"


def _alike(value: Any, usual: Any) -> bool:
    """Whether it is of the same kind; a whole number is a number, and no number is a whole number."""
    if isinstance(value, Mapping):
        return False
    value = in_place_of(usual, value)
    if isinstance(value, tuple) and isinstance(usual, tuple):
        return all(_alike(item, (*usual, 0)[0]) for item in value)
    return type(value) is type(usual) if type(usual) in (int, bool) else kind_of(value) is kind_of(usual)


def _refused(value: Any, kind: Any, name: str) -> str:
    """What the value had to be, if it isn't; empty if it is."""
    if get_origin(kind) is Literal:
        return "" if value in get_args(kind) else f"one of {', '.join(map(str, get_args(kind)))}"
    asked = [*getattr(kind, "__metadata__", ()), *getattr(RUN_BY.get(name), "__metadata__", ())]
    limits = [each for each in asked if isinstance(each, Range | Many)]
    return next((str(each) for each in limits if value not in each), "")


def _usually(usual: Any) -> str:
    return f"usually {list(usual) if isinstance(usual, tuple) else usual!r}"


def _kind(usual: Any) -> str:
    """What a setting has to be, by its usual value."""
    if is_dataclass(usual):
        return f"a mapping of {', '.join(each.name for each in fields(usual))}"
    words = {
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        tuple: "a list of whole numbers",
    }
    return f"{words.get(type(usual), 'a word')}, {_usually(usual)}"
