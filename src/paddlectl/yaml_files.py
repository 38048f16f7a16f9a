"""YAML files with a position for every value and a closed schema; mistakes are told by file:line:column.

The reading is narrower than YAML on purpose: no aliases, anchors, tags, duplicate keys or second document,
at most 1 MB and 16 levels, and scalars as in JSON (`1:30`, `0100` and `yes` are texts, not 90, 64 and true);
`4e5` and `400000.0` are whole numbers.
"""

import errno
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from paddlectl import whole
from paddlectl.errors import InvalidFileError, NotFoundError

MAX_BYTES = 1_000_000
MAX_DEPTH = 16
MAX_VALUES = 10_000

_KEY = -1  # stands in a path for a key while it is read
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?(0|[1-9][0-9]*)?(\.[0-9]*)?([eE][-+]?[0-9]+)?")
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}


class Closed(BaseModel):
    """A mapping with these keys and no others."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, hide_input_in_errors=True)


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


M = TypeVar("M", bound=Closed)


@dataclass(frozen=True)
class Kind(Generic[M]):
    """A kind of file.

    Attributes:
        noun: What one is called.
        model: Its schema.
        sections: The schemas of the mappings in it, by key path; "*" stands for any key.
        misuses: What a schema can't know; the file's path is given with what it holds.
        in_file: A key path of the schema as the file has it.
        advice: What to write instead of a value of the wrong type, by key path, Pydantic's kind of error and
            what is written; None if there is nothing better to say than for every file.
        others: Other kinds, each told by a key that it alone has.
    """

    noun: str
    model: type[M]
    sections: Mapping[KeyPath, type[Closed]]
    misuses: Callable[[M, Path], Iterator[Problem]]
    in_file: Callable[[KeyPath], KeyPath] = lambda path: path
    advice: Callable[[KeyPath, str, str], str | None] = lambda *_: None
    others: Mapping[str, "Kind[Any]"] = field(default_factory=dict)

    def of(self, document: Any) -> "Kind[Any]":
        """The kind that a document is of: itself, or one of the others."""
        keys = document if isinstance(document, dict) else {}
        return next((other for key, other in self.others.items() if key in keys), self)

    def section(self, path: KeyPath) -> type[Closed] | None:
        """The schema of the mapping at a key path."""
        for pattern, model in self.sections.items():
            if len(pattern) == len(path) and all(a in (b, "*") for a, b in zip(pattern, path, strict=True)):
                return model
        return None


def load_file(path: Path, kind: Kind[M]) -> M:
    """Reads and checks a file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't one of that kind; the message starts with file:line:column.
    """
    return _checked(_Reader(str(path), _read(path, kind.noun), kind.noun), kind, path)


def check_values(values: Mapping[str, Any], kind: Kind[M]) -> M:
    """Checks what a file would hold, and no file does.

    Raises:
        InvalidFileError: If it isn't of that kind.
    """
    try:
        text = json.dumps(values, indent=2, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InvalidFileError(f"the {kind.noun}: {error}", "numbers, texts, lists and mappings") from None
    try:
        return _checked(_Reader("", text, kind.noun), kind, Path())
    except InvalidFileError as error:
        message = error.message.partition(": ")[2]  # without line and column
        raise InvalidFileError(f"the {kind.noun}: {message}", error.hint) from None


def _checked(reader: "_Reader", kind: Kind[M], path: Path) -> M:
    document = reader.document()
    kind = kind.of(document)
    try:
        found = kind.model.model_validate_json(json.dumps(document))
    except ValidationError as error:
        told = error.errors(include_url=False, include_input=False)
        problems = [_told(one, reader, kind) for one in told]
    else:
        problems = list(kind.misuses(found, path))
        if not problems:
            return found
    # What stands wrong comes before what is missing, for it may be the reason: `targt` for `target`.
    _, mark, message = min((p.absent, reader.mark(p.path, p.at_key), p.message) for p in problems)
    raise reader.error(mark, message)


def value_of(text: str) -> Any:
    """A value as in a file: `1e-3`, `true`, `[64, 64]`, `{learning_rate: 1e-3}`.

    Raises:
        ValueError: If it isn't one.
    """
    try:
        return _Reader("", text, "value").document()
    except InvalidFileError as error:
        raise ValueError(error.message.partition(": ")[2]) from None


def unknown(kind: str, name: str, known: tuple[str, ...]) -> str:
    """`unknown task 'BoxDor'; did you mean 'BoxDoor'?`, or all that there are if none is near."""
    lowered = {other.lower(): other for other in known}
    name = name if len(name) <= 80 else f"{name[:80]}…"
    near = get_close_matches(name.lower(), lowered, n=1)
    advice = f"did you mean {lowered[near[0]]!r}?" if near else f"there are {', '.join(known)}"
    return f"unknown {kind} {name!r}; {advice}"


def _read(path: Path, noun: str) -> str:
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
        raise InvalidFileError(f"{path}:1:1: larger than {MAX_BYTES:,} bytes; a {noun} isn't")
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


_SAID = {
    "string_type": "must be a text",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "tuple_type": "must be a list",
    "dict_type": "must be a mapping of keys to values",
    "too_short": "must not be empty",
    "too_long": "has too many entries",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "string_pattern_mismatch": "may hold letters, digits, spaces and _ . , + - only",
}


def _told(error: Any, reader: "_Reader", of: Kind[Any]) -> Problem:
    path = of.in_file(tuple(error["loc"]))
    kind, context = error["type"], error.get("ctx", {})
    if kind == "missing":
        return Problem(path[:-1], f"missing key {path[-1]!r}", absent=True)
    if kind == "extra_forbidden":
        known = of.section(path[:-1])
        assert known is not None
        keys = (*known.model_fields, *(of.others if len(path) == 1 else ()))
        return Problem(path, unknown("key", str(path[-1]), keys), at_key=True)
    if kind == "value_error":
        return Problem(path, str(context["error"]))
    at_key = path[-1:] == ("[key]",)
    path = path[:-1] if at_key else path
    text = _SAID.get(kind, error["msg"][:1].lower() + error["msg"][1:])
    where = ".".join(str(part) for part in path) or f"a {of.noun}"
    written = reader.written(path)
    advice = _advice(path, kind, written, of) if written is not None else ""
    return Problem(path, f"{where}: {text}{advice and f'; {advice}'}", at_key, absent=kind == "too_short")


def _advice(path: KeyPath, kind: str, written: str, of: Kind[Any]) -> str:
    """What to write instead of a value of the wrong type."""
    if (own := of.advice(path, kind, written)) is not None:
        return own
    match kind:
        case "int_type" | "int_from_float":
            return whole.advice(written)
        case "float_type":
            return f"write {_share(written)}"
        case "string_type":
            return f'write "{written}"'
        case "tuple_type":
            return f"write [{written}]"
        case "model_type" | "model_attributes_type" if path and (known := of.section(path)):
            return f"write {{{next(iter(known.model_fields))}: {written}}}"
    return ""


def _share(text: str) -> str:
    """The number of `0,8` or `80 %`, or of a text in quotes."""
    found = re.fullmatch(r"\s*([0-9]*)[.,]?([0-9]*)\s*(%?)\s*", text[:80])
    if not found or not found[1] + found[2]:
        return "it in digits, as 0.8"
    value = float(f"{found[1] or 0}.{found[2] or 0}")
    return f"{value / 100 if found[3] else value:g}"


class _Reader:
    """Builds plain values from YAML events and remembers where each stood."""

    def __init__(self, name: str, text: str, noun: str) -> None:
        self._noun = noun
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
            raise self._at(event, f"a second document; one file holds one {self._noun}")
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
            raise self._at(event, f"more than {MAX_VALUES:,} values; a {self._noun} has fewer")
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
