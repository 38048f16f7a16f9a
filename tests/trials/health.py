"""What `registry check` finds: each planted fault, nothing in a healthy registry, and that quickly (R10)."""

import random
import shutil
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from filler import ARRAYS, Filler
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from released import rebuilt
from trials.faults import FAULTS

ENDS: dict[str, Any] = {"frames": 10, "episodes": 2, "seconds": 1.5, "results": {"success_rate": 0.5}}
SLOWEST = 100.0  # megabytes a second
SIZE = 3_000_000  # bytes of a policy's checkpoint, as the tasks' are


class Life:
    """What happens to a registry in use, one thing after another."""

    def __init__(self, registry: Registry, dice: random.Random, scratch: Path) -> None:
        self.registry, self.dice, self.scratch = registry, dice, scratch
        self.add = Filler(registry)
        self.held = ExitStack()

    def goes_on(self, things: int) -> None:
        """So many of them."""
        ways = (
            *(self.finished, self.finished, self.stopped, self.failed, self.running, self.resumed),
            *(self.imported, self.cleaned, self.mended),
        )
        for _ in range(things):
            self.dice.choice(ways)()

    def begun(self) -> str:
        """A run with tables and documents, perhaps with sources."""
        policies = [policy.id for policy in self.registry.policies()]
        sources = self.dice.sample(policies, min(len(policies), self.dice.randrange(3)))
        run = self.add.run(
            kind="transfer" if sources else "train", sources=sources, scenario="A-place" if sources else None
        ).id
        for name in self.dice.sample(["episodes", "progress", "weights"], self.dice.randrange(4)):
            rows = [{"order": n, "score": self.dice.random()} for n in range(self.dice.randrange(200))]
            self.registry.files.append_rows(run, name, rows)
        if sources:
            self.registry.files.write_document(run, "mapping", {"target": "T", "ψ": [self.dice.random()]})
        return run

    def finished(self, run: str = "") -> None:
        run = run or self.begun()
        shared = self.dice.random() < 0.2  # two policies with the same checkpoint are one object
        data = ARRAYS if shared else _arrays(self.dice.randrange(1, 20_000), self.dice)
        self.add.policy(run, checkpoint=data)
        self.registry.finish_run(run, status="finished", **ENDS)
        self.registry.files.drop_checkpoints(run)

    def stopped(self) -> str:
        run = self.running(held=False)
        self.registry.finish_run(run, status="interrupted", **ENDS)
        return run

    def failed(self) -> None:
        self.registry.finish_run(self.begun(), status="failed", **ENDS)

    def running(self, *, held: bool = True) -> str:
        """A run that another process is at, for all that the registry knows."""
        run = self.begun()
        if held:
            self.held.enter_context(self.registry.files.hold(run))
        for number in range(self.dice.randrange(1, 4)):
            self.registry.files.append_rows(run, "episodes", [{"order": number}])
            self.registry.files.save_checkpoint(run, {"frames": number}, ARRAYS)
        return run

    def resumed(self) -> None:
        run = self.stopped()
        self.registry.resume_run(run)
        self.registry.files.rewind(run)
        self.registry.files.append_rows(run, "episodes", [{"order": 99}])
        self.finished(run)

    def imported(self) -> None:
        elsewhere = Registry.open(self.scratch / "elsewhere")
        Life(elsewhere, self.dice, self.scratch).finished()
        bundle = self.scratch / "x.zip"
        bundles.export(elsewhere, elsewhere.runs()[0].id, bundle)
        bundles.import_(lambda: self.registry, bundle)
        bundle.unlink()
        shutil.rmtree(self.scratch / "elsewhere")

    def cleaned(self) -> None:
        (self.registry.folder / "objects" / f"{self.dice.randrange(10**9):064}.safetensors").write_bytes(b"")
        collect(self.registry.location, grace=0)

    def mended(self) -> None:
        self.failed()  # a registry without anything in it would be none then
        (self.registry.folder / "registry.db").unlink()
        assert not repair(self.registry.location).left


def _arrays(length: int, dice: random.Random) -> bytes:
    return safetensors.numpy.save({"x": np.frombuffer(dice.randbytes(4 * length), np.uint8)})


def healthy_registries(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many registries with all kinds of lives behind them, in which nothing is to be found."""
    dice = random.Random(seed)
    Registry.open(folder / "new")
    rows = files = size = 0
    for number in range(count):
        place = folder / "registry"
        if number % 10:
            shutil.copytree(folder / "new", place)
        else:
            Registry.open(rebuilt("0001", place))
            repair(place)  # of the run that was running when the fixture was made
        life = Life(Registry.open(place), dice, folder)
        with life.held:
            life.goes_on(dice.randrange(10))
            report = check(place, read_data=True)
            assert report.findings == [], report.findings
        rows, files, size = rows + len(report.rows), files + report.files, size + report.bytes
        shutil.rmtree(place)
    return {"registries": count, "rows": rows, "files": files, "bytes": size, "false_alarms": 0}


def planted_faults(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many registries with a fault each, of every kind in turn, all of them found by name."""
    dice = random.Random(seed)
    Registry.open(folder / "new")
    names = list(FAULTS)
    for number in range(count):
        kind, plant = FAULTS[names[number % len(names)]]
        place = folder / "registry"
        shutil.copytree(folder / "new", place)
        life = Life(Registry.open(place), dice, folder)
        life.add.all_kinds()
        for _ in range(dice.randrange(3)):
            dice.choice([life.finished, life.failed, life.imported])()
        plant(place)
        found = {finding.kind for finding in check(place, read_data=True).faults}
        assert kind in found, (names[number % len(names)], found)
        shutil.rmtree(place)
    return {"faults": count, "kinds": len({kind for kind, _ in FAULTS.values()}), "missed": 0}


def checked_bytes(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """A registry of so many megabytes: runs of the usual size, one in four of them not finished yet.

    The files are in memory where there is such a place, so the disk isn't measured.
    """
    dice, place = random.Random(seed), folder / "registry"
    registry, written = Registry.open(place), 0
    add = Filler(registry)
    with ExitStack() as held:
        while written < count * 1_000_000:
            run = add.run().id
            rows = [
                {"order": n, "score": dice.random(), "length": n % 320, "success": True} for n in range(4000)
            ]
            registry.files.append_rows(run, "episodes", rows)
            data = safetensors.numpy.save({"x": np.frombuffer(dice.randbytes(SIZE), np.uint8)})
            if dice.random() < 0.75:
                add.policy(run, checkpoint=data)
                registry.finish_run(run, status="finished", **ENDS)
            else:
                held.enter_context(registry.files.hold(run))
                registry.files.save_checkpoint(run, {}, data)
            written += SIZE
        speeds: list[float] = []
        for _ in range(3):
            began = time.monotonic()
            report = check(place, read_data=True)
            speeds.append(report.bytes / 1e6 / (time.monotonic() - began))
            assert not report.findings, report.findings
    assert sorted(speeds)[1] >= SLOWEST, speeds
    figures = {"rows": len(report.rows), "files": report.files, "bytes": report.bytes}
    return figures | {"megabytes_a_second": round(sorted(speeds)[1])}
