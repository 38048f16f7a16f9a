"""A run that is stopped and resumed ends bit for bit as one that never was."""

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from freeze import RECORDED
from paddlectl.agents.base import Episode
from paddlectl.agents.interaction import Learning, Round
from paddlectl.errors import IntegrityError, NotFoundError, PaddlectlError, RegistryBusyError, UsageError
from paddlectl.experiments import runner, snapshot
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.curves import LearningCurve
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.log import ended_episodes, recorded
from paddlectl.experiments.recordings import played_again
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import train_source
from paddlectl.experiments.stop import Stop
from paddlectl.hybrid.agent import HybridAgent
from paddlectl.hybrid.rollout import Outcome
from paddlectl.hybrid.settings import settings_for
from paddlectl.learners import ppo
from paddlectl.methods import hdm
from paddlectl.methods.base import Setup
from paddlectl.registry.care.check import check
from paddlectl.registry.files.runfiles import RunFiles
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load
from small_transfer import SMALL
from trials.runs import (
    FRAMES,
    KINDS,
    ROUNDS,
    SEEDED,
    StopAfter,
    add_sources,
    begin,
    digest,
    ended,
    machine,
    quiet,
    short_episodes,
    small,
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    location = tmp_path_factory.mktemp("resume") / "registry"
    with small():
        add_sources(Registry.open(location))
        yield location


@contextmanager
def small_enough(kind: str) -> Iterator[int]:
    """Gives how many rounds a run has: fewer, with shorter episodes, where its end isn't recorded."""
    if kind in SEEDED:
        yield ROUNDS
    else:
        with short_episodes():  # of two rounds each
            yield 5


class Unbroken:
    """What each kind of run leaves that is never stopped; run once each."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._known: dict[str, dict[str, Any]] = {}

    def __getitem__(self, kind: str) -> dict[str, Any]:
        if kind not in self._known:
            with small_enough(kind) as rounds:
                row = begin(kind, self._registry, Checkpointer(), rounds)
            self._known[kind] = ended(self._registry, row["run"])
        return self._known[kind]


@pytest.fixture(scope="module")
def unbroken(place: Path) -> Unbroken:
    return Unbroken(Registry.open(place))


@pytest.mark.parametrize("kind", SEEDED)
def test_a_seeded_run_ends_as_it_did_when_it_was_recorded(unbroken: Unbroken, kind: str) -> None:
    """So that code can be moved; whoever changes learning itself records anew: `python freeze.py runs`."""
    recorded = json.loads(RECORDED.read_text())
    if recorded["machine"] != machine():
        pytest.skip(f"recorded on {recorded['machine']}, where the last bits may be others")
    assert digest(unbroken[kind]) == recorded[kind]


STOPS = {kind: 5 if kind in SEEDED else 2 for kind in KINDS} | {"paddle default": 2, "cup": 1}


@pytest.mark.parametrize(("kind", "every"), STOPS.items())
def test_stopped_every_few_rounds_it_ends_the_same(
    place: Path, unbroken: Unbroken, kind: str, every: int
) -> None:
    registry = Registry.open(place)
    stops = 0
    with small_enough(kind) as rounds:
        with pytest.raises(KeyboardInterrupt):
            begin(kind, registry, Checkpointer(stop=StopAfter(every)), rounds)
        run = registry.runs()[0]
        while run.status != "finished":
            assert (run.status, run.policy) == ("interrupted", None)
            stops += 1
            with suppress(KeyboardInterrupt):
                resume(run.id, registry, quiet, Checkpointer(stop=StopAfter(every)))
            run = registry.run(run.id)
    assert run.resumes == stops == rounds // every
    assert ended(registry, run.id) == unbroken[kind]
    assert not list((place / "runs" / run.id / "checkpoints").glob("*"))
    assert check(place, read_data=True).findings == []


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_recorded_is_played_again(unbroken: Unbroken, kind: str) -> None:
    run = unbroken[kind]
    (told,), rows = run["files"]["recordings.json"], run["files"]["episodes.jsonl"]
    ends = {(row["order"], row["frames"], row["score"], row["length"]) for row in rows}
    assert told
    with small_enough(kind):
        for each in told.values():
            assert (each["order"], each["frames"], each["score"], each["length"]) in ends
            *_, end = played_again(run["run"]["task"], each, {each["length"]})
            assert end.t == each["length"] and end.picture is not None
    (trace,) = run["files"].get("trace.json", [{}])
    for phase in told.keys() & trace.keys():
        assert sum(decision["steps"] for decision in trace[phase]) == told[phase]["length"]
        subgoals = [each["subgoal"] for each in told[phase]["subgoals"] for _ in range(each["actions"])]
        assert subgoals == [decision["head"] for decision in trace[phase] for _ in range(decision["steps"])]
    assert trace.keys() - {"score_early", "score_late"} in (set(), told.keys())


def stopped(registry: Registry, rounds: int = 3) -> str:
    with pytest.raises(KeyboardInterrupt):
        train_source(
            TrainJob("GapBall", 0, FRAMES, SMALL), registry, quiet, Checkpointer(0.0, StopAfter(rounds))
        )
    return registry.runs()[0].id


def test_what_was_written_after_the_last_checkpoint_is_cut_off(place: Path, unbroken: Unbroken) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    folder = place / "runs" / run
    for table in folder.glob("*.jsonl"):
        table.open("a").write('{"frames": 99, "seconds": 0.0}\n{"torn')
    (folder / "weights.jsonl").write_text('{"left": 1}\n')
    resume(run, registry, quiet, Checkpointer())
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
    resume(run, registry, quiet, Checkpointer(tell=told.append))
    assert len(told) == 1 and "an earlier checkpoint is used" in told[0] and newest.name in told[0]
    assert ended(registry, run) == unbroken["train"]


def test_no_whole_checkpoint(place: Path) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    for path in (place / "runs" / run / "checkpoints").glob("*.safetensors"):
        path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(IntegrityError, match="no checkpoint of") as caught:
        resume(run, registry, quiet, Checkpointer())
    assert caught.value.exit_code == 5


def test_a_run_without_a_checkpoint_starts_again(place: Path, unbroken: Unbroken) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    shutil.rmtree(place / "runs" / run / "checkpoints")
    resume(run, registry, quiet, Checkpointer())
    assert ended(registry, run) == unbroken["train"]


def test_state_that_isnt_this_versions_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    usual = ppo.mlp
    monkeypatch.setattr(ppo, "mlp", lambda *sizes, **_: usual(*sizes, hidden=(8,)))
    with pytest.raises(IntegrityError, match="doesn't fit this version"):
        resume(run, registry, quiet, Checkpointer())


@pytest.mark.parametrize("change", [{"horizon": 321}, {"summary": "another"}])
def test_a_run_that_this_version_would_begin_otherwise_is_refused(
    place: Path, change: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    monkeypatch.setattr(runner, "load", lambda name: replace(load(name), **change))
    with pytest.raises(IntegrityError, match="doesn't fit this version"):
        resume(run, registry, quiet, Checkpointer())


# What isn't of the project


class Outsider:
    """A listener that can tell what it knows."""

    def __init__(self) -> None:
        self._told: list[int] = []

    def on_decision_end(self, outcome: Outcome) -> None:
        self._told.append(int(outcome.steps.sum()))

    def snapshot(self) -> list[int]:
        return self._told

    def restore(self, told: list[int]) -> None:
        self._told = told


class Mute:
    """A listener that can't."""

    def on_decision_end(self, outcome: Outcome) -> None:
        pass


def with_listener(listener: Any, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(hdm, "HybridAgent", partial(HybridAgent, listeners=[listener]))


def test_any_class_that_can_tell_its_state_goes_on_with_the_run(place: Path) -> None:
    registry = Registry.open(place)
    told = []
    for stop in (Stop(), StopAfter(3)):
        with pytest.MonkeyPatch.context() as patch, suppress(KeyboardInterrupt):
            with_listener(listener := Outsider(), patch)
            train_source(TrainJob("GapBall", 0, FRAMES, SMALL), registry, quiet, Checkpointer(stop=stop))
        told.append(listener.snapshot())
    assert 0 < len(told[1]) < len(told[0])
    with pytest.MonkeyPatch.context() as patch:
        with_listener(listener := Outsider(), patch)
        resume(registry.runs()[0].id, registry, quiet, Checkpointer())
    assert listener.snapshot() == told[0]


def test_what_cant_be_captured_is_told_before_anything_is_learned(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry = Registry.open(place)
    with_listener(Mute(), monkeypatch)
    with pytest.raises(PaddlectlError) as caught:
        train_source(TrainJob("GapBall", 0, FRAMES, SMALL), registry, quiet)
    assert str(caught.value) == (
        f"learning.agent.rollout._listeners[0]: a Mute of module {__name__} can't be captured: "
        "give it snapshot() and restore()"
    )
    run = registry.runs()[0]
    assert (run.status, run.frames, registry.files.read_rows(run.id, "progress")) == ("failed", 0, [])


# However long it is


class Kept(NamedTuple):
    bytes: int
    seconds: float


@contextmanager
def kept() -> Iterator[list[Kept]]:
    """What each checkpoint took."""
    found: list[Kept] = []
    capture, save = snapshot.capture, RunFiles.save_checkpoint
    began = 0.0

    def capturing(roots: dict[str, Any]) -> tuple[Any, bytes]:
        nonlocal began
        began = time.process_time()
        return capture(roots)

    def saving(files: RunFiles, run: str, document: Any, arrays: bytes) -> None:
        save(files, run, document, arrays)
        found.append(Kept(len(json.dumps(document)) + len(arrays), time.process_time() - began))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(snapshot, "capture", capturing)
        patch.setattr(RunFiles, "save_checkpoint", saving)
        yield found


LANES = 8


def made_up(count: int) -> Iterator[Round]:
    """Rounds of so many episodes, of lanes that are not in step."""
    ended: list[Episode] = []
    for order in range(count):
        place = order ^ 1  # the second of two ends first
        scenes = tuple({number * order % 7 for number in range(30)})
        ended.append(Episode(place, 20 * place, 20 * order + 40, place % 3 / 2, 20, scenes))
        if len(ended) == LANES:
            yield Round(20 * order + 40, ended, {})
            ended = []


def entered(registry: Registry) -> RunRecord:
    """A run that does nothing by itself."""
    return registry.add_run(
        kind="train",
        method="hdm",
        task="GapBall",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )


def after(count: int, place: Path) -> Kept:
    """What a checkpoint takes after so many episodes, at best."""
    registry = Registry.open(place)
    task = load("GapBall")
    agent = hdm.make(Setup(task, settings_for(task, SMALL), 0, FRAMES))
    learning = Learning(task.make(LANES, 0), agent, FRAMES)
    run = entered(registry)
    checkpointer = Checkpointer(3600.0)
    with recorded(registry, run) as log, kept() as found:
        with checkpointer.rounds(registry, log, {"learning": learning}) as after_round:
            for round_ in made_up(count):
                for episode in round_.episodes:
                    agent._recent.add(episode.scenes)
                log.add(round_)
                log.write(round_)
                after_round()
            checkpointer.stop.asked = True
            for _ in range(8):
                with suppress(KeyboardInterrupt):
                    after_round()
        assert (log.curve.ended, log.curve.known) == (count, count)
        assert LearningCurve(ended_episodes(registry, run.id), log.frames).figures()["jump_start"] > 0.3
    return Kept(found[-1].bytes, min(each.seconds for each in found))


def test_a_checkpoint_after_many_episodes_is_as_small_and_quick_as_after_few(tmp_path: Path) -> None:
    for _ in range(3):  # what else the machine does can only make one slower
        few, many = after(200, tmp_path), after(20_000, tmp_path)
        assert many.bytes < 1.01 * few.bytes
        if many.seconds < 1.2 * few.seconds:
            return
    raise AssertionError(f"{many.seconds:.3f} s after many episodes, {few.seconds:.3f} s after few")


def test_the_checkpoints_of_a_run_are_of_one_size(place: Path) -> None:
    registry = Registry.open(place)
    for kind in ("train", "paddle default"):
        with kept() as found:
            begin(kind, registry, Checkpointer(0.0), rounds=5)
        sizes = [each.bytes for each in found]
        assert len(sizes) == 5 and max(sizes) < 1.02 * min(sizes)


def test_a_checkpoint_reads_of_the_tables_only_what_is_new(tmp_path: Path) -> None:
    registry = Registry.open(tmp_path)
    run = entered(registry).id
    table = registry.folder / "runs" / run / "episodes.jsonl"
    for number in range(3):
        registry.files.append_rows(run, "episodes", [{"order": number}])
        registry.files.save_checkpoint(run, number, b"")
    text = table.read_bytes()
    table.write_bytes(text.replace(b"0", b"7"))  # damage since then isn't sealed
    registry.files.append_rows(run, "episodes", [{"order": 3}])
    registry.files.save_checkpoint(run, 3, b"")
    with pytest.raises(IntegrityError, match="isn't what was stored"):
        registry.files.rewind(run)
    table.write_bytes(text + b'{"order": 3}\n{"order": 9}\n')
    assert registry.files.rewind(run).document == 3
    registry.files.append_rows(run, "episodes", [{"order": 4}])
    registry.files.save_checkpoint(run, 4, b"")
    with Registry.open(tmp_path) as elsewhere:
        assert elsewhere.files.rewind(run).document == 4
    assert [row["order"] for row in registry.files.each_row(run, "episodes")] == [0, 1, 2, 3, 4]


def test_a_run_goes_on_in_one_process_only(place: Path) -> None:
    registry = Registry.open(place)
    run = stopped(registry)
    with registry.files.hold(run), pytest.raises(RegistryBusyError, match="another process"):
        resume(run, registry, quiet, Checkpointer())
    assert registry.run(run).status == "interrupted"


def test_what_isnt_resumed(place: Path) -> None:
    registry = Registry.open(place)
    with pytest.raises(UsageError, match="run-1 is finished"):
        resume("run-1", registry, quiet, Checkpointer())
    with pytest.raises(NotFoundError):
        resume("run-99", registry, quiet, Checkpointer())


def test_a_run_that_died_after_its_policy_was_kept_gets_no_second_one(
    place: Path, unbroken: Unbroken, monkeypatch: pytest.MonkeyPatch
) -> None:
    registry = Registry.open(place)

    def dies(*_: Any) -> None:
        raise MemoryError

    with monkeypatch.context() as patch, pytest.raises(MemoryError):
        patch.setattr(runner, "figures_of", dies)
        train_source(TrainJob("GapBall", 0, FRAMES, SMALL), registry, quiet, Checkpointer(0.0))
    run = registry.runs()[0]
    count = len(registry.policies())
    resume(run.id, registry, quiet, Checkpointer())
    assert len(registry.policies()) == count
    assert registry.run(run.id).policy == run.policy
    assert ended(registry, run.id) == unbroken["train"]


def test_a_resumption_that_cannot_begin_leaves_the_run_as_it_was(tmp_path: Path) -> None:
    registry = Registry.open(tmp_path / "registry")
    with small(), pytest.raises(KeyboardInterrupt):
        begin("train", registry, Checkpointer(stop=StopAfter(3)))
    before = registry.run("run-1")
    for arrays in (registry.folder / "runs" / "run-1" / "checkpoints").glob("*.safetensors"):
        arrays.rename(arrays.with_suffix(".away"))
    with small(), pytest.raises(IntegrityError):
        resume("run-1", registry, quiet, Checkpointer())
    after = registry.run("run-1")
    assert (after.status, after.frames, after.episodes) == ("interrupted", before.frames, before.episodes)
    assert before.frames > 0
    assert [run.id for run in registry.stopped_runs()] == ["run-1"]
    for arrays in (registry.folder / "runs" / "run-1" / "checkpoints").glob("*.away"):
        arrays.rename(arrays.with_suffix(".safetensors"))
    with small():
        resume("run-1", registry, quiet, Checkpointer())
    assert registry.run("run-1").status == "finished"
