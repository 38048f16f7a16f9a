"""Changed bits, cuts and swaps of what is stored: all are found before it is used (R8)."""

import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from filler import Filler
from paddlectl.errors import IntegrityError
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry

Use = Callable[[], Any]


def changed_files(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """As many flipped bits, a tenth as many cuts and a fortieth as many swaps, in files drawn at random.

    Every change must be refused by what uses the file, and every tenth of them be found by `check` too.
    """
    dice, place = random.Random(seed), folder / "registry"
    registry = Registry.open(place)
    Filler(registry).all_kinds()
    uses = _uses(registry)
    whole = {place / name: (place / name).read_bytes() for name in uses}
    assert not check(place, read_data=True).findings
    cuts, swaps = -(-count // 10), -(-count // 40)
    for number in range(count + cuts + swaps):
        paths = [dice.choice(list(whole))]
        if number < count:
            paths[0].write_bytes(_flipped(whole[paths[0]], dice))
        elif number < count + cuts:
            paths[0].write_bytes(whole[paths[0]][: dice.randrange(len(whole[paths[0]]))])
        else:
            paths = dice.sample(dice.choice(_alike(whole)), 2)
            for path, other in zip(paths, reversed(paths), strict=True):
                path.write_bytes(whole[other])
        for path in paths:
            _refused(uses[path.relative_to(place).as_posix()], path)
        if number % 10 == 0:
            _refused(partial(_checked, place), paths[0])
        for path, data in whole.items():  # going back to a checkpoint removes files, too
            if not path.exists() or path.read_bytes() != data:
                path.write_bytes(data)
    assert not check(place, read_data=True).findings
    return {"flips": count, "cuts": cuts, "swaps": swaps, "files": len(whole), "undetected": 0}


def _uses(registry: Registry) -> dict[str, Use]:
    """What reads each file, by its path within the registry; `check`, where nothing else needs the file."""
    checked = partial(_checked, registry.folder)
    uses: dict[str, Use] = {}
    for policy in registry.policies():
        uses[f"objects/{policy.checkpoint}.safetensors"] = partial(registry.read_checkpoint, policy)
        uses[f"manifests/{policy.id}.json"] = checked
    for run in registry.runs():
        for path in (registry.folder / "runs" / run.id).glob("*.json*"):
            read = registry.files.read_rows if path.suffix == ".jsonl" else registry.files.read_document
            uses[f"runs/{run.id}/{path.name}"] = partial(read, run.id, path.stem)
        uses[f"manifests/{run.id}.json"] = partial(registry.files.read_rows, run.id, "episodes")
    for suffix in ("json", "safetensors"):
        uses[f"runs/run-3/checkpoints/2.{suffix}"] = partial(_go_back, registry)
        uses[f"runs/run-3/checkpoints/1.{suffix}"] = checked
    return uses


def _go_back(registry: Registry) -> None:
    """To the newest whole checkpoint; that a damaged one was passed over for the one before is told."""
    found = registry.files.rewind("run-3")
    assert found is not None
    if found.skipped:
        assert found.document == {"frames": 1}
        raise IntegrityError(found.skipped[0])


def _checked(place: Path) -> None:
    if faults := check(place, read_data=True).faults:
        raise IntegrityError(faults[0].what)


def _refused(use: Use, path: Path) -> None:
    try:
        use()
    except IntegrityError as error:
        assert error.exit_code == 5
        return
    raise AssertionError(f"{path} was used although it had been changed")


def _flipped(data: bytes, dice: random.Random) -> bytes:
    changed = bytearray(data)
    changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _alike(whole: dict[Path, bytes]) -> list[list[Path]]:
    """Groups of files that could stand for each other but for what is in them."""
    groups: dict[tuple[str, ...], list[Path]] = {}
    for path in whole:
        kind = path.parts[-2].partition("-")[0], path.stem.partition("-")[0], path.suffix
        groups.setdefault(kind if kind[0] in ("run", "manifests") else (kind[0], kind[2]), []).append(path)
    return [group for group in groups.values() if len({whole[path] for path in group}) == len(group) > 1]
