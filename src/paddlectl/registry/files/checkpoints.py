"""What a run needs to go on after it was stopped: its newest two checkpoints, and its tables at that time.

A checkpoint exists once `checkpoints/<number>.json` does, which holds the hash of its arrays and of the run's
tables. It is written after them.
"""

from pathlib import Path
from typing import Any, NamedTuple

from paddlectl.errors import IntegrityError
from paddlectl.registry.files import documents, manifests
from paddlectl.registry.files.objects import sync_folder, write_atomically
from paddlectl.registry.files.rights import make_folder

KEPT = 2
_HINT = "run: paddlectl registry check"


class Checkpoint(NamedTuple):
    """What was saved, and the newer ones that were damaged, if any."""

    document: Any
    arrays: bytes
    skipped: tuple[str, ...] = ()


class Tables:
    """The seals of tables that only grow: what was read once isn't read again."""

    def __init__(self) -> None:
        self._seals: dict[Path, manifests.RunningSeal] = {}

    def seals(self, run: Path) -> dict[str, manifests.Seal]:
        """Of the run's tables as they are, by name."""
        return {table.name: self._running(table).seal() for table in sorted(run.glob("*.jsonl"))}

    def forget(self, run: Path) -> None:
        """Its tables are cut, or it is over."""
        self._seals = {path: seal for path, seal in self._seals.items() if path.parent != run}

    def _running(self, table: Path) -> manifests.RunningSeal:
        return self._seals.setdefault(table, manifests.RunningSeal(table))


def save(run: Path, document: Any, arrays: bytes, tables: dict[str, manifests.Seal]) -> None:
    """Adds a checkpoint to the run's folder and drops all but the last two.

    Args:
        run: The folder.
        document: What is kept, but for its arrays.
        arrays: Those, as a safetensors file.
        tables: The seals of the run's tables as they are.
    """
    documents.sync_files(run)
    folder = run / "checkpoints"
    make_folder(folder)
    sync_folder(run)
    earlier = numbers(run)
    number = max(earlier, default=0) + 1
    path = folder / f"{number}.safetensors"
    write_atomically(path, arrays)
    content = {
        "document": document,
        "arrays": manifests.seal_of(arrays),
        "tables": tables,
    }
    write_atomically(folder / f"{number}.json", documents.with_hash(content, str(path)))
    _remove(folder, sorted(earlier)[: 1 - KEPT])


def numbers(run: Path) -> list[int]:
    """Of the checkpoints that the run has."""
    found = (path.stem for path in (run / "checkpoints").glob("*.json"))
    return [int(stem) for stem in found if stem.isascii() and stem.isdigit() and len(stem) < 10]


def rewind(run: Path) -> Checkpoint | None:
    """Cuts the tables back to the newest whole checkpoint, and gives that; all of them if there was none yet.

    Raises:
        IntegrityError: If there are checkpoints, but none is whole.
    """
    skipped: list[str] = []
    for number in sorted(numbers(run), reverse=True):
        try:
            document, arrays, tables = read(run, number)
        except IntegrityError as error:
            skipped.append(error.message)
            continue
        _cut(run, tables)
        _remove(run / "checkpoints", [other for other in numbers(run) if other > number])
        return Checkpoint(document, arrays, tuple(skipped))
    if skipped:
        raise IntegrityError(f"no checkpoint of {run.name} is whole: {skipped[0]}", _HINT)
    _cut(run, {})
    return None


def read(run: Path, number: int) -> tuple[Any, bytes, dict[str, manifests.Seal]]:
    """A checkpoint's document and arrays, and the seals of the run's tables; all are verified.

    Raises:
        IntegrityError: If one of them isn't what it was.
    """
    path = run / "checkpoints" / f"{number}.json"
    arrays = path.with_suffix(".safetensors")
    try:
        content = documents.checked(path.read_bytes(), str(path))
        data = arrays.read_bytes()
        tables = {str(name): manifests.Seal(*seal) for name, seal in content["tables"].items()}
        document, expected = content["document"], manifests.Seal(*content["arrays"])
    except FileNotFoundError as error:
        raise IntegrityError(f"{error.filename} is missing", _HINT) from None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise IntegrityError(f"{path} is no checkpoint", _HINT) from None
    if manifests.seal_of(data) != expected:
        raise IntegrityError(f"{arrays} isn't what was stored (SHA-256 differs)", _HINT)
    for name, seal in tables.items():
        _verify_table(run / Path(name).name, seal)
    return document, data, tables


def drop(run: Path) -> None:
    """Removes all checkpoints."""
    _remove(run / "checkpoints", numbers(run))


def _verify_table(table: Path, seal: manifests.Seal) -> None:
    try:
        with table.open("rb") as file:
            found = manifests.seal_of(file.read(seal.size))
    except FileNotFoundError:
        raise IntegrityError(f"{table} is missing", _HINT) from None
    if found != seal:
        raise IntegrityError(f"{table} isn't what was stored (SHA-256 differs)", _HINT)


def _cut(run: Path, tables: dict[str, manifests.Seal]) -> None:
    for table in run.glob("*.jsonl"):
        with table.open("r+b") as file:
            file.truncate(tables[table.name].size if table.name in tables else 0)


def _remove(folder: Path, numbers: list[int]) -> None:
    for number in numbers:
        for suffix in ("json", "safetensors"):  # in this order, so that none is there without its arrays
            (folder / f"{number}.{suffix}").unlink(missing_ok=True)
