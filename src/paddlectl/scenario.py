"""Scenario files: YAML with a position for every value, a closed schema, mistakes told by file:line:column.

The reading is narrower than YAML on purpose: no aliases, anchors, tags, duplicate keys or second document,
at most 1 MB and 16 levels, and scalars as in JSON (`1:30`, `0100` and `yes` are texts, not 90, 64 and true);
`4e5` and `400000.0` are whole numbers.
"""

import errno
import json
import math
import re
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from paddlectl import whole
from paddlectl.errors import InvalidFileError, NotFoundError, UsageError
from paddlectl.methods import catalogue
from paddlectl.registry import fields
from paddlectl.registry.names import number_of
from paddlectl.tasks import suite
from paddlectl.tasks.suite import load
from paddlectl.transfer.guidance import PaperSettings

MAX_BYTES = 1_000_000
MAX_DEPTH = 16
MAX_VALUES = 10_000

_KEY = -1  # stands in a path for a key while it is read
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?(0|[1-9][0-9]*)?(\.[0-9]*)?([eE][-+]?[0-9]+)?")
_LIKE_ID = re.compile(r"(policy|run)?[\W_]*0*([0-9]*)", re.IGNORECASE)
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}


class _Closed(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, hide_input_in_errors=True)


def _seeds(value: Any) -> Any:
    """`0-5`, `0,3,7` or one seed, as on the command line, or what a list holds."""
    if isinstance(value, list):
        return tuple(value)
    if not isinstance(value, str) and type(value) is not int:
        return value
    try:
        return whole.seeds(str(value))
    except UsageError as error:
        raise ValueError(f"{error.message}; {error.hint}") from None


Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0, lt=fields.SEEDS)]
Name = Annotated[
    str, Field(min_length=1, max_length=fields.LONGEST_SCENARIO, pattern=f"^({fields.SCENARIO})$")
]
Names = Annotated[tuple[str, ...], Field(min_length=1, max_length=fields.MOST_SOURCES)]


class TaskSources(_Closed):
    """Tasks whose policies may be reused, and which of each.

    Attributes:
        tasks: Their names.
        seed: The `best` policy, or that of the transfer's own seed: `paired`, so that seeds are independent.
    """

    tasks: Names
    seed: Literal["best", "paired"] = "best"


def _form(sources: Any) -> str:
    return "mapping" if isinstance(sources, dict | TaskSources) else "list"


Sources = Annotated[
    Annotated[Names, Tag("list")] | Annotated[TaskSources, Tag("mapping")], Discriminator(_form)
]


class Similarity(_Closed):
    """The shares of body and heads in ψ (method: γ_body and γ_head)."""

    body_weight: Share = 0.8
    head_weight: Share = 0.2

    @model_validator(mode="after")
    def _sum_is_one(self) -> "Similarity":
        if not math.isclose(self.body_weight + self.head_weight, 1.0, rel_tol=0.0, abs_tol=1e-9):
            raise ValueError("body_weight and head_weight must add up to 1")
        return self


class Guidance(_Closed):
    """How a guide is chosen: by the rules of this project, or by Eqs. 2 and 3.

    All but `mode` are readings of those equations (`PaperSettings`) and belong to `mode: paper`.
    """

    mode: Literal["default", "paper"] = "default"
    initial_performance: Share = PaperSettings.initial_performance
    normalise: Literal["clip", "none"] = PaperSettings.normalise
    failure_cost: Share = PaperSettings.failure_cost
    values: Literal["per_guide", "per_subgoal"] = PaperSettings.values
    source_softness: Share = PaperSettings.source_softness
    imitation_margin: Share = PaperSettings.imitation_margin
    num_envs: Annotated[int, Field(ge=1, le=4096)] = PaperSettings.num_envs

    @model_validator(mode="after")
    def _readings_of_paper(self) -> "Guidance":
        for name, value in self._given().items():
            if self.mode != "paper" and value != getattr(PaperSettings, name):
                raise ValueError(f"{name} is a reading of the paper: add mode: paper, or leave it out")
        return self

    def readings(self) -> PaperSettings | None:
        """How the paper's equations are read; None if they aren't what guides."""
        return PaperSettings(**self._given()) if self.mode == "paper" else None

    def _given(self) -> dict[str, Any]:
        return self.model_dump(exclude={"mode"})


