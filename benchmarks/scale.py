"""How long commands and calls take as a registry grows: as many runs as policies.

python benchmarks/scale.py [--sizes 1000 10000 100000]

The rows are written with their manifests, objects and folders, as the registry's interface writes them, but
many in one transaction, and without waiting for the disk. Programs are of 5 to 15 clauses, drawn from those
that the vocabularies of MiniGrid's tasks allow. Of each command, as a whole process: wall and CPU seconds,
the least of some calls, and its memory. The result goes into benchmarks/scale.json.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from subprocess import PIPE
from typing import Any

import numpy as np
import safetensors.numpy
from sqlalchemy import Connection, select
from start_up import command

from paddlectl.experiments.log import versions
from paddlectl.logic.clauses import Clause, Program
from paddlectl.logic.syntax import format_program
from paddlectl.logic.templates import all_clauses
from paddlectl.registry.files import layout, objects
from paddlectl.registry.index.entry import enter, publish
from paddlectl.registry.schema import ROW_TABLES
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load

HERE = Path(__file__).parent
TARGET = "BlockedBoxUnlockPickup"
TASKS = ("BlockedDoor", "GapBall", "BoxDoor", "DoorBall", "OpenGoal")
_MEASURE = """
import json, os, resource, subprocess, sys, time
began = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
wall, used = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps({"wall": wall, "cpu": used.ru_utime + used.ru_stime, "megabytes": used.ru_maxrss / 1024}))
sys.exit(code)
"""
"""A small process: of a large one's child the system tells the memory of its parent."""

SLOW = 10.0  # seconds
AT_ONCE = 500  # runs of a transaction
WRITERS, WRITTEN = 16, 10
REAL = ("train BlockedDoor GapBall --frames 2048", "transfer A --frames 4096")
ASKED = (
    "--version",
    "runs --limit 20",
    "runs --task GapBall --status finished",
    "policies",
    "show run-3",
    "show policy-1",
    "explain run-3",
    f"similarity --target {TARGET}",
    f"similarity --target {TARGET} --top 10",
    "registry gc --json",
    "registry check",
)
COMPLETED = ("show", "similarity --source")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1_000, 10_000, 100_000])
    parser.add_argument("--calls", type=int, default=3)
    parser.add_argument("--folder", help="where the registry is made, and removed again")
    options = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        place = Path(folder) / "registry"
        os.environ["PADDLECTL_REGISTRY"] = str(place)
        for line in REAL:
            measured(command(line))
        there = len(REAL) + 1
        for size in options.sizes:
            began = time.perf_counter()
            fill(place, there, size)
            there = size
            print(f"{size:,} runs and policies, filled in {time.perf_counter() - began:.0f} s", flush=True)
            for name, row in rows_at(place, options.calls):
                rows.setdefault(name, {})[str(size)] = row
                print(f"  {name:<50} {json.dumps(row)}", flush=True)
    from learning import commit, machine  # not above: every writer imports this file

    told = {"sizes": options.sizes, "calls": options.calls, "rows": rows, "commit": commit()}
    told |= {"machine": machine(), "versions": versions()}
    (HERE / "scale.json").write_text(json.dumps(told, indent=1) + "\n")


def rows_at(place: Path, calls: int) -> Iterator[tuple[str, dict[str, float]]]:
    """What is measured of a registry as it is."""
    for line in ASKED:
        yield line, best(lambda line=line: measured(command(line)), calls)  # type: ignore[misc]
    for words in COMPLETED:
        yield f"completion after {words}", best(lambda words=words: completed(words), calls)  # type: ignore[misc]
    yield "opening", best(lambda: timed(lambda: Registry.open(place).close()), calls)
    seeds = count(900_000)
    with Registry.open(place) as registry:
        yield (
            "adding a run and its policy",
            best(lambda: timed(lambda: add(registry, next(seeds))), 5 * calls),
        )
    yield f"{WRITERS} writers, {WRITTEN} runs each", best(lambda: timed(lambda: all_write(place)), 1)
    yield "the index", {"megabytes": round((place / "registry.db").stat().st_size / 1e6, 1)}


