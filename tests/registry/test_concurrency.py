import multiprocessing
import sqlite3
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import RegistryBusyError
from paddlectl.registry import database, sqlite
from paddlectl.registry.store import Registry

PROCESSES, EACH, ROUNDS = 8, 25, 3
PLAIN = {"kind": "train", "method": "hdm", "task": "BoxDoor", "scenario": None, "sources": []}


Together = Callable[..., list[Any]]


def _wake(_: int) -> None:
    time.sleep(0.1)


@pytest.fixture(scope="module")
def together() -> Iterator[Together]:
    """Runs work in as many processes at once, all of them awake."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
        list(pool.map(_wake, range(PROCESSES)))
        yield lambda work, *given: list(pool.map(work, *given))


def _write(location: str, worker: int) -> list[str]:
    """Opens (all at once: makes) the registry and adds runs, finishing each with a read in between."""
    ids = []
    with Registry.open(location) as registry:
        for number in range(EACH):
            if number % 2:
                settings = {"worker": worker, "number": number}
                ids.append(registry.add_run(**PLAIN, seed=worker, settings=settings, versions={}).id)
            else:
                last = ids[-1] if ids else registry.add_run(**PLAIN, seed=worker, settings={}, versions={}).id
                found = registry.run(last)
                registry.finish_run(
                    last,
                    status="finished",
                    frames=found.frames + 1,
                    episodes=number,
                    seconds=0.0,
                    results={"worker": worker},
                )
    return ids


def test_writers_that_start_by_making_the_registry_lose_nothing(location: Path, together: Together) -> None:
    told = together(_write, [str(location)] * PROCESSES, list(range(PROCESSES)))
    acknowledged = {run: worker for worker, ids in enumerate(told) for run in ids}
    assert len(acknowledged) == PROCESSES * (EACH // 2)
    runs = {run.id: run for run in Registry.open(location).runs()}
    assert set(acknowledged) <= set(runs)
    assert len(runs) == PROCESSES * (EACH // 2 + 1)
    for name, worker in acknowledged.items():
        assert (runs[name].seed, runs[name].settings["worker"]) == (worker, worker)
        assert (runs[name].status, runs[name].results) == ("finished", {"worker": worker})
    connection = sqlite3.connect(location / "registry.db")
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    connection.close()


def _count(location: str, worker: int) -> None:
    with Registry.open(location, create=False) as registry:
        for _ in range(EACH):
            with registry._transaction(registry._writing) as connection:
                (frames,) = connection.exec_driver_sql("SELECT frames FROM runs WHERE id = 1").one()
                time.sleep(0.001)
                connection.exec_driver_sql("UPDATE runs SET frames = ? WHERE id = 1", (frames + 1,))


def test_no_update_is_lost_between_a_read_and_its_write(
    registry: Registry, add: Any, together: Together
) -> None:
    add.run()
    together(_count, [registry.location] * PROCESSES, list(range(PROCESSES)))
    assert registry.run("run-1").frames == PROCESSES * EACH


def _create(location: str) -> str:
    with Registry.open(location) as registry:
        return registry.add_run(**PLAIN, seed=0, settings={}, versions={}).id


def test_one_process_makes_the_registry_and_the_others_use_it(tmp_path: Path, together: Together) -> None:
    rounds = [str(tmp_path / str(number)) for number in range(ROUNDS) for _ in range(PROCESSES)]
    ids = together(_create, rounds)
    for number in range(ROUNDS):
        found = ids[number * PROCESSES : (number + 1) * PROCESSES]
        assert sorted(found) == [f"run-{n}" for n in range(1, PROCESSES + 1)]


@contextmanager
def _held(path: Path, how: str) -> Iterator[None]:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute(how)
    try:
        yield
    finally:
        connection.close()


@pytest.mark.parametrize(("how", "reads"), [("BEGIN IMMEDIATE", True), ("BEGIN EXCLUSIVE", False)])
def test_a_registry_held_for_too_long(
    registry: Registry, add: Any, location: Path, monkeypatch: pytest.MonkeyPatch, how: str, reads: bool
) -> None:
    run = add.run()
    monkeypatch.setattr(database, "WAIT", 0.1)
    with _held(location / "registry.db", how):
        with pytest.raises(RegistryBusyError, match="held by another process") as caught:
            add.run()
        assert caught.value.exit_code == 6
        if reads:
            assert Registry.open(location).runs() == [run]
        else:
            with pytest.raises(RegistryBusyError):
                Registry.open(location)
    assert add.run().id == "run-2"


def test_making_a_registry_that_another_process_is_making(
    location: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database, "WAIT", 0.1)
    location.mkdir()
    with sqlite._locked(location), pytest.raises(RegistryBusyError):
        Registry.open(location)
    assert Registry.open(location).runs() == []
