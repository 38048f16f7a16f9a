"""JSON as the registry keeps it: text in columns, and the append-only rows and atomic documents of a run."""

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.registry.fields import TABLE
from paddlectl.registry.files.objects import write_atomically
from paddlectl.registry.files.rights import opened

_NAME = re.compile(TABLE)
_BLOCK = 65536


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number")


_ENCODER = json.JSONEncoder(allow_nan=False)
_DECODER = json.JSONDecoder(parse_constant=_refuse)


def to_json(value: Any, what: str) -> str:
    """One line of JSON; `what` says in the message what the value is.

    Raises:
        PaddlectlError: If a number in it is NaN or infinite.
    """
    try:
        return _ENCODER.encode(value)
    except ValueError as error:
        raise PaddlectlError(f"{what} can't be stored: {error}") from error


def from_json(text: str | bytes, what: str) -> Any:
    """The value of a JSON text.

    Raises:
        IntegrityError: If it isn't one that `to_json` could have written.
    """
    try:
        return _DECODER.decode(text if isinstance(text, str) else text.decode())
    except (ValueError, RecursionError) as error:
        raise IntegrityError(f"{what} is damaged: {error}", "restore it from a copy") from error


def append_rows(folder: Path, name: str, rows: Iterable[Mapping[str, Any]]) -> None:
    """Adds rows to `<name>.jsonl`, all or none of them refused.

    A row that an earlier, killed writer left half-written is cut off first; it was never acknowledged.
    Rows survive the death of the process at once, and a loss of power from `sync_files` on.
    """
    path = file_of(folder, name, "jsonl")
    text = "".join(to_json(dict(row), str(path)) + "\n" for row in rows)
    if not text:
        return
    with opened(path, "a+b") as file:
        whole = _whole_length(file)
        file.truncate(whole)
        try:
            file.write(text.encode())
            file.flush()
        except OSError:
            os.ftruncate(file.fileno(), whole)
            raise


def rows_of(data: bytes, where: Path) -> list[dict[str, Any]]:
    """The rows in the bytes of a table, without a half-written last one.

    Raises:
        IntegrityError: If a whole line isn't a JSON object.
    """
    return [_row(line, f"{where}:{number}") for number, line in enumerate(data.split(b"\n")[:-1], 1)]


def each_row(file: BinaryIO, where: Path) -> Iterator[dict[str, Any]]:
    """The rows of an open table, one at a time, without a half-written last one.

    Raises:
        IntegrityError: If a whole line isn't a JSON object.
    """
    for number, line in enumerate(file, 1):
        if line.endswith(b"\n"):
            yield _row(line[:-1], f"{where}:{number}")


def write_document(folder: Path, name: str, document: Any) -> None:
    """Writes or replaces `<name>.json` whole."""
    path = file_of(folder, name, "json")
    write_atomically(path, to_json(document, str(path)).encode() + b"\n")


def document_of(data: bytes, where: Path) -> Any:
    """The value in the bytes of a document.

    Raises:
        IntegrityError: If they aren't JSON.
    """
    return from_json(data.rstrip(b"\n"), str(where))


def with_hash(value: Any, what: str) -> bytes:
    """JSON that carries its own SHA-256, so that `checked` finds any change of it."""
    text = to_json(value, what)
    return f'{{"sha256": "{hashlib.sha256(text.encode()).hexdigest()}", "content": {text}}}\n'.encode()


def checked(data: bytes, what: str) -> Any:
    """The value in what `with_hash` gave.

    Raises:
        IntegrityError: If a byte of it is another.
    """
    found = from_json(data, what)
    try:
        content = found["content"]
        if data == with_hash(content, what):
            return content
    except (KeyError, PaddlectlError, RecursionError, TypeError):
        pass
    raise IntegrityError(f"{what} isn't what was written (SHA-256 differs)", "run: paddlectl registry check")


def sync_files(folder: Path) -> None:
    """Forces every file of the folder to the disk."""
    for path in filter(Path.is_file, folder.iterdir()):
        with path.open("rb") as file:
            os.fsync(file.fileno())


def is_name(text: str) -> bool:
    """Whether a run's table or document may be called that."""
    return _NAME.fullmatch(text) is not None


def file_of(folder: Path, name: str, suffix: str) -> Path:
    """Where the run's table (`jsonl`) or document (`json`) of that name stands."""
    if not is_name(name):
        raise ValueError(f"not a name for a run's file: {name!r}")
    return folder / f"{name}.{suffix}"


def _row(line: bytes, where: str) -> dict[str, Any]:
    row = from_json(line, where)
    if not isinstance(row, dict):
        raise IntegrityError(f"{where} is damaged: not a JSON object", "restore it from a copy")
    return row


def _whole_length(file: BinaryIO) -> int:
    """Bytes up to and with the last line end."""
    end = file.seek(0, os.SEEK_END)
    while end:
        start = max(0, end - _BLOCK)
        file.seek(start)
        found = file.read(end - start).rfind(b"\n")
        if found >= 0:
            return start + found + 1
        end = start
    return 0