def fill(place: Path, there: int, size: int) -> None:
    """Adds finished runs, each with its policy, until there are so many of both."""
    dice, synced = random.Random(there), os.fsync
    pool = {task: clauses(task) for task in TASKS}
    os.fsync = lambda file: None
    with Registry.open(place) as registry:
        for first in range(there, size, AT_ONCE):
            with registry.index.writing() as connection:
                like = {kind: row_like(connection, kind) for kind in ROW_TABLES}
                for seed in range(first, min(first + AT_ONCE, size)):
                    both = {"task": dice.choice(TASKS), "seed": seed}
                    run = enter(registry.index.database, connection, "run", like["run"] | both)
                    layout.make_run(place, f"run-{run}")
                    own = {
                        "run": run,
                        "program": drawn(pool[both["task"]], dice),
                        "checkpoint": objects.publish(place / "objects", weights(seed)),
                        "success_rate": dice.random(),
                    }
                    policy = enter(registry.index.database, connection, "policy", like["policy"] | both | own)
                    publish(place, connection, f"run-{run}")
                    publish(place, connection, f"policy-{policy}")
    os.fsync = synced


def row_like(connection: Connection, kind: str) -> dict[str, Any]:
    """The values of the first run or policy, without its number."""
    table = ROW_TABLES[kind]
    row = connection.execute(select(table).where(table.c.id == 1)).one()
    return {name: value for name, value in row._mapping.items() if name != "id"}


def clauses(task: str) -> Sequence[Clause]:
    """All that its vocabulary allows."""
    made = load(task)
    return all_clauses(made.vocabulary.atoms, made.vocabulary.exclusions, made.subgoals)


def drawn(pool: Sequence[Clause], dice: random.Random) -> str:
    """A program of 5 to 15 clauses."""
    kept = dice.sample(pool, dice.randint(5, 15))
    return format_program(Program(tuple(kept), tuple(dice.random() for _ in kept)))


def weights(number: int) -> bytes:
    """A small checkpoint like no other."""
    return safetensors.numpy.save({"x": np.full(8, number, np.float64)})


def add(registry: Registry, seed: int) -> None:
    """A run and its policy, by the registry's interface."""
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="BoxDoor",
        scenario=None,
        sources=[],
        seed=seed,
        settings={},
        versions={},
    )
    registry.add_policy(
        run=run.id,
        task="BoxDoor",
        domain="minigrid",
        method="hdm",
        seed=seed,
        frames=2048,
        program="0.9 :: gt_key() :- has_key(env)",
        checkpoint=weights(-seed),
        metadata={},
        success_rate=0.5,
        mean_score=0.5,
        mean_length=30.0,
        crispness=0.9,
    )
    registry.finish_run(run.id, status="finished", frames=2048, episodes=50, seconds=1.0, results={})


def writes(place: Path, writer: int) -> None:
    """What one of several writers does."""
    with Registry.open(place) as registry:
        for number in range(WRITTEN):
            add(registry, 1_000_000 + 100 * writer + number)


def all_write(place: Path) -> None:
    """Several processes add runs at once."""
    with ProcessPoolExecutor(WRITERS, get_context("spawn")) as pool:
        list(pool.map(partial(writes, place), range(WRITERS)))


def measured(line: Sequence[str], **more: str) -> dict[str, float]:
    """Seconds and megabytes of a process.

    Raises:
        RuntimeError: If it fails.
    """
    told = subprocess.run(
        [sys.executable, "-S", "-c", _MEASURE, *line], cwd=HERE.parent, env=os.environ | more, stdout=PIPE
    )
    if told.returncode:
        raise RuntimeError(f"{line} ended with {told.returncode}")
    return {name: float(value) for name, value in json.loads(told.stdout).items()}


def completed(words: str) -> dict[str, float]:
    """What a shell asks for at a press of the tabulator."""
    given = {"_PADDLECTL_COMPLETE": "complete_bash", "COMP_WORDS": f"paddlectl {words} ", "COMP_CWORD": "9"}
    given["COMP_CWORD"] = str(len(words.split()) + 1)
    return measured(command(""), **given)


def timed(call: Callable[[], Any]) -> dict[str, float]:
    """Seconds of a call in this process."""
    began, before = time.perf_counter(), time.process_time()
    call()
    return {"wall": time.perf_counter() - began, "cpu": time.process_time() - before}


def best(measure: Callable[[], dict[str, float]], calls: int) -> dict[str, float]:
    """The least of several measurements, each by itself; what takes long is measured once."""
    found = [measure()]
    found += [measure() for _ in range(calls - 1) if found[0]["wall"] < SLOW]
    return {name: round(min(each[name] for each in found), 4) for name in found[0]}


if __name__ == "__main__":
    main()
