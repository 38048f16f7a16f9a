"""Reading beside runs that go on: whenever others write, nothing is called a fault that is none."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from filler import ARRAYS, Filler
from paddlectl.errors import IntegrityError, UsageError
from paddlectl.registry import store
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care import check as checking
from paddlectl.registry.care import files, garbage
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import layout, manifests, objects, runfiles
from paddlectl.registry.index import database
from paddlectl.registry.store import Registry

END: dict[str, Any] = {"frames": 10, "episodes": 2, "seconds": 1.5, "results": {}}
Meanwhile = Callable[..., None]


@pytest.fixture
def meanwhile(monkeypatch: pytest.MonkeyPatch) -> Meanwhile:
    """Lets something happen once, just before a function does its work; or right after it."""

    def plan(module: Any, name: str, work: Callable[[], Any], after: bool = False) -> None:
        function, left = getattr(module, name), [work]

        def with_it(*given: Any, **named: Any) -> Any:
            if left and not after:
                left.pop()()
            found = function(*given, **named)
            if left and after:
                left.pop()()
            return found

        monkeypatch.setattr(module, name, with_it)

    return plan


def lived(add: Filler, held: ExitStack) -> None:
    """What may happen between two looks: run-1 ends, run-2 is resumed, run-3 comes and goes on, run-4 too."""
    registry = add.registry
    add.policy("run-1", checkpoint=ARRAYS)
    registry.files.append_rows("run-1", "episodes", [{"order": 1}])
    registry.finish_run("run-1", status="finished", **END)
    held.enter_context(registry.files.hold("run-2"))
    registry.resume_run("run-2")
    registry.files.append_rows("run-2", "episodes", [{"order": 2}])
    registry.files.write_document("run-2", "trace", {})
    name = add.run().id
    held.enter_context(registry.files.hold(name))
    registry.files.save_checkpoint(name, {}, ARRAYS)
    add.policy(add.run().id, checkpoint=ARRAYS[:-8] + b"12345678")
    registry.finish_run("run-4", status="finished", **END)


@pytest.fixture
def going(registry: Registry, add: Filler) -> Registry:
    """run-1 goes on, run-2 was interrupted."""
    for _ in range(2):
        run = add.run().id
        registry.files.append_rows(run, "episodes", [{"order": 0}])
    registry.finish_run("run-2", status="interrupted", **END)
    return registry


MOMENTS = {
    "rows were read": (checking, "_look"),
    "manifests were listed": (checking, "_look_at"),
    "manifests were read": (checking, "objects_of"),
    "objects are looked at": (checking, "other_files"),
    "it is looked at again": (checking, "_look_again"),
    "stopped runs are looked for": (checking, "_stopped_runs"),
    "bytes are read": (checking, "check_contents"),
    "a seal is taken": (manifests, "seal"),
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_nothing_that_others_do_meanwhile_is_a_fault(
    going: Registry, add: Filler, meanwhile: Meanwhile, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    monkeypatch.setattr(database, "WAIT", 0.5)  # for the writers: they aren't kept waiting
    with ExitStack() as held:
        held.enter_context(going.files.hold("run-1"))
        meanwhile(*MOMENTS[moment], lambda: lived(add, held))
        assert check(going.folder, read_data=True).findings == []
        assert going.runs()[0].id == "run-4"
        assert check(going.folder, read_data=True).findings == []


def test_what_is_wrong_is_still_found_at_the_second_look(
    going: Registry, add: Filler, meanwhile: Meanwhile
) -> None:
    add.policy("run-1", checkpoint=ARRAYS)
    next((going.folder / "objects").iterdir()).unlink()
    with ExitStack() as held:
        held.enter_context(going.files.hold("run-1"))
        meanwhile(checking, "_look_again", lambda: going.files.append_rows("run-1", "episodes", [{}]))
        assert {finding.kind for finding in check(going.folder).findings} == {"missing file"}


@pytest.mark.parametrize("writable", [True, False])
def test_a_row_in_the_making_is_no_fault(
    going: Registry, add: Filler, meanwhile: Meanwhile, monkeypatch: pytest.MonkeyPatch, writable: bool
) -> None:
    """A writer has published a manifest, but not committed yet."""
    monkeypatch.setattr(checking.os, "access", lambda *_: writable)
    threads = []

    def begin() -> None:
        def slow(*given: Any) -> None:
            publish(*given)
            published.set()
            time.sleep(0.1)

        published = threading.Event()
        other = Filler(Registry.open(going.folder))
        publish = store.publish
        monkeypatch.setattr(store, "publish", slow)
        threads.append(threading.Thread(target=other.run))
        threads[0].start()
        published.wait(5)

    with going.files.hold("run-1"):
        meanwhile(checking, "_look", begin)
        found = {finding.kind for finding in check(going.folder).findings}
    threads[0].join()
    assert not found - {"stopped run"}


def test_writers_wait_for_a_moment_only(
    going: Registry, add: Filler, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The look at files is as slow as it likes, even if it finds something at every one of them."""
    for number in range(25):
        (going.folder / "objects" / f"{number:064}.safetensors").write_bytes(b"left")
    told, done = files.other_file, threading.Event()
    monkeypatch.setattr(checking, "other_file", lambda *given: (time.sleep(0.02), *told(*given))[1:])
    waits = []

    def write() -> None:
        with Registry.open(going.folder) as registry:
            while not done.is_set():
                began = time.monotonic()
                registry.resume_run("run-2")
                waits.append(time.monotonic() - began)
                time.sleep(0.01)

    writer = threading.Thread(target=write)
    writer.start()
    assert len(check(going.folder).findings) >= 25
    done.set()
    writer.join()
    assert max(waits) < 1.0 and len(waits) > 3


