"""Runs that are killed at random moments (R2), as is their resumption, or stopped by a signal (R4)."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.resuming import resume
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from samples import ROOT
from trials.children import child
from trials.runs import KINDS, add_sources, begin, ended, quiet, small


def _begin(location: Path, kind: str) -> None:
    begin(kind, Registry.open(location), Checkpointer(0.0))


def _resume(location: Path, run: str) -> None:
    resume(run, Registry.open(location), quiet, Checkpointer(0.0))


def killed_runs(kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Kills runs of every kind `kills` times in all, each at a moment spread over what is left of it."""
    location = folder / "registry"
    dice, done, most_lost, runs = random.Random(seed), 0, 0, 0
    with small():
        registry = Registry.open(location)
        add_sources(registry)
        whole: dict[str, Any] = {}
        took: dict[str, float] = {}
        for kind in KINDS:
            began = time.monotonic()
            whole[kind] = ended(registry, begin(kind, registry, Checkpointer(0.0))["run"])
            took[kind] = time.monotonic() - began
        while done < kills:
            kind = KINDS[runs % len(KINDS)]
            before = {run.id for run in registry.runs()}
            process = child(_begin, location, kind)
            run = None
            for _ in range(min(kills - done, dice.randrange(1, 8))):
                time.sleep(dice.uniform(0.0, took[kind] * 0.6))
                os.kill(process, signal.SIGKILL)
                code = os.waitpid(process, 0)[1]
                assert code in (0, signal.SIGKILL), code
                done += 1
                run = next((run for run in registry.runs() if run.id not in before), None)
                assert not check(location).faults, check(location).faults
                if run is not None and run.status == "finished":
                    break
                if run is not None:
                    most_lost = max(most_lost, _lost(registry, run.id))
                process = child(_resume, location, run.id) if run else child(_begin, location, kind)
            if not (run and run.status == "finished"):
                assert os.waitpid(process, 0)[1] == 0
            run = next(run for run in registry.runs() if run.id not in before)
            assert ended(registry, run.id) == whole[kind], f"{kind} with seed {seed} ended differently"
            runs += 1
        assert not check(location, read_data=True).faults
    assert most_lost <= 1, f"{most_lost} rounds lost"
    return {"kills": done, "runs": runs, "different": 0, "rounds_lost_at_most": most_lost}


def _lost(registry: Registry, run: str) -> int:
    """Rounds that the tables know and the newest checkpoint doesn't, a checkpoint being kept each round."""
    from paddlectl.registry.files import checkpoints

    folder = registry.folder / "runs" / run
    told = (
        len((folder / "progress.jsonl").read_bytes().split(b"\n")) - 1
        if folder.exists() and (folder / "progress.jsonl").exists()
        else 0
    )
    numbers = checkpoints.numbers(folder)
    if not numbers:
        return told
    _, _, tables = checkpoints.read(folder, max(numbers))
    size = tables["progress.jsonl"].size
    return told - (folder / "progress.jsonl").read_bytes()[:size].count(b"\n")


def stopped_runs(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """SIGTERM at random moments: a checkpoint, the state `interrupted`, all within five seconds (R4)."""
    from paddlectl.experiments.stop import Stop

    dice, slowest, location = random.Random(seed), 0.0, folder / "registry"

    def work(kind: str) -> None:
        stop = Stop()
        signal.signal(signal.SIGTERM, stop)
        try:
            begin(kind, Registry.open(location), Checkpointer(1000.0, stop))
        except KeyboardInterrupt:
            os._exit(3)

    with small():
        registry = Registry.open(location)
        add_sources(registry)
        for number in range(count):
            before = {run.id for run in registry.runs()}
            process = child(work, KINDS[number % len(KINDS)])
            while not (new := [run for run in registry.runs() if run.id not in before]):
                time.sleep(0.02)
            kept = registry.folder / "runs" / new[0].id
            while not (kept / "progress.jsonl").exists():
                time.sleep(0.02)
            time.sleep(dice.uniform(0.0, 0.7))
            began = time.monotonic()
            os.kill(process, signal.SIGTERM)
            code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            slowest = max(slowest, time.monotonic() - began)
            run = registry.run(new[0].id)
            assert (code, run.status) in ((3, "interrupted"), (0, "finished")), (code, run.status)
            assert code == 0 or any((kept / "checkpoints").glob("*.json"))
    assert slowest <= 5.0, slowest
    return {"stops": count, "slowest_seconds": round(slowest, 2)}


def stopped_commands(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """^C, SIGTERM and a closed terminal while `train` learns: its exit code and a checkpoint soon (R4)."""
    dice, slowest = random.Random(seed), 0.0
    ways = ((os.killpg, signal.SIGINT, 130), (os.kill, signal.SIGTERM, 143), (os.killpg, signal.SIGHUP, 129))
    for stop in range(count):
        send, number, code = ways[stop % len(ways)]
        place = folder / str(stop)
        line = [sys.executable, "-m", "paddlectl", "train", "BlockedDoor", "--frames", "9999999"]
        process = subprocess.Popen(
            [*line, "--registry", str(place)],
            env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=_as_in_a_terminal,
        )
        while not (place / "runs" / "run-1" / "progress.jsonl").exists():
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(dice.uniform(0.0, 1.0))
        began = time.monotonic()
        send(process.pid, number)
        _, told = process.communicate(timeout=60)
        slowest = max(slowest, time.monotonic() - began)
        assert (process.returncode, told.splitlines()[-1]) == (code, "interrupted"), (stop, told)
        assert Registry(place).run("run-1").status == "interrupted"
        assert any((place / "runs" / "run-1" / "checkpoints").glob("*.json"))
        assert not check(place, read_data=True).findings
    assert slowest <= 5.0, slowest
    return {"stops": count, "slowest_seconds": round(slowest, 2)}


def _as_in_a_terminal() -> None:
    """What runs in the background, as the soak may, is made deaf to these, and so are its children."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
