"""A run's folder: its tables and documents, its checkpoints, and who holds it."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Any

from paddlectl.errors import NotFoundError
from paddlectl.registry import checkpoints, documents, layout, manifests
from paddlectl.registry.faults import faults
from paddlectl.registry.names import number_of, shown


class RunFiles:
    """The files of the runs in a registry's folder.

    Attributes:
        folder: Where all files are.
        shown: The registry's place for messages.
    """

    folder: Path
    shown: str

    @contextmanager
    def hold(self, run: str) -> Iterator[None]:
        """Says to other processes that the run goes on here, until the block or the process ends.

        Raises:
            RegistryBusyError: If it goes on in another process.
        """
        with faults(self.shown):
            file = layout.take(self._run_folder(run))
        with file:
            yield

    def append_rows(self, run: str, name: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Adds rows to the run's `<name>.jsonl`."""
        with faults(self.shown):
            documents.append_rows(self._run_folder(run), name, rows)

    def read_rows(self, run: str, name: str) -> list[dict[str, Any]]:
        """The rows of the run's `<name>.jsonl`; empty if there is none.

        Raises:
            IntegrityError: If the run has ended, and the file isn't what it was then.
        """
        with faults(self.shown):
            path, data = self._read(run, name, "jsonl")
            return [] if data is None else documents.rows_of(data, path)

    def each_row(self, run: str, name: str) -> Iterator[dict[str, Any]]:
        """The rows of the `<name>.jsonl` of a run that goes on, one at a time; nothing if there is none."""
        with faults(self.shown), suppress(FileNotFoundError):
            path = documents.file_of(self._run_folder(run), name, "jsonl")
            with path.open("rb") as file:
                yield from documents.each_row(file, path)

    def write_document(self, run: str, name: str, document: Any) -> None:
        """Writes or replaces the run's `<name>.json` whole."""
        with faults(self.shown):
            documents.write_document(self._run_folder(run), name, document)

    def read_document(self, run: str, name: str) -> Any | None:
        """The value of the run's `<name>.json`; None if there is none.

        Raises:
            IntegrityError: If the run has ended, and the file isn't what it was then.
        """
        with faults(self.shown):
            path, data = self._read(run, name, "json")
            return None if data is None else documents.document_of(data, path)

    # Checkpoints of a run that goes on

    def save_checkpoint(self, run: str, document: Any, arrays: bytes) -> None:
        """Keeps all that a run needs to go on, beside its tables as they are now; the last two are kept."""
        with faults(self.shown):
            folder = self._run_folder(run)
            checkpoints.save(folder, document, arrays, self._tables.seals(folder))

    def rewind(self, run: str) -> checkpoints.Checkpoint | None:
        """Cuts the run's tables back to its newest whole checkpoint, and gives that; None if it had none yet.

        Raises:
            IntegrityError: If it has checkpoints, but none of them is whole.
        """
        with faults(self.shown):
            folder = self._run_folder(run)
            self._tables.forget(folder)
            return checkpoints.rewind(folder)

    def drop_checkpoints(self, run: str) -> None:
        """Frees their space once the run is finished."""
        with faults(self.shown):
            folder = self._run_folder(run)
            self._tables.forget(folder)
            checkpoints.drop(folder)

    @cached_property
    def _tables(self) -> checkpoints.Tables:
        return checkpoints.Tables()

    def _read(self, run: str, name: str, suffix: str) -> tuple[Path, bytes | None]:
        path = documents.file_of(self._run_folder(run), name, suffix)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            data = None
        files = manifests.read(self.folder, run).files
        if files is not None and (data is not None or manifests.key(self.folder, path) in files):
            manifests.verify(self.folder, path, data, files)
        return path, data

    def _run_folder(self, run: str) -> Path:
        if number_of(run, "run") is None or not (self.folder / "runs" / run).is_dir():
            raise NotFoundError(f"no folder of a run {shown(run)}", "run: paddlectl runs")
        return self.folder / "runs" / run
