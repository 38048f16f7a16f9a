"""A study whose sweep is killed at random moments and run again (E11): no cell is repeated or missing."""

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from paddlectl.studies.results import read_results
from samples import ROOT

STUDY = f"""
name: small
scenarios: [{ROOT}/scenarios/A.yaml]
methods: [paddle, hdm]
seeds: 0-1
frames: 4096
source_frames: 4096
"""
RUNS = 8
OWN = ("run", "seconds", "code")
"""What differs between two registries, and with a file that somebody edits meanwhile."""


def killed_sweeps(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills sweeps `kills` times in all, half of them with the processes of their runs."""
    study = folder / "study.yaml"
    study.write_text(STUDY)
    began = time.monotonic()
    begun(study, folder / "whole").wait()
    took, whole = time.monotonic() - began, rows(folder / "whole")
    dice, done, studies = random.Random(seed), 0, 0
    while done < kills:
        studies += 1
        location = folder / f"registry-{studies}"
        while not ended(process := begun(study, location), dice.uniform(0.0, took / 2), done < kills):
            done += 1
            (os.killpg if dice.random() < 0.5 else os.kill)(process.pid, signal.SIGKILL)
            process.wait()
        assert process.returncode == 0, f"sweep ended with {process.returncode}"
        assert rows(location) == whole, [pair for pair in zip(rows(location), whole, strict=True)]
        with Registry.open(location) as registry:
            runs = registry.runs()
        assert not check(location, read_data=True).faults
        assert len(runs) == RUNS, [(run.id, run.method, run.task, run.seed) for run in runs]
        assert Counter(run.status for run in runs) == {"finished": len(runs)}
    return {"kills": done, "studies": studies}


def begun(study: Path, location: Path) -> subprocess.Popen[bytes]:
    """A sweep in a process group of its own."""
    line = [sys.executable, "-m", "paddlectl", "sweep", study, "--registry", location]
    options = ["--results", location.with_suffix(".json"), "--checkpoint-every", "0.5", "--jobs", "2"]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    return subprocess.Popen(
        [*line, *options],
        env=environment,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def ended(process: subprocess.Popen[bytes], seconds: float, may_be_killed: bool) -> bool:
    """Whether it ended by itself within that time, or at all if it isn't to be killed."""
    try:
        process.wait(seconds if may_be_killed else None)
    except subprocess.TimeoutExpired:
        return False
    return True


def rows(location: Path) -> list[dict[str, Any]]:
    """The study's results, but for what is of one registry."""
    found = read_results(location.with_suffix(".json"))
    return [{name: value for name, value in vars(row).items() if name not in OWN} for row in found]
