"""The files of a registry, against what rows and manifests say of them."""

import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import safetensors

from paddlectl.errors import IntegrityError
from paddlectl.registry.care import tombstones
from paddlectl.registry.care.findings import Finding, Report, entries, inside
from paddlectl.registry.files import checkpoints, documents, layout, manifests
from paddlectl.registry.files.manifests import Manifest, Seal
from paddlectl.registry.files.runfiles import bytes_of, while_it_stays
from paddlectl.registry.names import number_of

OBJECT = re.compile(r"[0-9a-f]{64}\.safetensors")

Rows = Mapping[str, Mapping[str, Any]]


class Objects(NamedTuple):
    """The objects that there should be: by manifests, each with its seal, and by rows."""

    sealed: Mapping[str, Seal]
    owned: Collection[str]


def objects_of(report: Report, rows: Rows) -> Objects:
    """The objects that these rows and the report's manifests name."""
    sealed = {path: seal for m in report.manifests.values() for path, seal in (m.files or {}).items()}
    return Objects(sealed, {_object_of(row) for row in rows.values() if "checkpoint" in row})


def files_of(report: Report, folder: Path, name: str, row: Mapping[str, Any] | None) -> Iterator[Finding]:
    """What is wrong with the files of a run or policy: each is there, and has its size."""
    manifest = report.manifests.get(name)
    for file, seal in ((manifest and manifest.files) or {}).items():
        yield from _sealed_file(report, folder, file, seal)
    if name.startswith("run-"):
        yield from _run_folder(report, folder, folder / "runs" / name, row)
    elif manifest is None and row is not None:
        file = _object_of(row)
        if OBJECT.fullmatch(file[8:]) and not (folder / file).is_file():
            yield Finding("missing file", file, f"the checkpoint of {name} is missing")


def other_files(folder: Path) -> list[str]:
    """Paths of all that is no run's own: objects, and what may be astray or left over."""
    found = [path for path in entries(folder / manifests.FOLDER) if not manifests.is_one(path)]
    found += entries(folder / "objects")
    found += [path for path in entries(folder / "runs") if number_of(path.name, "run") is None]
    found += [*folder.glob("registry.db.new*"), *folder.glob("*.part"), *tombstones.folders(folder)]
    return [inside(folder, path) for path in found]


def other_file(folder: Path, name: str, objects: Objects) -> Iterator[Finding]:
    """What is wrong with one of those."""
    path = folder / name
    if not path.exists() and not path.is_symlink():
        return
    if path.parent == folder and path.name.startswith(tombstones.FOLDER):
        yield Finding("leftover", name, "a deletion was stopped; gc and repair end it", fault=False)
    elif path.parent == folder:
        yield Finding("leftover", name, "a process was stopped", fault=False)
    elif path.parent.name == "runs" and name.endswith(".part"):
        yield Finding("leftover", name, "a writer was stopped", fault=False)
    elif path.parent.name == "runs":
        yield Finding("stray file", name, "it is no folder of a run")
    elif path.name.endswith(".part"):
        yield Finding("leftover", name, "a writer was stopped", fault=False)
    elif path.parent.name != "objects" or not OBJECT.fullmatch(path.name):
        yield Finding("stray file", name, "nothing of the registry's is called so")
    elif name not in objects.sealed and name not in objects.owned:
        yield Finding("leftover", name, "no policy has it", fault=False)
    elif name in objects.sealed and f"{objects.sealed[name].sha256}.safetensors" != path.name:
        yield Finding("wrong name", name, "a manifest gives it another hash than its name")


def _object_of(row: Mapping[str, Any]) -> str:
    return f"objects/{row['checkpoint']}.safetensors"


def _sealed_file(report: Report, folder: Path, name: str, seal: Seal) -> Iterator[Finding]:
    path = folder / name
    if ".." in path.parts or Path(name).is_absolute():
        yield Finding("damaged manifest", name, "a manifest names a file outside the registry")
        return
    try:
        found = path.lstat()
    except OSError:
        yield Finding("missing file", name, "it is missing")
        return
    report.sealed.add(name)
    if not stat.S_ISREG(found.st_mode):
        yield Finding("strange file", name, "it is no file, but a link or folder")
    elif found.st_size != seal.size:
        yield Finding("changed size", name, f"it has {found.st_size:,} bytes, not {seal.size:,}")


