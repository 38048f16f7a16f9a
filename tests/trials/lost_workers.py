"""Processes of runs that are killed, or whose parent is: none stays, and none stops another."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from samples import ROOT


def children(parent: int) -> list[int]:
    """The processes of jobs that a process started."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            owner = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if owner == parent and b"spawn_main" in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
    return sorted(found)


def started(place: Path, frames: int) -> "subprocess.Popen[str]":
    """`train` with two jobs, both of which have begun to learn."""
    line = [sys.executable, "-m", "paddlectl", "train", "OpenGoal", "BoxDoor", "--frames", str(frames)]
    process = subprocess.Popen(
        [*line, "--jobs", "2", "--registry", str(place)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while len(list(place.glob("runs/*/progress.jsonl"))) < 2:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    return process


def orphans(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """The parent is killed: its processes keep checkpoints, mark their runs and are gone within 10 s."""
    dice, slowest = random.Random(seed), 0.0
    for kill in range(count):
        place = folder / str(kill)
        parent = started(place, 9_999_999)
        workers = children(parent.pid)
        assert len(workers) == 2
        time.sleep(dice.uniform(0.0, 1.0))
        began = time.monotonic()
        parent.kill()
        while any(Path(f"/proc/{worker}/fd").exists() for worker in workers):
            assert time.monotonic() - began <= 10.0, workers
            time.sleep(0.02)
        slowest = max(slowest, time.monotonic() - began)
        parent.communicate()
        with Registry.open(place, create=False) as registry:
            assert [run.status for run in registry.runs()] == ["interrupted"] * 2
        assert len(list(place.glob("runs/*/checkpoints/*.json"))) >= 2
        assert not check(place, read_data=True).findings
    return {"kills": count, "left": 0, "slowest_seconds": round(slowest, 2)}


def lost_workers(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """One of two processes is ended: the other finishes, and what was lost is marked and told."""
    dice, marked = random.Random(seed), 0
    for kill in range(count):
        place = folder / str(kill)
        parent = started(place, 12_288)
        number = dice.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV))
        worker = dice.choice(children(parent.pid))
        with suppress(ProcessLookupError):
            os.kill(worker, number)
        out, told = parent.communicate(timeout=120)
        with Registry.open(place, create=False) as registry:
            runs = registry.runs()
            lost = [run.id for run in runs if run.status == "interrupted"]
            assert [run.status for run in runs if run.id not in lost] == ["finished"] * (2 - len(lost))
        assert len(lost) <= 1
        marked += len(lost)
        for run in lost:
            assert parent.returncode == 1
            assert f"{run} was ended by {number.name}" in told, told
            assert f"run: paddlectl resume {run}" in told, told
        assert out.count("policy-") >= 2 - len(lost)
        assert not check(place, read_data=True).faults
    assert marked > count / 2, "most were killed too late"
    return {"kills": count, "marked": marked, "others_lost": 0}
