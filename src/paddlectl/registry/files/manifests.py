"""Manifests: what the index says of a run or a policy, and the hash of every file that belongs to it.

One file each, `manifests/run-7.json`. It is written after the files that it names and before its row is
committed, so the index can be made again from the manifests alone, and a file that was changed is noticed.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from paddlectl.errors import IntegrityError
from paddlectl.registry.files.documents import checked, with_hash
from paddlectl.registry.files.objects import write_atomically
from paddlectl.registry.names import is_id

FOLDER = "manifests"
_BLOCK = 1 << 20


class Seal(NamedTuple):
    """What a file must be: its SHA-256 in hexadecimal, and its bytes."""

    sha256: str
    size: int


@dataclass(frozen=True)
class Manifest:
    """One run or policy as it was published.

    Attributes:
        name: `run-7` or `policy-3`.
        row: Its row of the index, column by column.
        files: The seal of each of its files by path within the registry; None while the run goes on.
    """

    name: str
    row: dict[str, Any]
    files: dict[str, Seal] | None

    @property
    def kind(self) -> str:
        return self.name.partition("-")[0]


def path_of(registry: Path, name: str) -> Path:
    """Where the manifest of a run or policy stands."""
    return registry / FOLDER / f"{name}.json"


def is_one(path: Path) -> bool:
    """Whether a file in their folder is called as a manifest is."""
    return path.suffix == ".json" and is_id(path.stem)


def write(registry: Path, manifest: Manifest) -> None:
    """Publishes a manifest, whole and on the disk."""
    path = path_of(registry, manifest.name)
    content = {"name": manifest.name, "row": manifest.row, "files": manifest.files}
    write_atomically(path, with_hash(content, str(path)))


def read(registry: Path, name: str) -> Manifest:
    """The manifest of a run or policy.

    Raises:
        IntegrityError: If it is missing, or isn't what was written.
    """
    path = path_of(registry, name)
    hint = "run: paddlectl registry check"
    try:
        content = checked(path.read_bytes(), str(path))
    except FileNotFoundError:
        raise IntegrityError(f"the manifest of {name} is missing: {path}", hint) from None
    try:
        files = content["files"]
        seals = files if files is None else {str(file): Seal(*seal) for file, seal in files.items()}
        told, row = content["name"], dict(content["row"])
    except (AttributeError, KeyError, TypeError, ValueError):
        raise IntegrityError(f"{path} is no manifest", hint) from None
    if told != name:
        raise IntegrityError(f"{path} was written for {told!r}"[:200], hint)
    return Manifest(name, row, seals)


def names(registry: Path) -> list[str]:
    """Of all manifests that there are, unread."""
    return [path.stem for path in sorted((registry / FOLDER).glob("*.json")) if is_id(path.stem)]


def seal(path: Path) -> Seal:
    """The hash and size of a file as it is."""
    return RunningSeal(path).seal()


class RunningSeal:
    """The seal of a file that only grows, from what is added to it alone."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._digest, self._size = hashlib.sha256(), 0

    def seal(self) -> Seal:
        """Of the file as it is."""
        with self._path.open("rb") as file:
            file.seek(self._size)
            while block := file.read(_BLOCK):
                self._digest.update(block)
                self._size += len(block)
        return Seal(self._digest.hexdigest(), self._size)


def seal_of(data: bytes) -> Seal:
    """The hash and size of bytes."""
    return Seal(hashlib.sha256(data).hexdigest(), len(data))


def key(registry: Path, path: Path) -> str:
    """What a file is called in a manifest: its path within the registry."""
    return path.relative_to(registry).as_posix()


def sealed(registry: Path, paths: Iterable[Path]) -> dict[str, Seal]:
    """The seals of files by their path within the registry."""
    return {key(registry, path): seal(path) for path in sorted(paths)}


def verify(registry: Path, path: Path, data: bytes | None, files: Mapping[str, Seal]) -> None:
    """Makes sure that a file is what was sealed.

    Args:
        registry: The registry's folder.
        path: The file.
        data: What was read of it; None if it isn't there.
        files: The seals of its run.

    Raises:
        IntegrityError: If it was changed, or is missing, or has no seal.
    """
    expected = files.get(key(registry, path))
    found = None if data is None else seal_of(data)
    if found != expected:
        what = "missing" if found is None else "not what was stored (SHA-256 differs)"
        raise IntegrityError(f"{path} is {what}", "restore it from a copy, or run: paddlectl registry check")
