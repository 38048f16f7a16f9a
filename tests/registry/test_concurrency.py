import multiprocessing
import sqlite3
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import RegistryBusyError
from paddlectl.registry.care.check import check
from paddlectl.registry.index import database, sqlite
from paddlectl.registry.index.location import database_of
from paddlectl.registry.store import Registry
from released import rebuilt
from soak import memory_folder

PROCESSES, EACH, ROUNDS = 16, 50, 10
PLAIN = {"kind": "train", "method": "hdm", "task": "BoxDoor", "scenario": None, "sources": []}
BOTH = ("sqlite", "postgres")


Together = Callable[..., list[Any]]


def _wake(_: int) -> None:
    time.sleep(0.1)


@pytest.fixture(scope="module")
def together() -> Iterator[Together]:
    """Runs work in as many processes at once, all of them awake."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["paddlectl.registry.store", "alembic.command"])
    with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
        list(pool.map(_wake, range(PROCESSES)))
        yield lambda work, *given: list(pool.map(work, *given))


@pytest.fixture
def fast() -> Iterator[Path]:
    """A folder in memory: what is tested here is who waits for whom, not the disk."""
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        yield Path(folder)


@pytest.fixture(params=BOTH)
def address(request: pytest.FixtureRequest, fast: Path) -> str:
    """Where there is no registry yet."""
    files = fast / "registry"
    return request.getfixturevalue("postgres").new(files) if request.param == "postgres" else str(files)


def each(address: str) -> int:
    """Transactions of each process; a server has its own tests of that."""
    return EACH // 5 if "://" in address else EACH


def _write(location: str, worker: int) -> tuple[list[str], list[float]]:
    """Opens (all at once: makes) the registry and adds runs, finishing each with a read in between."""
    ids, waits = [], []
    with Registry.open(location) as registry:
        for number in range(each(location) // 2):
            began = time.monotonic()
            settings = {"worker": worker, "number": number}
            ids.append(registry.add_run(**PLAIN, seed=worker, settings=settings, versions={}).id)
            waits.append(time.monotonic() - began)
            found = registry.run(ids[-1])
            registry.finish_run(
                found.id,
                status="finished",
                frames=found.frames + 1,
                episodes=number,
                seconds=0.0,
                results={"worker": worker},
            )
    return ids, waits


def test_writers_that_start_by_making_the_registry_lose_nothing(address: str, together: Together) -> None:
    began = time.monotonic()
    told = together(_write, [address] * PROCESSES, list(range(PROCESSES)))
    took = time.monotonic() - began
    acknowledged = [(run, worker) for worker, (ids, _) in enumerate(told) for run in ids]
    assert len({run for run, _ in acknowledged}) == len(acknowledged) == PROCESSES * (each(address) // 2)
    runs = {run.id: run for run in Registry.open(address).runs()}
    assert len(runs) == len(acknowledged)
    for name, worker in acknowledged:
        assert (runs[name].seed, runs[name].settings["worker"]) == (worker, worker)
        assert (runs[name].status, runs[name].results) == ("finished", {"worker": worker})
    assert check(address, read_data=True).findings == []
    waits = sorted(wait for _, waited in told for wait in waited)
    assert waits[int(len(waits) * 0.99)] <= max(10.0, took / 2)  # on a busy machine all of it takes long


def _count(location: str, worker: int) -> None:
    with Registry.open(location, create=False) as registry:
        for _ in range(each(location)):
            with registry.index.writing() as connection:
                (frames,) = connection.exec_driver_sql("SELECT frames FROM runs WHERE id = 1").one()
                time.sleep(0.0005)
                connection.exec_driver_sql(f"UPDATE runs SET frames = {frames + 1} WHERE id = 1")


def test_no_update_is_lost_between_a_read_and_its_write(address: str, together: Together) -> None:
    registry = Registry.open(address)
    registry.add_run(**PLAIN, seed=0, settings={}, versions={})
    together(_count, [address] * PROCESSES, list(range(PROCESSES)))
    assert registry.run("run-1").frames == PROCESSES * each(address)


def _create(location: str) -> str:
    with Registry.open(location) as registry:
        return registry.add_run(**PLAIN, seed=0, settings={}, versions={}).id


@pytest.mark.parametrize("kind", BOTH)
def test_one_process_makes_the_registry_and_the_others_use_it(
    kind: str, fast: Path, together: Together, request: pytest.FixtureRequest
) -> None:
    places = [fast / str(number) for number in range(ROUNDS)]
    if kind == "postgres":
        postgres = request.getfixturevalue("postgres")
        rounds = [postgres.new(place) for place in places[:3]]
    else:
        rounds = [str(place) for place in places]
    ids = together(_create, [address for address in rounds for _ in range(PROCESSES)])
    for number in range(len(rounds)):
        found = ids[number * PROCESSES : (number + 1) * PROCESSES]
        assert sorted(found) == sorted(f"run-{n}" for n in range(1, PROCESSES + 1))


def test_a_folder_that_another_process_makes_meanwhile_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made_while_asked(path: Path) -> bool:
        path.mkdir()
        return True

    monkeypatch.setattr(Path, "exists", made_while_asked)
    assert database_of(tmp_path / "new").folder == tmp_path / "new"


def _seen(location: str) -> list[str]:
    with Registry.open(location, create=False) as registry:
        return [run.id for run in registry.runs()]


def test_one_process_upgrades_the_registry_and_the_others_wait(fast: Path, together: Together) -> None:
    places = [rebuilt("0001", fast / str(number)) for number in range(ROUNDS)]
    seen = together(_seen, [str(place) for place in places for _ in range(PROCESSES)])
    assert seen == [["run-4", "run-3", "run-2", "run-1"]] * PROCESSES * ROUNDS
    for place in places:
        assert len(list(place.glob("registry.db.0001.*"))) == 1
        assert not check(place, read_data=True).faults


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
