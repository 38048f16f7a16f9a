"""Everything that reads, beside runs that go on, imports, and `gc`: what is told is true, nothing is lost."""

import os
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from filler import ARRAYS, Filler
from paddlectl.cli.completion import policy_names, stopped_names, transfer_names
from paddlectl.cli.resume import stopped_runs
from paddlectl.errors import UsageError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from paddlectl.report.explanation import explanation_document
from paddlectl.report.programs import program_document
from trials.children import child

ROUNDS = 5
END: dict[str, Any] = {"frames": 10, "episodes": 2, "seconds": 1.5, "results": {"success_rate": 0.5}}
TRACE = {"early": [], "late": [], "score_early": 0.0}


def live_readers(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """So many readings of every kind while two runs, an import and `gc` do what they can."""
    place, dice = folder / "registry", random.Random(seed)
    with Registry.open(place) as registry:
        _run(Filler(registry), dice)  # so that there is something to read
        works = [partial(_runs, place, seed), partial(_runs, place, seed + 1)]
        works += [partial(_imports, place, folder / "elsewhere"), partial(_cleans, place)]
        waiting, going = os.pipe()
        others = [child(_while, waiting, going, work) for work in works]
        told = {read.__name__: 0 for read in READINGS}
        try:
            for number in range(count):
                read = READINGS[number % len(READINGS)]
                read(registry, dice, folder)
                told[read.__name__] += 1
        finally:
            os.close(going)
            ended = [os.waitpid(other, 0)[1] for other in others]
            os.close(waiting)
        assert not any(ended), ended
        collect(place, grace=0)
        assert not check(place, read_data=True).findings
        runs, policies = registry.runs(), registry.policies()
        for policy in policies:
            assert registry.read_checkpoint(policy)
    return {"readings": count, "runs": len(runs), "policies": len(policies), "lost": 0, "false_alarms": 0}


def _while(waiting: int, going: int, work: Callable[[], None]) -> None:
    """Works until the other end of the pipe is closed."""
    os.close(going)
    os.set_blocking(waiting, False)
    while True:
        try:
            os.read(waiting, 1)
            return
        except BlockingIOError:
            work()


def _runs(place: Path, seed: int) -> None:
    with Registry.open(place) as registry:
        _run(Filler(registry), random.Random(seed + len(registry.runs())))


def _run(add: Filler, dice: random.Random) -> None:
    """A run as a command does it, interrupted and resumed once or not."""
    registry, name = add.registry, add.run(kind="transfer", scenario="A, live").id
    with registry.files.hold(name):
        _rounds(registry, name)
        if dice.random() < 0.5:
            return _finished(add, name, dice)
        registry.finish_run(name, status="interrupted", **END)
    with registry.files.hold(name):
        registry.resume_run(name)
    with registry.files.hold(name):
        assert registry.files.rewind(name) is not None
        _rounds(registry, name)
        return _finished(add, name, dice)


def _rounds(registry: Registry, name: str) -> None:
    for number in range(ROUNDS):
        registry.files.append_rows(name, "episodes", [{"order": number, "score": 0.5}] * 20)
        registry.files.write_document(name, "trace", TRACE)
        registry.files.save_checkpoint(name, {"frames": number}, ARRAYS)


def _finished(add: Filler, name: str, dice: random.Random) -> None:
    add.policy(name, checkpoint=ARRAYS[:-8] + dice.randbytes(8))
    add.registry.finish_run(name, status="finished", **END)
    add.registry.files.drop_checkpoints(name)


def _imports(place: Path, elsewhere: Path) -> None:
    bundle = elsewhere.with_suffix(".zip")
    with Registry.open(elsewhere) as registry:
        add = Filler(registry)
        name = add.run().id
        registry.files.append_rows(name, "episodes", [{"order": 0}])
        _finished(add, name, random.Random(name))
        bundles.export(registry, name, bundle)
    bundles.import_(lambda: Registry.open(place), bundle)
    bundle.unlink()


def _cleans(place: Path) -> None:
    collect(place, grace=0)


# Readings


def checks(registry: Registry, dice: random.Random, folder: Path) -> None:
    report = check(registry.location, read_data=dice.random() < 0.5)
    assert not [found for found in report.findings if found.fault or found.kind == "stopped run"]


def repairs(registry: Registry, dice: random.Random, folder: Path) -> None:
    assert not repair(registry.location).done


def exports(registry: Registry, dice: random.Random, folder: Path) -> None:
    bundle = folder / "x.zip"
    name = dice.choice([registry.runs()[0].id, registry.policies()[0].id, "BoxDoor"])
    try:
        bundles.export(registry, name, bundle)
        assert bundles.import_(lambda: registry, bundle)["known"]
        bundle.unlink()
    except UsageError as error:
        assert "goes on" in error.message


def explains(registry: Registry, dice: random.Random, folder: Path) -> None:
    newest = registry.newest_transfer()
    assert newest is not None
    explanation_document(registry, newest)
    assert len(registry.files.read_rows(newest.id, "episodes")) % 20 == 0


def shows(registry: Registry, dice: random.Random, folder: Path) -> None:
    assert program_document(registry.policy("BoxDoor"))
    assert registry.read_checkpoint(registry.policies()[0])


def lists(registry: Registry, dice: random.Random, folder: Path) -> None:
    assert registry.newest_runs(50)[1] >= registry.newest_policies(50)[1] > 0
    assert transfer_names(registry.location)[1:] and policy_names(registry.location)
    stopped_names(registry.location)
    assert not [run for run in stopped_runs(registry) if run.status == "running"]


READINGS = [checks, repairs, exports, explains, shows, lists, explains, exports]