class Scenario(_Closed):
    """One transfer: what to learn, from which sources, how and how often.

    Attributes:
        target: The task to learn.
        sources: Tasks whose best policies may be reused, and ids of policies; or `TaskSources`.
        frames: Environment steps of each run.
    """

    name: Name
    target: str
    sources: Sources
    method: str = "paddle"
    seeds: Annotated[
        tuple[Seed, ...], Field(min_length=1, max_length=fields.MOST_SEEDS), BeforeValidator(_seeds)
    ] = (0,)
    frames: Annotated[int, Field(gt=0, le=fields.MOST_FRAMES)] = 400_000
    similarity: Similarity = Similarity()
    guidance: Guidance = Guidance()

    @property
    def source_names(self) -> tuple[str, ...]:
        """The tasks and policies that `sources` names, in its order."""
        return self.sources.tasks if isinstance(self.sources, TaskSources) else self.sources

    @property
    def paired(self) -> bool:
        """Whether each transfer reuses the policies of its own seed."""
        return isinstance(self.sources, TaskSources) and self.sources.seed == "paired"


KeyPath = tuple[str | int, ...]


class Mark(NamedTuple):
    """A place in a file, counted from 1."""

    line: int
    column: int


class Problem(NamedTuple):
    """What is wrong, at which key path, and whether the key itself is wrong or something is absent."""

    path: KeyPath
    message: str
    at_key: bool = False
    absent: bool = False


def load_scenario(path: Path) -> Scenario:
    """Reads and checks a scenario file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a scenario; the message starts with file:line:column.
    """
    reader = _Reader(str(path), _read(path))
    document = reader.document()
    try:
        scenario = Scenario.model_validate_json(json.dumps(document))
    except ValidationError as error:
        problems = [_told(found, reader) for found in error.errors(include_url=False, include_input=False)]
    else:
        problems = list(_misuses(scenario))
        if not problems:
            return scenario
    # What stands wrong comes before what is missing, for it may be the reason: `targt` for `target`.
    _, mark, message = min((p.absent, reader.mark(p.path, p.at_key), p.message) for p in problems)
    raise reader.error(mark, message)


def unknown(kind: str, name: str, known: tuple[str, ...]) -> str:
    """`unknown task 'BoxDor'; did you mean 'BoxDoor'?`, or all that there are if none is near."""
    lowered = {other.lower(): other for other in known}
    name = name if len(name) <= 80 else f"{name[:80]}…"
    near = get_close_matches(name.lower(), lowered, n=1)
    advice = f"did you mean {lowered[near[0]]!r}?" if near else f"there are {', '.join(known)}"
    return f"unknown {kind} {name!r}; {advice}"


