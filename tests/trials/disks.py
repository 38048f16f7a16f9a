"""Disks that are full, or fail, at any point: one line, and nothing that was there is lost (R7)."""

import errno
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import safetensors.numpy

from paddlectl.errors import PaddlectlError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from trials.killed_writers import write_one

SIZE = 192 << 20
ARRAYS = safetensors.numpy.save({"x": np.zeros(100)})
_open = os.open


class Failing:
    """Lets every call through until the n-th, which fails as a disk does, and so do all after it."""

    def __init__(self, at: int, number: int) -> None:
        self.left, self.number = at, number

    def __call__(self, real: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*given: Any, **named: Any) -> Any:
            if real is _open and not given[1] & (os.O_WRONLY | os.O_RDWR):
                return real(*given, **named)  # to read goes on a full disk
            self.left -= 1
            if self.left < 0:
                raise OSError(self.number, os.strerror(self.number))
            return real(*given, **named)

        return wrapped


@contextmanager
def failing(at: int, number: int) -> Iterator[Failing]:
    wrap = Failing(at, number)
    places = [
        (os, "fsync"),
        (os, "open"),
        (Path, "replace"),
        (Path, "rename"),
        (Path, "mkdir"),
        (os, "ftruncate"),
    ]
    patches = [mock.patch.object(place, name, _method(wrap(getattr(place, name)))) for place, name in places]
    for patch in patches:
        patch.start()
    try:
        yield wrap
    finally:
        for patch in patches:
            patch.stop()


def _method(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *given, **named: function(*given, **named)


def failing_writes(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Every operation fails at its first point, its second, … until none is left, with one error or two."""
    source = Registry.open(folder / "source")
    for number in range(2):
        write_one(source, number)
    bundles.export(source, "run-2", folder / "two.zip")
    operations: dict[str, Callable[[Path], Any]] = {
        "write": lambda place: write_one(Registry(place), 7),
        "import": lambda place: bundles.import_(lambda: Registry(place), folder / "two.zip"),
        "checkpoint": lambda place: Registry(place).files.save_checkpoint("run-3", {}, ARRAYS),
        "resume": lambda place: Registry(place).resume_run("run-3"),
        "finish": lambda place: Registry(place).finish_run(
            "run-3", status="interrupted", frames=1, episodes=1, seconds=1.0, results={}
        ),
        "repair": lambda place: repair(place),
        "create": lambda place: Registry.open(place / "inner"),
    }
    points = 0
    base = folder / "base"
    registry = Registry.open(base)
    write_one(registry, 0)
    write_one(registry, 1)
    registry.add_run(
        kind="train", method="hdm", task="T", scenario=None, sources=[], seed=0, settings={}, versions={}
    )
    for name, work in operations.items():
        for number in (errno.ENOSPC, errno.EIO)[:count]:
            at = 0
            while True:
                place = folder / "place"
                shutil.copytree(base, place)
                rows = set(check(place).rows)
                with failing(at, number) as wrap:
                    try:
                        work(place)
                    except PaddlectlError as error:
                        assert error.exit_code == 1 and len(str(error).splitlines()) <= 2, (name, at, error)
                report = check(place, read_data=True)
                assert not report.faults and rows <= set(report.rows), (name, at, report.faults)
                work(place)  # goes once the disk is well again
                assert not check(place, read_data=True).faults, (name, at)
                shutil.rmtree(place)
                points += 1
                if wrap.left >= 0:
                    break
                at += 1
    return {"points": points, "operations": len(operations), "lost": 0}


def full_disk(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """In a file system of its own, which is filled again and again to somewhere near its end."""
    mount = f"mount -t tmpfs -o size={SIZE} tmpfs {folder}"
    line = f'{mount} && "$0" "$1" full_disk_within {count} {seed} {folder}'
    soak = Path(__file__).parents[1] / "soak.py"
    command = ["unshare", "-m", "sh", "-c", line, sys.executable, str(soak)]
    done = subprocess.run(command, capture_output=True, text=True)
    if "unshare" in done.stderr or "mount" in done.stderr:
        return {"points": 0, "skipped": "no right to mount a small disk"}
    assert done.returncode == 0, done.stderr[-3000:]
    import json

    found: dict[str, Any] = json.loads(done.stdout)
    return found


def full_disk_within(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Three of four points strike single writes, the fourth a run, which then goes on once there is space."""
    dice = random.Random(seed)
    struck, resumed, place = 0, 0, folder / "registry"
    runs = _Runs() if count > 3 else None
    registry = _emptied(place, runs)
    for point in range(count):
        if _free(folder) < SIZE // 2:  # by what the trial itself has written
            registry = _emptied(place, runs)
        before = {run.id for run in registry.runs()}
        work = runs.begin if runs and point % 4 == 3 else _a_few_writes
        _fill(folder, dice.randrange(1, 40_000 if work is _a_few_writes else 60_000_000))
        struck += _refused(work, registry)
        assert not check(place).faults, check(place).faults
        (folder / "filler").unlink()
        if runs:
            resumed += runs.go_on(registry, before)
        assert not check(place, read_data=True).faults
    return {"points": count, "struck": struck, "runs_resumed": resumed, "lost": 0, "different": 0}


class _Runs:
    """Runs of one kind, which all end alike. To learn takes torch, which who only writes doesn't load."""

    def __init__(self) -> None:
        self._whole: dict[str, Any] = {}

    def begin(self, registry: Registry) -> None:
        from paddlectl.experiments.checkpointer import Checkpointer
        from trials.runs import begin, ended, small

        with small():
            run = begin("paddle default", registry, Checkpointer(0.0))["run"]
        self._whole = self._whole or ended(registry, run)

    def add_sources(self, registry: Registry) -> None:
        """They come first; and so does, once, a run on a disk that has space."""
        from trials.runs import add_sources, small

        with small():
            add_sources(registry)
        if not self._whole:
            self.begin(registry)

    def go_on(self, registry: Registry, before: Collection[str]) -> int:
        """With those that are new and have stopped; how many they were."""
        from paddlectl.experiments.checkpointer import Checkpointer
        from paddlectl.experiments.resuming import resume
        from trials.runs import ended, quiet, small

        resumed = 0
        for run in registry.runs():
            if run.id not in before and run.task == self._whole["run"]["task"] and run.status != "finished":
                with small():
                    resume(run.id, registry, quiet, Checkpointer(0.0))
                assert ended(registry, run.id) == self._whole
                resumed += 1
        return resumed


def _emptied(place: Path, runs: _Runs | None) -> Registry:
    shutil.rmtree(place, ignore_errors=True)
    registry = Registry.open(place)
    if runs:
        runs.add_sources(registry)
    return registry


def _a_few_writes(registry: Registry) -> None:
    for number in range(4):
        write_one(registry, number)


def _refused(work: Callable[[Registry], None], registry: Registry) -> bool:
    """Whether the disk was full; told as it should be."""
    try:
        work(registry)
    except PaddlectlError as error:
        assert error.exit_code == 1 and len(str(error).splitlines()) <= 2, error
        assert "full" in str(error) or "disk" in str(error), error
        return True
    return False


def _free(folder: Path) -> int:
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


def _fill(folder: Path, left: int) -> None:
    with (folder / "filler").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, max(1, _free(folder) - left))
