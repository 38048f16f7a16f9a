"""A study on a Ray cluster that loses nodes, processes or its head at random moments.

Each cell is there once, and is to the last bit what it is at home.
"""

import importlib.util
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from nodes import Nodes, nodes, until
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from samples import ROOT
from trials.killed_sweeps import RUNS, STUDY, ended, rows
from trials.killed_sweeps import begun as begun_at_home

A_SWEEP = 3  # losses at most, as Ray begins a cell anew no more often
SKIPPED = {"skipped": "Ray isn't installed"}


def lost_nodes(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many nodes and processes of cells are killed; the sweep ends well, as if nothing had been."""
    if not importlib.util.find_spec("ray"):
        return SKIPPED
    dice, done, amid, studies = random.Random(seed), 0, 0, 0
    whole = Whole(folder)
    with nodes(2) as made:
        while done < count:
            studies += 1
            location = folder / f"registry-{studies}"
            process = begun(folder, location, made)
            for _ in range(min(A_SWEEP, count - done)):
                until(partial(_learns, process, made))
                if ended(process, dice.uniform(0.0, whole.took / A_SWEEP / 2), True):
                    break
                done += 1
                if dice.random() < 0.5:
                    amid += made.lose_worker()
                else:
                    amid += made.lose(dice.randrange(2))
                    made.add()
            told = process.communicate(timeout=600)
            assert process.returncode == 0, told
            whole.require_same(location)
    assert amid > count / 3, "most were killed while nothing was learned"
    return {"losses": done, "amid_cells": amid, "studies": studies, "different": 0}


def lost_heads(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many times the head is restarted, or the sweep stopped; then the same command ends the study."""
    if not importlib.util.find_spec("ray"):
        return SKIPPED
    dice, done, studies, kept = random.Random(seed), 0, 0, 0
    whole = Whole(folder)
    with nodes(2) as made:
        while done < count:
            studies += 1
            location = folder / f"registry-{studies}"
            while True:
                process = begun(folder, location, made)
                if done < count and dice.random() < 0.8:  # else perhaps while Ray begins
                    until(partial(_learns, process, made))
                if ended(process, dice.uniform(2.0, whole.took / 3), done < count):
                    break
                done += 1
                _stop(process, made, dice)
                kept += len(_runs(location))
            assert process.returncode == 0, process.communicate()
            whole.require_same(location)
    return {"stops": done, "studies": studies, "kept": kept, "different": 0}


class Whole:
    """The study as it is without Ray, and what was learned in it."""

    def __init__(self, folder: Path) -> None:
        (folder / "study.yaml").write_text(STUDY.replace("4096", "2048"))
        self._location = folder / "whole"
        began = time.monotonic()
        begun_at_home(folder / "study.yaml", self._location).wait()
        self.took = time.monotonic() - began

    def require_same(self, location: Path) -> None:
        assert rows(location) == rows(self._location)
        assert learned(location) == learned(self._location)
        assert len(learned(location)) == len(_runs(location)) == RUNS
        assert Counter(_runs(location)) == {"finished": RUNS}
        assert not check(location, read_data=True).faults


def begun(folder: Path, location: Path, made: Nodes) -> "subprocess.Popen[str]":
    line = [sys.executable, "-m", "paddlectl", "sweep", folder / "study.yaml", "--on", made.address]
    return subprocess.Popen(
        [*line, "--registry", location, "--results", location.with_suffix(".json")],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def learned(location: Path) -> dict[tuple[Any, ...], str]:
    """The SHA-256 of what each run learned."""
    with Registry.open(location, create=False) as registry:
        policies = registry.policies()
        return {(each.task, each.method, each.seed): each.checkpoint for each in policies}


def _learns(process: "subprocess.Popen[str]", made: Nodes) -> bool:
    """Whether cells go on, or all is over."""
    return made.learning() > 0 or process.poll() is not None


def _runs(location: Path) -> list[str]:
    with Registry.open(location) as registry:
        return [run.status for run in registry.runs()]


def _stop(process: "subprocess.Popen[str]", made: Nodes, dice: random.Random) -> None:
    """Ends a sweep, perhaps by the loss of its cluster, and sees that it says so in few words."""
    way = dice.choice(["head", signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
    if isinstance(way, signal.Signals):
        process.send_signal(way)
    else:
        made.restart()
    _, told = process.communicate(timeout=200)
    assert "Traceback" not in told, told
    until(lambda: not made.learning(), 30.0)
    if way == signal.SIGKILL:
        assert process.returncode in (0, -signal.SIGKILL), told
    elif isinstance(way, signal.Signals):
        assert process.returncode in (0, 128 + way, -way), (way, told)
    else:
        assert process.returncode in (0, 1), told
        if process.returncode:
            error, hint = told.splitlines()[-2:]
            assert error.startswith(f"error: the Ray cluster {made.address} "), told
            assert hint.startswith("check it with: ray status; "), told