def _read(path: Path) -> str:
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):  # no path can hold what the last is for
        raise _absent(path) from None
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise NotFoundError(f"{path}: symbolic links that lead in a circle", "mend the links") from None
    if not path.is_file():
        raise InvalidFileError(f"{path}:1:1: not a file")
    with path.open("rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise InvalidFileError(f"{path}:1:1: larger than {MAX_BYTES:,} bytes; a scenario isn't")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        mark = _mark_at(data[: error.start].decode("utf-8", "replace"))
        raise InvalidFileError(f"{path}:{mark.line}:{mark.column}: not UTF-8 text") from None


def _absent(path: Path) -> NotFoundError:
    if path.is_symlink():
        return NotFoundError(f"{path} is a link to {path.readlink()}, where no file is", "mend the link")
    lowered = {other.name.lower(): other for other in path.parent.glob("*.y*ml") if other.is_file()}
    near = get_close_matches(path.name.lower(), lowered, n=1)
    return NotFoundError(f"no file {path}", f"did you mean {lowered[near[0]]}?" if near else "")


def _mark_at(before: str) -> Mark:
    return Mark(before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1)


def _misuses(scenario: Scenario) -> Iterator[Problem]:
    """What a schema can't know: names of tasks and methods, and sources that can't serve the target."""
    if not catalogue.known(scenario.method):
        yield Problem(("method",), unknown("method", scenario.method, catalogue.names()))
    if not suite.known(scenario.target):
        yield Problem(("target",), unknown("task", scenario.target, suite.names()))
    key: KeyPath = ("sources", "tasks") if isinstance(scenario.sources, TaskSources) else ("sources",)
    for path, name in _places(key, scenario.source_names):
        if message := _misnamed(name, key, scenario.target):
            yield Problem(path, message)
    for where, values in ((key, scenario.source_names), (("seeds",), scenario.seeds)):
        for path, value in _places(where, values):
            if value in values[: int(path[-1])]:
                yield Problem(path, f"{value!r} stands twice in {'.'.join(map(str, where))}")


def _places(key: KeyPath, values: tuple[Any, ...]) -> Iterator[tuple[KeyPath, Any]]:
    for index, value in enumerate(values):
        yield (*key, index), value


def _misnamed(name: str, key: KeyPath, target: str) -> str:
    """What is wrong with the name of a source, as far as a file can tell; empty if nothing is."""
    if number_of(name, "policy") is not None:
        return f"{name} is no task; to name policies write sources: [{name}]" if key[1:] else ""
    if not suite.known(name):
        return _unknown_policy(name) or unknown("task", name, suite.names())
    if not suite.known(target) or load(name).domain == load(target).domain:
        return ""
    message = f"{name} is a task of {load(name).domain}, the target {target} of {load(target).domain}"
    return f"{message}: its policy can't act there"


def _unknown_policy(name: str) -> str:
    """What to say of `Policy_7`, `7` or `run-7`; empty for what isn't like an id."""
    found = _LIKE_ID.fullmatch(name[:80])
    if not found or not any(found.groups()):
        return ""
    meant = f"policy-{found[2]}"
    near = number_of(meant, "policy") is not None and (found[1] or "").lower() != "run"
    return f"unknown policy {name[:80]!r}; " + (
        f"did you mean {meant!r}?" if near else "ids look like policy-7"
    )


_SECTIONS: dict[KeyPath, type[_Closed]] = {
    (): Scenario,
    ("sources",): TaskSources,
    ("similarity",): Similarity,
    ("guidance",): Guidance,
}
_SAID = {
    "string_type": "must be a text",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "tuple_type": "must be a list",
    "too_short": "must not be empty",
    "too_long": "has too many entries",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "string_pattern_mismatch": "may hold letters, digits, spaces and _ . , + - only",
}


def _told(error: Any, reader: "_Reader") -> Problem:
    path: KeyPath = tuple(error["loc"])
    if path[:1] == ("sources",):
        path = path[:1] + path[2:]  # without the name of the form, list or mapping
    kind, context = error["type"], error.get("ctx", {})
    if kind == "missing":
        return Problem(path[:-1], f"missing key {path[-1]!r}", absent=True)
    if kind == "extra_forbidden":
        known = _SECTIONS[path[:-1]]
        return Problem(path, unknown("key", str(path[-1]), tuple(known.model_fields)), at_key=True)
    if kind == "value_error":
        return Problem(path, str(context["error"]))
    text = _SAID.get(kind, error["msg"][:1].lower() + error["msg"][1:])
    where = ".".join(str(part) for part in path) or "a scenario"
    written = reader.written(path)
    advice = _advice(path, kind, written) if written is not None else ""
    return Problem(path, f"{where}: {text}{advice and f'; {advice}'}", absent=kind == "too_short")


def _advice(path: KeyPath, kind: str, written: str) -> str:
    """What to write instead of a value of the wrong type."""
    match kind:
        case "int_type" | "int_from_float" if path[0] == "seeds" and _is_range(written):
            return f"write seeds: {written}, without brackets"
        case "int_type" | "int_from_float":
            return whole.advice(written)
        case "float_type":
            return f"write {_share(written)}"
        case "string_type" if path[0] == "sources":
            return f"write policy-{written}" if number_of(f"policy-{written}", "policy") else ""
        case "string_type":
            return f'write "{written}"'
        case "tuple_type" if path == ("seeds",):
            return "write them as 0-5 or 0,3,7"
        case "tuple_type" if written == "paired":
            return "write {tasks: [BlockedDoor, GapBall], seed: paired}"
        case "tuple_type":
            return f"write [{written}]"
        case "model_type" | "model_attributes_type" if path in _SECTIONS and path:
            return f"write {{{next(iter(_SECTIONS[path].model_fields))}: {written}}}"
    return ""


def _is_range(text: str) -> bool:
    try:
        return len(whole.seeds(text)) > 1
    except UsageError:
        return False


def _share(text: str) -> str:
    """The number of `0,8` or `80 %`, or of a text in quotes."""
    found = re.fullmatch(r"\s*([0-9]*)[.,]?([0-9]*)\s*(%?)\s*", text[:80])
    if not found or not found[1] + found[2]:
        return "it in digits, as 0.8"
    value = float(f"{found[1] or 0}.{found[2] or 0}")
    return f"{value / 100 if found[3] else value:g}"


class _Reader:
    """Builds plain values from YAML events and remembers where each stood."""

    def __init__(self, name: str, text: str) -> None:
        self._name = name
        self._text = text
        self._values: dict[KeyPath, Mark] = {(): Mark(1, 1)}
        self._keys: dict[KeyPath, Mark] = {}
        self._written: dict[KeyPath, str] = {}
        self._events = yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))

    def document(self) -> Any:
        self._expect(yaml.StreamStartEvent)
        event = self._next()
        if isinstance(event, yaml.StreamEndEvent):
            raise self.error(Mark(1, 1), "the file is empty")
        value = self._value(self._next(), ())
        self._expect(yaml.DocumentEndEvent)
        event = self._next()
        if not isinstance(event, yaml.StreamEndEvent):
            raise self._at(event, "a second document; one file holds one scenario")
        return value

    def mark(self, path: KeyPath, at_key: bool = False) -> Mark:
        """The place of a key path, or of the nearest enclosing one that the file has."""
        if at_key and path in self._keys:
            return self._keys[path]
        while path not in self._values:
            path = path[:-1]
        return self._values[path]

    def written(self, path: KeyPath) -> str | None:
        """A plain value as it is written, if it is short and in one line."""
        text = self._written.get(path, "")
        return text if text.isprintable() and 0 < len(text) <= 80 else None

    def error(self, mark: Mark, message: str) -> InvalidFileError:
        return InvalidFileError(f"{self._name}:{mark.line}:{mark.column}: {message}")

    def _at(self, event: Any, message: str) -> InvalidFileError:
        return self.error(_mark_of(event.start_mark), message)

    def _next(self) -> Any:
        try:
            return next(self._events)
        except yaml.MarkedYAMLError as error:
            place = error.problem_mark or error.context_mark
            mark = _mark_of(place) if place else Mark(1, 1)
            raise self.error(mark, f"not YAML: {error.problem or error.context}") from None
        except yaml.reader.ReaderError as error:
            mark = _mark_at(self._text.encode()[: error.position].decode("utf-8", "replace"))
            raise self.error(mark, "a character that YAML doesn't allow") from None
        except (yaml.YAMLError, ValueError, RecursionError):
            raise self.error(Mark(1, 1), "not YAML") from None

    def _expect(self, kind: type) -> None:
        event = self._next()
        if not isinstance(event, kind):
            raise self._at(event, "not a single YAML document")

    def _value(self, event: Any, path: KeyPath) -> Any:
        self._values[path] = _mark_of(event.start_mark)
        if len(self._values) > MAX_VALUES:
            raise self._at(event, f"more than {MAX_VALUES:,} values; a scenario has fewer")
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise self._at(event, "anchors and aliases aren't allowed; write the value out")
        if getattr(event, "tag", None) is not None:
            raise self._at(event, f"tags aren't allowed: {event.tag!r}")
        if len(path) > MAX_DEPTH:
            raise self._at(event, f"nested deeper than {MAX_DEPTH} levels")
        if isinstance(event, yaml.ScalarEvent):
            self._written[path] = event.value
            return self._scalar(event)
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(path)
        return self._mapping(path)

    def _sequence(self, path: KeyPath) -> list[Any]:
        values: list[Any] = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            values.append(self._value(event, (*path, len(values))))
        return values

    def _mapping(self, path: KeyPath) -> dict[str, Any]:
        values: dict[str, Any] = {}
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            key = self._value(event, (*path, _KEY))
            if not isinstance(key, str):
                raise self._at(event, "a key must be a plain text")
            if key in values:
                raise self._at(event, f"key {key!r} stands twice")
            self._keys[*path, key] = _mark_of(event.start_mark)
            values[key] = self._value(self._next(), (*path, key))
        return values

    def _scalar(self, event: Any) -> Any:
        text: str = event.value
        if not event.implicit[0]:  # quoted, or a block
            return text
        if text.lower() in _WORDS and text in (text.lower(), text.upper(), text.capitalize()):
            return _WORDS[text.lower()]
        if _INTEGER.fullmatch(text):
            if len(text) > whole.MOST_DIGITS:
                raise self._at(event, f"a number of more than {whole.MOST_DIGITS} digits")
            return int(text)
        if _FLOAT.fullmatch(text) and any(character.isdigit() for character in text):
            return self._float(event)
        return text

    def _float(self, event: Any) -> float | int:
        try:
            value = float(event.value)
        except ValueError:  # `e5`: digits in the exponent alone
            return event.value  # type: ignore[no-any-return]
        if not math.isfinite(value):
            raise self._at(event, "a number too large to hold")
        number = whole.whole(event.value)
        return value if number is None else number


def _mark_of(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1)