def test_a_run_between_its_entry_and_its_hold_isnt_stopped(registry: Registry, add: Filler) -> None:
    def begin() -> None:
        other = Filler(Registry.open(registry.folder))
        name = other.run().id
        entered.set()
        time.sleep(0.2)
        with other.registry.files.hold(name):
            done.wait(5)

    entered, done = threading.Event(), threading.Event()
    thread = threading.Thread(target=begin)
    thread.start()
    entered.wait(5)
    assert registry.stopped_runs() == []
    assert check(registry.folder).findings == []
    assert repair(registry.folder).done == []
    done.set()
    thread.join()


@pytest.mark.parametrize("status", ["finished", "interrupted"])
def test_a_run_that_ends_while_it_is_looked_at_was_never_stopped(
    going: Registry, meanwhile: Meanwhile, status: str
) -> None:
    with ExitStack() as held:
        held.enter_context(going.files.hold("run-1"))

        def end() -> None:
            going.finish_run("run-1", status=status, **END)
            held.close()

        meanwhile(layout, "is_held", end)
        assert check(going.folder).findings == []
    assert ("run-1" in [run.id for run in going.stopped_runs()]) == (status == "interrupted")


def test_who_looks_doesnt_keep_a_run_from_being_held(going: Registry) -> None:
    def look() -> None:
        while not done.is_set():
            layout.is_held(going.folder / "runs/run-1")

    done = threading.Event()
    thread = threading.Thread(target=look)
    thread.start()
    try:
        for _ in range(300):
            with going.files.hold("run-1"):
                pass
    finally:
        done.set()
        thread.join()


# Files of one run


@pytest.mark.parametrize("run", ["run-1", "run-2"])
def test_a_table_is_read_while_its_run_ends_or_goes_on_again(
    going: Registry, meanwhile: Meanwhile, run: str
) -> None:
    def change() -> None:
        if run == "run-2":
            going.resume_run(run)
        going.files.append_rows(run, "episodes", [{"order": 1}])
        if run == "run-1":
            going.finish_run(run, status="finished", **END)

    meanwhile(runfiles, "bytes_of", change, after=run == "run-1")
    assert {"order": 0} in going.files.read_rows(run, "episodes")
    meanwhile(
        runfiles, "bytes_of", lambda: going.files.write_document(run, "trace", {}) if run == "run-2" else None
    )
    going.files.read_document(run, "trace")


