"""A run's folder: its tables and documents, its checkpoints, and who holds it."""

import fcntl
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from paddlectl.errors import IntegrityError, NotFoundError, RegistryBusyError
from paddlectl.registry.files import checkpoints, documents, layout, manifests
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.files.manifests import Seal
from paddlectl.registry.names import number_of, shown

T = TypeVar("T")

_PATIENCE = 2.0  # seconds
_BEGINNING = 0.5  # seconds between a run's entry and the moment when its process holds it, at most
_READINGS = 20


class RunFiles:
    """The files of the runs in a registry's folder.

    Args:
        folder: Where all files are.
        shown: The registry's place for messages.
    """

    def __init__(self, folder: Path, shown: str) -> None:
        self._folder, self._shown = folder, shown
        self._tables = checkpoints.Tables()

    @contextmanager
    def hold(self, run: str) -> Iterator[None]:
        """Says to other processes that the run goes on here, until the block or the process ends.

        Raises:
            RegistryBusyError: If it goes on in another process.
        """
        with disk_faults(self._shown):
            file = _take(self._run_folder(run))
        with file:
            yield

    @contextmanager
    def sweeping(self) -> Iterator[None]:
        """Says to other processes that a study's cells are run here, until the block or the process ends.

        Raises:
            RegistryBusyError: If another process runs some.
        """
        with disk_faults(self._shown):
            folder = os.open(self._folder / "runs", os.O_RDONLY)
        try:
            _take_folder(folder, self._shown)
            yield
        finally:
            os.close(folder)

    def goes_on(self, run: str) -> bool:
        """Whether a process holds the run, or is about to."""
        with disk_faults(self._shown):
            return goes_on(self._folder, run)

    def sync(self, run: str) -> None:
        """Forces the run's tables and documents to the disk."""
        with disk_faults(self._shown):
            documents.sync_files(self._run_folder(run))

    def append_rows(self, run: str, name: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Adds rows to the run's `<name>.jsonl`."""
        with disk_faults(self._shown):
            documents.append_rows(self._run_folder(run), name, rows)

    def read_rows(self, run: str, name: str) -> list[dict[str, Any]]:
        """The rows of the run's `<name>.jsonl`; empty if there is none.

        Raises:
            IntegrityError: If the run has ended, and the file isn't what it was then.
        """
        return self._read(run, name, "jsonl", documents.rows_of) or []

    def each_row(self, run: str, name: str) -> Iterator[dict[str, Any]]:
        """The rows of the `<name>.jsonl` of a run that goes on, one at a time; nothing if there is none."""
        with disk_faults(self._shown), suppress(FileNotFoundError):
            path = documents.file_of(self._run_folder(run), name, "jsonl")
            with path.open("rb") as file:
                yield from documents.each_row(file, path)

    def write_document(self, run: str, name: str, document: Any) -> None:
        """Writes or replaces the run's `<name>.json` whole."""
        with disk_faults(self._shown):
            documents.write_document(self._run_folder(run), name, document)

    def read_document(self, run: str, name: str) -> Any | None:
        """The value of the run's `<name>.json`; None if there is none.

        Raises:
            IntegrityError: If the run has ended, and the file isn't what it was then.
        """
        return self._read(run, name, "json", documents.document_of)

    def document_names(self, run: str) -> list[str]:
        """The run's documents, also such as are missing though they were sealed, by name."""
        return self._names(run, ".json")

    def table_names(self, run: str) -> list[str]:
        """The run's tables, likewise."""
        return self._names(run, ".jsonl")

    def _names(self, run: str, suffix: str) -> list[str]:
        with disk_faults(self._shown):
            sealed = manifests.read(self._folder, run).files or {}
            found = [*layout.run_files(self._folder, run), *map(Path, sealed)]
        names = {path.stem for path in found if path.suffix == suffix}
        return sorted(filter(documents.is_name, names))

    # Checkpoints of a run that goes on

    def save_checkpoint(self, run: str, document: Any, arrays: bytes) -> None:
        """Keeps all that a run needs to go on, beside its tables as they are now; the last two are kept."""
        with disk_faults(self._shown):
            folder = self._run_folder(run)
            checkpoints.save(folder, document, arrays, self._tables.seals(folder))

    def rewind(self, run: str) -> checkpoints.Checkpoint | None:
        """Cuts the run's tables back to its newest whole checkpoint, and gives that; None if it had none yet.

        Raises:
            IntegrityError: If it has checkpoints, but none of them is whole.
        """
        with disk_faults(self._shown):
            folder = self._run_folder(run)
            self._tables.forget(folder)
            return checkpoints.rewind(folder)

    def drop_checkpoints(self, run: str) -> None:
        """Frees their space once the run is finished."""
        with disk_faults(self._shown):
            folder = self._run_folder(run)
            self._tables.forget(folder)
            checkpoints.drop(folder)

    def _read(self, run: str, name: str, suffix: str, value_of: Callable[[bytes, Path], Any]) -> Any | None:
        with disk_faults(self._shown):
            path = documents.file_of(self._run_folder(run), name, suffix)

            def value(files: Mapping[str, Seal] | None) -> Any | None:
                data = bytes_of(path)
                if files is not None and (data is not None or manifests.key(self._folder, path) in files):
                    manifests.verify(self._folder, path, data, files)
                return None if data is None else value_of(data, path)

            return while_it_stays(self._folder, run, value)

    def _run_folder(self, run: str) -> Path:
        if number_of(run, "run") is None or not (self._folder / "runs" / run).is_dir():
            raise NotFoundError(f"no folder of a run {shown(run)}", "run: paddlectl runs")
        return self._folder / "runs" / run


def goes_on(folder: Path, run: str) -> bool:
    """Whether a process holds the run; one that was entered a moment ago is given the time to be held."""
    if layout.is_held(folder / "runs" / run):
        return True
    try:
        age = time.time() - manifests.path_of(folder, run).stat().st_mtime
    except FileNotFoundError:
        return False
    if not 0.0 <= age < _BEGINNING:
        return False
    time.sleep(_BEGINNING - age)
    return layout.is_held(folder / "runs" / run)


@contextmanager
def kept_still(run_folder: Path) -> Iterator[bool]:
    """Whether no process holds the run; none begins to within the block, then."""
    with (run_folder / "lock").open("a+b") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            still = True
        except BlockingIOError:
            still = False
        yield still


def while_it_stays(folder: Path, run: str, read: Callable[[Mapping[str, Seal] | None], T]) -> T:
    """What `read` gives for the seals of the run's files; None for those of a run that goes on.

    A fault that it finds stands if the run wasn't resumed, ended or written to while it read.

    Raises:
        IntegrityError: What it found.
    """
    files = manifests.read(folder, run).files
    for _ in range(_READINGS):
        try:
            return read(files)
        except IntegrityError as error:
            found, before = error, files
            files = manifests.read(folder, run).files
            if files == before and not (files is None and layout.is_held(folder / "runs" / run)):
                break
    raise found


def _take(run_folder: Path) -> BinaryIO:
    """The lock of a run; who only looks, or frees space, has it for a moment and is waited for."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return layout.take(run_folder)
        except RegistryBusyError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)


def _take_folder(folder: int, shown: str) -> None:
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise RegistryBusyError(
            f"another sweep runs in {shown}", "wait for it, or stop that process"
        ) from None


def bytes_of(path: Path) -> bytes | None:
    """Of a file; None if it isn't there."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
