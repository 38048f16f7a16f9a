"""Many processes on one registry at once: writers and readers (R5), makers and upgraders (R6)."""

import json
import os
import signal
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import select, update

from paddlectl.registry.care.check import check
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from released import rebuilt
from trials.children import child
from trials.killed_writers import END, PLAIN

WRITERS, READERS, MAKERS = 64, 4, 16


def together(works: Sequence[Callable[[], Any]], folder: Path) -> list[Any]:
    """What each work gives, done in a process of its own; all of them are let go at the same moment.

    When one fails the others are killed, since they may wait for what it would have done.
    """
    waiting, going = os.pipe()
    processes = [child(_after, waiting, going, work, folder / str(n)) for n, work in enumerate(works)]
    os.close(waiting)
    os.close(going)
    left, failed = set(processes), False
    while left:
        process, code = os.wait()
        left.remove(process)
        if code and not failed:
            failed = True
            for other in left:
                os.kill(other, signal.SIGKILL)
    assert not failed, "a process failed; it said why"
    return [json.loads((folder / str(number)).read_text()) for number in range(len(works))]


def _after(waiting: int, going: int, work: Callable[[], Any], answer: Path) -> None:
    os.close(going)
    os.read(waiting, 1)  # ends when the last process that could let go has closed it
    answer.write_text(json.dumps(work()))


def writers_at_once(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """64 writers with so many transactions each make a registry and write to it while others read.

    Then each raises one number as often, reading it first.
    """
    place = folder / "registry"
    works = [partial(_write, place, worker, count // 2) for worker in range(WRITERS)]
    told = together([*works, *[partial(_read, place, WRITERS * (count // 2))] * READERS], folder)
    ids = [run for answer in told[:WRITERS] for run, _ in answer]
    found = {run.id: run for run in Registry.open(place).runs()}
    assert len(found) == len(ids) == WRITERS * (count // 2)
    for worker, answer in enumerate(told[:WRITERS]):
        for run, _ in answer:
            assert (found[run].seed, found[run].status, found[run].results) == (worker, "finished", {})
    assert not check(place, read_data=True).findings
    counted = Registry.open(folder / "counted")
    counted.add_run(**PLAIN, seed=0, settings={}, versions={})
    together([partial(_count, folder / "counted", count)] * WRITERS, folder)
    assert counted.run("run-1").frames == WRITERS * count
    waits = sorted(wait for answer in told[:WRITERS] for _, wait in answer)
    slow = waits[int(len(waits) * 0.99)]
    assert slow <= 20.0, slow
    return {
        "writers": WRITERS,
        "transactions": WRITERS * count,
        "increments": WRITERS * count,
        "readings": sum(told[WRITERS:]),
        "seconds_waited_p99": round(slow, 2),
        "lost": 0,
        "ids_given_twice": len(ids) - len(set(ids)),
    }


def _write(place: Path, worker: int, count: int) -> list[tuple[str, float]]:
    registry, told = Registry.open(place), []
    for _ in range(count):
        began = time.monotonic()
        run = registry.add_run(**PLAIN, seed=worker, settings={}, versions={}).id
        told.append((run, time.monotonic() - began))
        registry.finish_run(run, **END, frames=worker)
    return told


def _read(place: Path, enough: int) -> int:
    """Reads until all is written; what was there once stays there."""
    registry, readings, before = Registry.open(place), 0, 0
    while before < enough or any(run.status == "running" for run in registry.runs()):
        now = len(registry.runs())
        assert now >= before
        readings, before = readings + 1, now
        time.sleep(0.05)
    return readings


def _count(place: Path, count: int) -> None:
    registry = Registry.open(place)
    for _ in range(count):
        with registry.index.writing() as connection:
            frames = connection.scalar(select(runs.c.frames).where(runs.c.id == 1))
            connection.execute(update(runs).where(runs.c.id == 1).values(frames=frames + 1))


def makers_at_once(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """16 processes find no registry, or one of the first schema, at the same moment; so many rounds."""
    from alembic import command  # noqa: F401 - else every process loads it first

    made = upgraded = 0
    for number in range(count):
        place = folder / f"registry-{number}"
        if number % 2:
            rebuilt("0001", place)
        ids = together([partial(_make, place)] * MAKERS, folder)
        first = 5 if number % 2 else 1  # the first schema's fixture has four runs
        assert sorted(ids) == sorted(f"run-{first + n}" for n in range(MAKERS)), ids
        assert len(list(place.glob("registry.db.0001.*"))) == number % 2  # its copy, made by one of them
        assert not check(place, read_data=True).faults
        made, upgraded = made + (number + 1) % 2, upgraded + number % 2
    return {"processes": MAKERS, "made": made, "upgraded": upgraded, "lost": 0}


def _make(place: Path) -> str:
    with Registry.open(place) as registry:
        return registry.add_run(**PLAIN, seed=0, settings={}, versions={}).id
