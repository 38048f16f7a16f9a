"""What other distributions add: entry points, looked for by name and imported only when one is used.

A name that is built in wins. What a plug-in does wrong while it is loaded is told as its fault, and stops
only who uses it.

Tasks come from files, too, that were given on the command line: `load_file` runs one.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from paddlectl.errors import InvalidFileError, PaddlectlError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

packages = {"paddlectl"}
"""The top-level packages whose tasks and methods are in use in this process."""

_files: dict[Path, str] = {}
"""The files that were loaded, and the SHA-256 of each."""


class Plugins:
    """Entry points of one group.

    Args:
        kind: What each of them is: `task` or `method`.
        built_in: Names that are none of theirs.
        fits: Whether another name can be stored.
    """

    def __init__(self, kind: str, built_in: Container[str], fits: Callable[[str], object]) -> None:
        self._kind = kind
        self._built_in = built_in
        self._fits = fits
        self._of_files: dict[str, tuple[Path, Any]] = {}

    def names(self) -> tuple[str, ...]:
        """All names that can be used, sorted; nothing is imported."""
        names = {point.name for point in _points(self._kind)} | self._of_files.keys()
        return tuple(sorted(name for name in names if name not in self._built_in and self._fits(name)))

    def __contains__(self, name: str) -> bool:
        if name in self._built_in:
            return False
        return name in self._of_files or any(point.name == name for point in _points(self._kind))

    def add(self, file: Path, found: Mapping[str, Any]) -> None:
        """Takes in what a file has, by name.

        Raises:
            InvalidFileError: If a name can't be stored, or is another's.
        """
        for name in found:
            if not isinstance(name, str) or not self._fits(name):
                raise InvalidFileError(f"{file}: no {self._kind} can have the name {name!r}", "rename it")
            if name in self._built_in or (name in self and self._of_files.get(name, (None,))[0] != file):
                raise InvalidFileError(f"{file}: there is another {self._kind} {name}", "rename it")
        self._of_files.update({name: (file, each) for name, each in found.items()})

    def from_file(self, name: str) -> bool:
        """Whether a file has it."""
        return name in self._of_files

    @contextmanager
    def using(self, name: str) -> Iterator[Any]:
        """Gives what is registered by that name; what fails within is told as its fault.

        What it prints goes to stderr.

        Raises:
            PaddlectlError: If it can't be imported, or something fails within.
        """
        if name in self._of_files:
            with self._using_file(name) as found:
                yield found
            return
        points = [point for point in _points(self._kind) if point.name == name]
        try:
            with redirect_stdout(sys.stderr):
                self._require_fit(name, len(points))
                yield attribute(points[0].value)
        except (Exception, SystemExit) as error:
            owners = " and ".join(sorted(f"{point.dist.name}" for point in points if point.dist))
            raise PaddlectlError(
                f"{self._kind} {name} of {owners} ({points[0].value}) can't be used: {told(error)}",
                f"mend or uninstall {owners}",
            ) from error

    @contextmanager
    def _using_file(self, name: str) -> Iterator[Any]:
        file, found = self._of_files[name]
        try:
            with redirect_stdout(sys.stderr):
                yield found
        except (Exception, SystemExit) as error:
            raise PaddlectlError(
                f"{self._kind} {name} of {file} can't be used: {told(error)}", f"mend {file}"
            ) from error

    def _require_fit(self, name: str, count: int) -> None:
        if not self._fits(name):
            raise ValueError(f"no {self._kind} can have that name")
        if count > 1:
            raise ValueError("they have the same name")


def attribute(where: str) -> Any:
    """What is at a place such as `package.module:NAME`, imported."""
    module, _, name = where.partition(":")
    found = attrgetter(name)(import_module(module))
    packages.add(module.partition(".")[0])
    return found


def load_file(file: Path, name: str) -> Mapping[str, Any]:
    """Runs a Python file, and gives what it has as `name`: a dict by names. What it prints goes to stderr.

    Raises:
        InvalidFileError: If it fails, or has no such dict; or if another of that name was loaded before.
    """
    module = re.sub(r"\W", "_", f"file_{file.stem}")
    spec = spec_from_file_location(module, file)
    if spec is None or spec.loader is None:
        raise InvalidFileError(f"{file}: it's no Python file", "give it a name that ends in .py")
    if any(other != file and other.stem == file.stem for other in _files):
        raise InvalidFileError(f"{file}: another file of that name was loaded", "rename it")
    try:
        _files[file] = hashlib.sha256(file.read_bytes()).hexdigest()
        sys.modules[module] = loaded = module_from_spec(spec)
        with redirect_stdout(sys.stderr):
            spec.loader.exec_module(loaded)
            found = getattr(loaded, name, None)
    except (Exception, SystemExit) as error:
        raise InvalidFileError(f"{file}: it can't be loaded: {told(error)}", f"mend {file.name}") from error
    if not isinstance(found, Mapping):
        has = "has no" if found is None else f"has {type(found).__name__} as"
        raise InvalidFileError(f"{file}: it {has} {name}", f'write {name} = {{"Name": …}}')
    packages.add(module)
    return dict(found)


def files() -> tuple[Path, ...]:
    """Those that were loaded."""
    return tuple(_files)


def require_kind(found: Any, kind: type) -> None:
    """Refuses what isn't of that kind.

    Raises:
        TypeError: If it isn't.
    """
    if not isinstance(found, kind):
        raise TypeError(f"it gives {type(found).__name__} instead of {kind.__module__}.{kind.__name__}")


def versions() -> dict[str, str]:
    """Of all distributions that add something, by their names; of files, the beginning of their SHA-256."""
    points = [*_points("task"), *_points("method")]
    installed = {f"{point.dist.name}": f"{point.dist.version}" for point in points if point.dist}
    return installed | {file.name: digest[:12] for file, digest in _files.items()}


def _points(kind: str) -> "list[EntryPoint]":
    return _points_on(f"paddlectl.{kind}s", tuple(sys.path))


@cache
def _points_on(group: str, path: tuple[str, ...]) -> "list[EntryPoint]":
    """Those of a group; each distribution's once, where it is found first on the path."""
    from importlib.metadata import distributions  # takes long to load, and is seldom needed

    found: dict[tuple[str, str], EntryPoint] = {}
    for distribution in distributions(path=list(path)):
        with suppress(Exception):  # a damaged one has nothing to do with the others
            if group in (distribution.read_text("entry_points.txt") or ""):
                for point in distribution.entry_points.select(group=group):
                    found.setdefault((distribution.name, point.name), point)
    return list(found.values())


def told(error: BaseException) -> str:
    """An error in a line, with the place outside the package where it was raised, if it was.

    Where a file that was loaded calls others, the place is the one in that file.
    """
    import traceback

    if isinstance(error, PaddlectlError):
        return error.message[:200]
    told = f"{type(error).__name__}: {error}"[:200]
    if isinstance(error, SyntaxError):
        return told  # has its place
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if _is_theirs(frame.filename)]
    frames = [frame for frame in frames if Path(frame.filename) in _files] or frames
    return told + (f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else "")


def _is_theirs(file: str) -> bool:
    """Whether it is neither of this package nor of Python's own library."""
    path, library = Path(file), Path(os.__file__).parent
    installed = {"site-packages", "dist-packages"} & set(path.parts)
    ours = Path(__file__).parent in path.parents
    return not (file.startswith("<") or ours or (library in path.parents and not installed))