def test_a_table_that_was_cut_back_and_grew_while_it_was_read(
    going: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    torn = [b'{"order": 0}\n{"or{"order": 1}\n']
    real = runfiles.bytes_of
    monkeypatch.setattr(runfiles, "bytes_of", lambda path: torn.pop() if torn else real(path))
    with going.files.hold("run-1"):
        assert going.files.read_rows("run-1", "episodes") == [{"order": 0}]
    (going.folder / "runs/run-1/episodes.jsonl").write_bytes(b"{\n")
    with pytest.raises(IntegrityError, match="damaged"):
        going.files.read_rows("run-1", "episodes")
    with going.files.hold("run-1"), pytest.raises(IntegrityError, match="damaged"):
        going.files.read_rows("run-1", "episodes")


@pytest.mark.parametrize("again", ["resumed", "resumed and ended"])
def test_export_takes_a_run_whole_or_says_that_it_goes_on(
    going: Registry, meanwhile: Meanwhile, tmp_path: Path, again: str
) -> None:
    def change() -> None:
        going.resume_run("run-2")
        going.files.append_rows("run-2", "episodes", [{"order": 1}])
        if again == "resumed and ended":
            going.finish_run("run-2", status="finished", **END | {"frames": 77})

    meanwhile(bundles, "bytes_of", change)
    if again == "resumed":
        with pytest.raises(UsageError, match="run-2 goes on"):
            bundles.export(going, "run-2", tmp_path / "x.zip")
        return
    bundles.export(going, "run-2", tmp_path / "x.zip")
    bundles.import_(lambda: Registry.open(tmp_path / "other"), tmp_path / "x.zip")
    other = Registry.open(tmp_path / "other")
    assert (other.run("run-1").frames, len(other.files.read_rows("run-1", "episodes"))) == (77, 2)


def test_export_misses_a_table_that_is_gone(going: Registry, tmp_path: Path) -> None:
    (going.folder / "runs/run-2/episodes.jsonl").unlink()
    with pytest.raises(IntegrityError, match="is missing"):
        bundles.export(going, "run-2", tmp_path / "x.zip")


def test_a_checkpoint_that_is_made_anew_under_its_number_is_sound(
    going: Registry, meanwhile: Meanwhile
) -> None:
    for frames in (1, 2):
        going.files.save_checkpoint("run-1", {"frames": frames}, ARRAYS)
    folder = going.folder / "runs/run-1/checkpoints"

    def anew() -> None:
        for suffix in ("json", "safetensors"):
            (folder / f"2.{suffix}").unlink()
        going.files.save_checkpoint("run-1", {"frames": 3}, ARRAYS[:-8] + bytes(8))

    with going.files.hold("run-1"):
        told = (folder / "2.json").read_bytes()
        meanwhile(documents_of(files), "checked", anew, after=True)
        assert check(going.folder, read_data=True).findings == []
        assert (folder / "2.json").read_bytes() != told
    (folder / "2.safetensors").write_bytes(b"x")
    with going.files.hold("run-1"):
        (finding,) = check(going.folder, read_data=True).findings
    assert finding.kind == "damaged checkpoint"


def documents_of(module: Any) -> Any:
    return module.checkpoints.documents


# gc


def left_by(registry: Registry, run: str) -> list[Path]:
    """What a killed process may leave in a run's folder."""
    registry.files.save_checkpoint(run, {}, ARRAYS)
    folder = registry.folder / "runs" / run
    left = [folder / ".trace.json.1.part", folder / "checkpoints/7.safetensors"]
    left.append(folder / "checkpoints/.7.json.1.part")
    for path in left:
        path.write_bytes(b"left")
    return left


def test_gc_touches_no_run_that_a_process_holds(going: Registry) -> None:
    left = left_by(going, "run-1")
    with going.files.hold("run-1"):
        assert check(going.folder).findings == []
        assert collect(going.folder, grace=0, dry=True) == collect(going.folder, grace=0) == []
        assert all(path.exists() for path in left)
    assert len(collect(going.folder, grace=0, dry=True)) == 3
    assert len(collect(going.folder, grace=0)) == 3
    assert not any(path.exists() for path in left)
    assert going.files.rewind("run-1") is not None


@pytest.mark.parametrize("moment", ["_unneeded", "_kept_free", "_belongs"])
def test_gc_touches_no_run_that_begins_while_it_looks(
    going: Registry, meanwhile: Meanwhile, moment: str
) -> None:
    left = left_by(going, "run-1")
    with ExitStack() as held:
        meanwhile(
            garbage,
            moment,
            lambda: held.enter_context(going.files.hold("run-1")),
            after=moment == "_unneeded",
        )
        assert collect(going.folder, grace=0) == []
        assert all(path.exists() for path in left)


def test_nobody_begins_while_gc_unlinks_but_waits(going: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    left_by(going, "run-1")
    began, unlinked, threads = [], [], []
    unlink = Path.unlink

    def begin() -> None:
        with Registry.open(going.folder, create=False).files.hold("run-1"):
            began.append(time.monotonic())

    def slowly(path: Path, **given: Any) -> None:
        threads.append(threading.Thread(target=begin))
        threads[-1].start()
        time.sleep(0.1)
        unlink(path, **given)
        unlinked.append((time.monotonic(), len(began)))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", slowly)
        removed = collect(going.folder, grace=0)
    for thread in threads:
        thread.join()
    assert removed and unlinked[0][1] == 0 and len(began) == len(threads)


@pytest.mark.parametrize("how", ["policy", "import"])
def test_gc_takes_no_object_that_a_row_is_about_to_need(
    going: Registry, add: Filler, meanwhile: Meanwhile, tmp_path: Path, how: str
) -> None:
    add.policy("run-1", checkpoint=ARRAYS)
    going.finish_run("run-1", status="finished", **END)
    bundles.export(going, "run-1", tmp_path / "x.zip")
    place = going.folder if how == "policy" else tmp_path / "other"
    registry = Registry.open(place)
    meanwhile(objects, "publish", lambda: collect(place, grace=0), after=True)
    if how == "policy":
        Filler(registry).policy("run-2", checkpoint=ARRAYS[:-8] + b"12345678")
    else:
        bundles.import_(lambda: Registry.open(place), tmp_path / "x.zip")
    assert check(place, read_data=True).faults == []
    assert registry.read_checkpoint(registry.policies()[0])


def test_gc_takes_a_half_written_object_and_its_writer_begins_again(
    going: Registry, add: Filler, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace, gone = Path.replace, []

    def taken(path: Path, target: Path) -> Path:
        if path.parent.name == "objects" and not gone:
            gone.extend(collect(going.folder, grace=0))
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", taken)
    policy = add.policy("run-1", checkpoint=ARRAYS)
    assert gone and going.read_checkpoint(policy) == ARRAYS


def test_gc_spares_all_for_an_age_that_is_no_number(going: Registry) -> None:
    (going.folder / "objects/.x.part").write_bytes(b"left")
    assert collect(going.folder, grace=float("nan")) == []
