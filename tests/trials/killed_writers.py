"""`kill -9` of processes that write to a registry (R1), and of those that care for it (R3)."""

import os
import random
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from released import rebuilt
from trials.children import child

PLAIN: dict[str, Any] = {"kind": "train", "method": "hdm", "task": "BoxDoor", "scenario": None, "sources": []}
FIGURES: dict[str, Any] = {"success_rate": 0.5, "mean_score": 0.5, "mean_length": 1.0, "crispness": 1.0}
END: dict[str, Any] = {"status": "finished", "episodes": 1, "seconds": 1.0, "results": {}}


def write_one(registry: Registry, number: int) -> tuple[str, str]:
    run = registry.add_run(**PLAIN, seed=number, settings={"text": "x" * 500}, versions={}).id
    registry.files.append_rows(run, "episodes", [{"order": number}])
    policy = registry.add_policy(
        run=run, task="BoxDoor", domain="minigrid", method="hdm", seed=number, frames=1, program="",
        checkpoint=safetensors.numpy.save({"x": np.full(500, number, np.float32)}), metadata={}, **FIGURES,
    )  # fmt: skip
    registry.finish_run(run, **END, frames=number)
    return run, policy.id


def _write(location: Path, pipe: int, first: int) -> None:
    registry = Registry(location)
    for number in range(first, first + 10_000):
        os.write(pipe, f"{' '.join(write_one(registry, number))}\n".encode())


def killed_writers(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills a writer at random moments; whatever it acknowledged must be there, and true."""
    location = folder / "registry"
    registry, dice = Registry.open(location), random.Random(seed)
    acknowledged: list[tuple[str, str]] = []
    began = time.monotonic()
    for number in range(10):
        write_one(registry, number)
    took = (time.monotonic() - began) / 10
    for number in range(kills):
        reading, writing = os.pipe()
        process = child(_write, location, writing, number * 10_000)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            told = [tuple(pipe.readline().split()) for _ in range(dice.randrange(3))]
            time.sleep(dice.uniform(0.0, 1.5 * took))
            os.kill(process, signal.SIGKILL)
            assert os.waitpid(process, 0)[1] == signal.SIGKILL
            told += [tuple(line.split()) for line in pipe.read().splitlines()]
        for run, policy in told:
            assert (registry.run(run).status, registry.run(run).policy) == ("finished", policy)
            assert registry.read_checkpoint(registry.policy(policy))
        acknowledged += told  # type: ignore[arg-type]
        if number % 40 == 39:
            _sound(location)
    report = _sound(location, read_data=True)
    assert {name for pair in acknowledged for name in pair} <= set(report.rows)
    assert len(acknowledged) >= kills // 2, "killed too soon to say anything"
    told_twice = len(acknowledged) - len(set(acknowledged))
    mended = repair(location)
    assert not mended.left and not check(location, read_data=True).faults
    assert not [run for run in registry.runs() if run.status == "running"]
    collect(location, grace=0)
    collect(location, grace=0)
    assert not check(location, read_data=True).findings
    return {"kills": kills, "acknowledged": len(acknowledged), "lost": 0, "ids_given_twice": told_twice}


def _sound(location: Path, *, read_data: bool = False) -> Any:
    report = check(location, read_data=read_data)
    assert not report.faults, report.faults
    return report


Care = Callable[[Path, Path], Any]


def _upgrade(location: Path, scratch: Path) -> None:
    Registry.open(location)


def _export(location: Path, scratch: Path) -> None:
    bundles.export(Registry.open(location), "run-1", scratch / f"{os.getpid()}.zip")


def _import(location: Path, scratch: Path) -> None:
    bundles.import_(lambda: Registry.open(location), scratch / "one.zip")


def _gc(location: Path, scratch: Path) -> None:
    collect(location, grace=0)


def _repair(location: Path, scratch: Path) -> None:
    repair(location)


def _check(location: Path, scratch: Path) -> None:
    check(location, read_data=True)


def _lose_a_row(location: Path) -> None:
    import sqlite3

    connection = sqlite3.connect(location / "registry.db")
    connection.execute("DELETE FROM policies WHERE id = 2")
    connection.commit()
    connection.close()


def _leave_things(location: Path) -> None:
    for number in range(20):
        (location / "objects" / f"{number:064x}.safetensors").write_bytes(b"left")


OPERATIONS: dict[str, tuple[Care, Callable[[Path], None]]] = {
    "export": (_export, lambda _: None),
    "import": (_import, lambda _: None),
    "upgrade": (_upgrade, lambda _: None),  # of a registry of the first schema
    "gc": (_gc, _leave_things),
    "repair": (_repair, _lose_a_row),
    "check": (_check, lambda _: None),
}


def killed_care(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills each operation `kills` times: what is left is the old state or the new one, never between."""
    dice = random.Random(seed)
    first_schema = rebuilt("0001", folder / "first")
    sound = folder / "sound"
    registry = Registry.open(sound)
    for number in range(3):
        write_one(registry, number)
    scratch = folder / "scratch"
    scratch.mkdir()
    bundles.export(registry, "policy-3", scratch / "three.zip")
    other = Registry.open(folder / "other")
    write_one(other, 99)
    bundles.export(other, "run-1", scratch / "one.zip")
    for name, (work, prepare) in OPERATIONS.items():
        source = first_schema if name == "upgrade" else sound
        took = _duration(work, prepare, source, folder / "timed", scratch)
        for _ in range(kills):
            location = folder / "killed"
            shutil.copytree(source, location)
            prepare(location)
            rows = set(check(location).rows) | set(check(location).manifests)
            process = child(work, location, scratch)
            time.sleep(dice.uniform(0.0, took * 1.2))
            os.kill(process, signal.SIGKILL)
            assert os.waitpid(process, 0)[1] in (0, signal.SIGKILL)
            _old_or_new(name, location, rows, scratch)
            shutil.rmtree(location)
    return {"operations": len(OPERATIONS), "kills": kills * len(OPERATIONS), "between": 0}


def _duration(work: Care, prepare: Callable[[Path], None], source: Path, place: Path, scratch: Path) -> float:
    shutil.copytree(source, place)
    prepare(place)
    began = time.monotonic()
    os.waitpid(child(work, place, scratch), 0)
    shutil.rmtree(place)
    return time.monotonic() - began


def _old_or_new(name: str, location: Path, before: set[str], scratch: Path) -> None:
    if name == "repair":
        assert not repair(location).left
    Registry.open(location)
    if name == "import":
        repair(location)  # enters what was whole and only not yet entered
    report = _sound(location, read_data=True)
    assert before <= set(report.rows) | set(report.manifests), name
    if name == "import":
        assert len(report.rows) - len(before) in (0, 2), report.rows.keys()
    for bundle in scratch.glob("*.zip"):
        assert bundle.stat().st_size > 1000  # a bundle is there whole or not at all
    collect(location, grace=0)
    collect(location, grace=0)
    left = [found for found in check(location, read_data=True).findings if found.kind != "stopped run"]
    assert not left, (name, left)