def _run_folder(report: Report, folder: Path, path: Path, row: Mapping[str, Any] | None) -> Iterator[Finding]:
    name, manifest = path.name, report.manifests.get(path.name)
    if not path.exists() and not path.is_symlink():
        return
    if not path.is_dir() or path.is_symlink():
        yield Finding("stray file", inside(folder, path), "it is no folder of a run")
        return
    inner = entries(path)
    if row is None and manifest is None:
        if inner:
            yield Finding("lost run", name, "its files are there, but neither row nor manifest")
        else:
            yield Finding("leftover", name, "its process died before it was entered", fault=False)
    for file in inner:
        if file.name.endswith(".part"):
            if not layout.is_held(path) and file.exists():  # else its writer is at it
                yield Finding("leftover", inside(folder, file), "a writer was stopped", fault=False)
        elif file.name not in ("lock", "checkpoints"):
            yield from _run_file(folder, file, manifest)
    for number in checkpoints.numbers(path):
        if _lacks_arrays(path, number):
            yield Finding("damaged checkpoint", f"{name}, checkpoint {number}", "its arrays are missing")


def _lacks_arrays(run: Path, number: int) -> bool:
    """Whether a checkpoint has lost its arrays; looked at twice, since a run may drop it and make it anew."""
    arrays = run / "checkpoints" / f"{number}.safetensors"
    return all(not arrays.exists() and number in checkpoints.numbers(run) for _ in range(2))


def _run_file(folder: Path, path: Path, manifest: Manifest | None) -> Iterator[Finding]:
    name = inside(folder, path)
    if path.suffix not in (".json", ".jsonl") or not path.is_file():
        yield Finding("stray file", name, "no run writes such a file")
    elif manifest is not None and manifest.files is not None and name not in manifest.files:
        yield Finding("unsealed file", name, "it wasn't there when the run ended")


# Their contents, which are read while others may write


def check_contents(report: Report, folder: Path) -> None:
    known = {finding.where for finding in report.findings}
    for manifest in report.manifests.values():
        for file, seal in (manifest.files or {}).items():
            if file not in known:
                _sealed_bytes(report, folder, manifest.name, file, seal)
    dead = tombstones.dead(folder, report.rows)
    for run in entries(folder / "runs"):
        if run.name in dead:
            continue
        goes_on = run.name in report.manifests and report.manifests[run.name].files is None
        for path in layout.run_files(folder, run.name) if goes_on else ():
            _open_table(report, folder, path)
        for number in checkpoints.numbers(run):
            if f"{run.name}, checkpoint {number}" not in known:
                _checkpoint(report, run, number)


def _sealed_bytes(report: Report, folder: Path, owner: str, name: str, seal: Seal) -> None:
    try:
        same = manifests.seal(folder / name) == seal
    except FileNotFoundError:
        same = False
    if same:
        report.bytes += seal.size
        return
    try:
        meanwhile = (manifests.read(folder, owner).files or {}).get(name) != seal
    except IntegrityError:
        meanwhile = not manifests.path_of(folder, owner).exists()
    if not meanwhile:  # else the run was resumed, or taken back
        report.add("changed bytes", name, "it isn't what was stored (SHA-256 differs)")


def _open_table(report: Report, folder: Path, path: Path) -> None:
    read: Callable[[bytes, Path], Any] = (
        documents.rows_of if path.suffix == ".jsonl" else documents.document_of
    )
    try:
        data = while_it_stays(folder, path.parent.name, lambda _: _parsed(path, read))
        report.bytes += len(data)
    except IntegrityError as error:
        if manifests.path_of(folder, path.parent.name).exists():  # else the run was taken back
            report.add("damaged table", inside(folder, path), error.message)


def _parsed(path: Path, read: Callable[[bytes, Path], Any]) -> bytes:
    data = bytes_of(path)
    if data is not None:
        read(data, path)
    return data or b""


def _checkpoint(report: Report, run: Path, number: int) -> None:
    told = run / "checkpoints" / f"{number}.json"
    before = None
    while (now := bytes_of(told)) is not None and now != before:  # else it was dropped, or isn't sound
        before = now
        try:
            _, data, _ = checkpoints.read(run, number)
            safetensors.deserialize(data)  # type: ignore[no-untyped-call]
        except (IntegrityError, safetensors.SafetensorError) as error:
            found = str(error).partition("\n")[0]
        else:
            report.bytes += len(data)
            return
    if now is not None:
        report.add("damaged checkpoint", f"{run.name}, checkpoint {number}", found)
