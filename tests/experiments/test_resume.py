"""A run that is stopped and resumed ends bit for bit as one that never was."""

import json
import shutil
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from freeze import RECORDED
from paddlectl.errors import IntegrityError, NotFoundError, RegistryBusyError, UsageError
from paddlectl.experiments import sources
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.pace import Pace
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.sources import train_source
from paddlectl.learners import ppo
from paddlectl.registry.check import check
from paddlectl.registry.store import Registry
from trials.runs import (
    FRAMES,
    KINDS,
    ROUNDS,
    StopAfter,
    add_sources,
    begin,
    digest,
    ended,
    machine,
    quiet,
    small,
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    location = tmp_path_factory.mktemp("resume") / "registry"
    with small():
        add_sources(Registry.open(location))
        yield location


class Unbroken:
    """What each kind of run leaves that is never stopped; run once each."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._known: dict[str, dict[str, Any]] = {}

    def __getitem__(self, kind: str) -> dict[str, Any]:
        if kind not in self._known:
            self._known[kind] = ended(self._registry, begin(kind, self._registry, Pace())["run"])
        return self._known[kind]


@pytest.fixture(scope="module")
def unbroken(place: Path) -> Unbroken:
    return Unbroken(Registry.open(place))


@pytest.mark.parametrize("kind", KINDS)
def test_a_seeded_run_ends_as_it_did_when_it_was_recorded(unbroken: Unbroken, kind: str) -> None:
    """So that code can be moved; whoever changes learning itself records anew: `python freeze.py runs`."""
    recorded = json.loads(RECORDED.read_text())
    if recorded["machine"] != machine():
        pytest.skip(f"recorded on {recorded['machine']}, where the last bits may be others")
    assert digest(unbroken[kind]) == recorded[kind]


STOPS = [*((kind, 5) for kind in KINDS), ("paddle default", 1)]


@pytest.mark.parametrize(("kind", "rounds"), STOPS)
def test_stopped_every_few_rounds_it_ends_the_same(
    place: Path, unbroken: Unbroken, kind: str, rounds: int
) -> None:
    registry = Registry.open(place)
    stops = 0
    with pytest.raises(KeyboardInterrupt):
        begin(kind, registry, Pace(stop=StopAfter(rounds)))
    run = registry.runs()[0]
    while run.status != "finished":
        assert (run.status, run.policy) == ("interrupted", None)
        stops += 1
        with suppress(KeyboardInterrupt):
            resume(run.id, registry, quiet, Pace(stop=StopAfter(rounds)))
        run = registry.run(run.id)
    assert run.resumes == stops == ROUNDS // rounds
    assert ended(registry, run.id) == unbroken[kind]
    assert not list((place / "runs" / run.id / "checkpoints").glob("*"))
    assert check(place, read_data=True).findings == []


def stopped(registry: Registry, rounds: int = 3) -> str:
    with pytest.raises(KeyboardInterrupt):
        train_source(TrainJob("GapBall", 0, FRAMES), registry, quiet, Pace(0.0, StopAfter(rounds)))
    return registry.runs()[0].id


def test_what_was_written_after_the_last_checkpoint_is_cut_off(place: Path, unbroken: Unbroken) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    folder = place / "runs" / run
    for table in folder.glob("*.jsonl"):
        table.open("a").write('{"frames": 99, "seconds": 0.0}\n{"torn')
    (folder / "weights.jsonl").write_text('{"left": 1}\n')
    resume(run, registry, quiet, Pace())
    (folder / "weights.jsonl").unlink()
    assert ended(registry, run) == unbroken["train"]


def test_a_damaged_checkpoint_is_left_out_and_told(place: Path, unbroken: Unbroken) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    newest = max(
        (place / "runs" / run / "checkpoints").glob("*.safetensors"), key=lambda path: int(path.stem)
    )
    data = bytearray(newest.read_bytes())
    data[len(data) // 2] ^= 4
    newest.write_bytes(bytes(data))
    told: list[str] = []
    resume(run, registry, quiet, Pace(tell=told.append))
    assert len(told) == 1 and "an earlier checkpoint is used" in told[0] and newest.name in told[0]
    assert ended(registry, run) == unbroken["train"]


def test_no_whole_checkpoint(place: Path) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    for path in (place / "runs" / run / "checkpoints").glob("*.safetensors"):
        path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(IntegrityError, match="no checkpoint of") as caught:
        resume(run, registry, quiet, Pace())
    assert caught.value.exit_code == 5


def test_a_run_without_a_checkpoint_starts_again(place: Path, unbroken: Unbroken) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    shutil.rmtree(place / "runs" / run / "checkpoints")
    resume(run, registry, quiet, Pace())
    assert ended(registry, run) == unbroken["train"]


def test_state_that_isnt_this_versions_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    monkeypatch.setattr(ppo, "mlp", partial(ppo.mlp, hidden=(8,)))
    with pytest.raises(IntegrityError, match="doesn't fit this version"):
        resume(run, registry, quiet, Pace())


def test_a_run_goes_on_in_one_process_only(place: Path) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    with registry.hold(run), pytest.raises(RegistryBusyError, match="another process"):
        resume(run, registry, quiet, Pace())
    assert registry.run(run).status == "interrupted"


def test_what_isnt_resumed(place: Path) -> None:
    registry = Registry.open(place)
    with pytest.raises(UsageError, match="run-1 is finished"):
        resume("run-1", registry, quiet, Pace())
    with pytest.raises(NotFoundError):
        resume("run-99", registry, quiet, Pace())


def test_a_run_that_died_after_its_policy_was_kept_gets_no_second_one(
    place: Path, unbroken: Unbroken, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry = Registry.open(place)

    def dies(*_: Any) -> None:
        raise MemoryError

    with monkeypatch.context() as patch, pytest.raises(MemoryError):
        patch.setattr(sources, "_figures", dies)
        train_source(TrainJob("GapBall", 0, FRAMES), registry, quiet, Pace(0.0))
    run = registry.runs()[0]
    count = len(registry.policies())
    resume(run.id, registry, quiet, Pace())
    assert len(registry.policies()) == count
    assert registry.run(run.id).policy == run.policy
    assert ended(registry, run.id) == unbroken["train"]
