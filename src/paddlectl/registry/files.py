"""The files of a registry, against what rows and manifests say of them."""

import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import safetensors

from paddlectl.errors import IntegrityError
from paddlectl.registry import checkpoints, documents, layout, manifests
from paddlectl.registry.findings import Report, entries, inside
from paddlectl.registry.manifests import Manifest, Seal
from paddlectl.registry.names import number_of

OBJECT = re.compile(r"[0-9a-f]{64}\.safetensors")


def check_files(report: Report, folder: Path) -> None:
    """That each is there, and has its size."""
    named = {path: seal for m in report.manifests.values() for path, seal in (m.files or {}).items()}
    for file, seal in named.items():
        _sealed_file(report, folder, file, seal)
    for name, row in report.rows.items():
        if name.startswith("policy-") and name not in report.manifests:
            file = f"objects/{row['checkpoint']}.safetensors"
            if file not in named and OBJECT.fullmatch(file[8:]) and not (folder / file).is_file():
                report.add("missing file", file, f"the checkpoint of {name} is missing")
    _objects(report, folder, named)
    for path in entries(folder / "runs"):
        _run_folder(report, folder, path)
    for path in [*folder.glob("registry.db.new*"), *folder.glob("*.part")]:
        report.add("leftover", path.name, "a process was stopped", fault=False)


def _sealed_file(report: Report, folder: Path, name: str, seal: Seal) -> None:
    path = folder / name
    if ".." in path.parts or Path(name).is_absolute():
        report.add("damaged manifest", name, "a manifest names a file outside the registry")
        return
    try:
        found = path.lstat()
    except OSError:
        report.add("missing file", name, "it is missing")
        return
    report.files += 1
    if not stat.S_ISREG(found.st_mode):
        report.add("strange file", name, "it is no file, but a link or folder")
    elif found.st_size != seal.size:
        report.add("changed size", name, f"it has {found.st_size:,} bytes, not {seal.size:,}")


def _objects(report: Report, folder: Path, named: dict[str, Seal]) -> None:
    owned = {
        f"objects/{row['checkpoint']}.safetensors" for row in report.rows.values() if "checkpoint" in row
    }
    for path in entries(folder / "objects"):
        name = inside(folder, path)
        if path.name.endswith(".part"):
            report.add("leftover", name, "a writer was stopped", fault=False)
        elif not OBJECT.fullmatch(path.name):
            report.add("stray file", name, "nothing of the registry's is called so")
        elif name not in named and name not in owned:
            report.add("leftover", name, "no policy has it", fault=False)
        elif name in named and f"{named[name].sha256}.safetensors" != path.name:
            report.add("wrong name", name, "a manifest gives it another hash than its name")


def _run_folder(report: Report, folder: Path, path: Path) -> None:
    name = path.name
    if name.endswith(".part"):
        report.add("leftover", inside(folder, path), "a writer was stopped", fault=False)
        return
    if number_of(name, "run") is None or not path.is_dir() or path.is_symlink():
        report.add("stray file", inside(folder, path), "it is no folder of a run")
        return
    if name not in report.rows and name not in report.manifests:
        if any(path.iterdir()):
            report.add("lost run", name, "its files are there, but neither row nor manifest")
        else:
            report.add("leftover", name, "its process died before it was entered", fault=False)
    manifest = report.manifests.get(name)
    for file in entries(path):
        if file.name.endswith(".part"):
            report.add("leftover", inside(folder, file), "a writer was stopped", fault=False)
        elif file.name not in ("lock", "checkpoints"):
            _run_file(report, folder, file, manifest)
    for number in checkpoints.numbers(path):
        if not (path / "checkpoints" / f"{number}.safetensors").exists():
            report.add("damaged checkpoint", f"{name}, checkpoint {number}", "its arrays are missing")


def _run_file(report: Report, folder: Path, path: Path, manifest: Manifest | None) -> None:
    name = inside(folder, path)
    if path.suffix not in (".json", ".jsonl") or not path.is_file():
        report.add("stray file", name, "no run writes such a file")
    elif manifest is not None and manifest.files is not None and name not in manifest.files:
        report.add("unsealed file", name, "it wasn't there when the run ended")


# Their contents, which are read while others may write


def check_contents(report: Report, folder: Path) -> None:
    known = {finding.where for finding in report.findings}
    for manifest in report.manifests.values():
        for file, seal in (manifest.files or {}).items():
            if file not in known:
                _sealed_bytes(report, folder, manifest.name, file, seal)
    for run in entries(folder / "runs"):
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
        meanwhile = False
    if not meanwhile:  # else the run was resumed
        report.add("changed bytes", name, "it isn't what was stored (SHA-256 differs)")


def _open_table(report: Report, folder: Path, path: Path) -> None:
    data = path.read_bytes()
    report.bytes += len(data)
    read: Callable[[bytes, Path], Any] = (
        documents.rows_of if path.suffix == ".jsonl" else documents.document_of
    )
    try:
        read(data, path)
    except IntegrityError as error:
        report.add("damaged table", inside(folder, path), error.message)


def _checkpoint(report: Report, run: Path, number: int) -> None:
    try:
        _, data, _ = checkpoints.read(run, number)
        report.bytes += len(data)
        safetensors.deserialize(data)  # type: ignore[no-untyped-call]
    except (IntegrityError, safetensors.SafetensorError) as error:
        if number in checkpoints.numbers(run):  # else a newer one has taken its place
            what = str(error).partition("\n")[0]
            report.add("damaged checkpoint", f"{run.name}, checkpoint {number}", what)
