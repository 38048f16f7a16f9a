"""Planted faults: `check` finds each, and nothing in a sound registry; `repair` tells what it does."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import IntegrityError, NotFoundError, SchemaVersionError
from paddlectl.registry.care import repair as repairing
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import manifests
from paddlectl.registry.index import database
from paddlectl.registry.store import Registry
from released import rebuilt
from trials.faults import FAULTS, ONLY_IN_THE_DATA, manifest, sql


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory, new: Path, filler: Any) -> Path:
    location = tmp_path_factory.mktemp("filled") / "registry"
    shutil.copytree(new, location)
    registry = Registry.open(location)
    filler(registry).all_kinds()
    return location


@pytest.fixture
def location(filled: Path, tmp_path: Path) -> Path:
    shutil.copytree(filled, tmp_path / "registry")
    return tmp_path / "registry"


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found_and_mended_as_far_as_it_can_be(location: Path, name: str) -> None:
    kind, plant = FAULTS[name]
    plant(location)
    before = {path: path.read_bytes() for path in location.rglob("*") if path.is_file()}
    quick = {finding.kind for finding in check(location).faults}
    assert (kind in quick) == (name not in ONLY_IN_THE_DATA)
    assert kind in {finding.kind for finding in check(location, read_data=True).faults}
    assert {path: path.read_bytes() for path in location.rglob("*") if path.is_file()} == before
    told = repair(location)
    assert bool(told.lost) == ("object" in name and "file" not in name)
    if told.lost:
        assert not told.done
        assert {path: path.read_bytes() for path in location.rglob("*") if path.is_file()} == before
        told = repair(location, drop_lost=True)
    assert told.done or told.left
    with Registry.open(location) as registry:
        runs, policies = registry.runs(), registry.policies()
        assert {run.id for run in runs} >= {"run-1", "run-2", "run-3"}
        kept = {policy.id for policy in policies}
        for policy in policies:
            assert registry.read_checkpoint(policy)
    objects_whole = "object" not in name
    assert kept == {"policy-1", "policy-2"} or not objects_whole, told.done
    assert [
        finding for finding in told.left if "run-1/" not in finding.where and finding.kind != "missing source"
    ] == []
    if not told.left:
        assert repair(location).done == []


def test_a_sound_registry_has_no_fault_and_is_left_alone(location: Path) -> None:
    before = {path: path.read_bytes() for path in location.rglob("*") if path.is_file()}
    report = check(location, read_data=True)
    assert (report.findings, report.readable, len(report.rows)) == ([], True, 5)
    assert report.bytes > 16_000
    assert repair(location).done == []
    assert collect(location, grace=0) == []
    assert {path: path.read_bytes() for path in location.rglob("*") if path.is_file()} == before


def test_there_are_twenty_kinds_and_more() -> None:
    assert len({kind for kind, _ in FAULTS.values()}) >= 20


def test_the_index_comes_back_from_manifests_alone(location: Path) -> None:
    with Registry.open(location) as registry:
        runs, policies = registry.runs(), registry.policies()
    for damage in (b"", b"no database", None):
        if damage is None:
            (location / "registry.db").unlink()
        else:
            (location / "registry.db").write_bytes(damage)
        assert repair(location).left == []
        with Registry.open(location) as registry:
            assert (registry.runs(), registry.policies()) == (runs, policies)


@pytest.mark.parametrize("lost", ["manifests/policy-2.json", "manifests/run-2.json"])
def test_what_neither_index_nor_manifest_tells_isnt_dropped_unasked(location: Path, lost: str) -> None:
    (location / "registry.db").unlink()
    (location / lost).write_bytes(b"damaged")
    name = Path(lost).stem
    assert repair(location).lost == [f"{name}: neither its row nor its manifest can be read"]
    assert not (location / "registry.db").exists()
    told = repair(location, drop_lost=True)
    assert f"{name}: neither its row nor its manifest can be read; it is gone from the index" in told.done
    assert not told.lost


def test_others_may_write_while_the_bytes_are_read(
    location: Path, filler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    seal = manifests.seal
    added: list[str] = []

    def meanwhile(path: Path) -> manifests.Seal:
        with monkeypatch.context() as patch:
            patch.setattr(manifests, "seal", seal)
            if not added:
                added.append(filler(Registry.open(location)).run().id)
        return seal(path)

    monkeypatch.setattr(database, "WAIT", 0.1)
    monkeypatch.setattr(manifests, "seal", meanwhile)
    assert check(location, read_data=True).findings == []
    assert added == ["run-4"]


def test_repair_leaves_what_others_do_meanwhile(
    location: Path, filler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    sql("DELETE FROM policies WHERE id = 2", "UPDATE runs SET frames = 77 WHERE id = 1")(location)
    other = filler(Registry.open(location))
    opened: list[str] = []

    def check_and_then(*given: Any, **named: Any) -> Any:
        report = check(*given, **named)
        if not opened:
            opened.append(other.run().id)
            other.policy("run-4")
            other.registry.resume_run("run-3")
        return report

    monkeypatch.setattr(repairing, "check", check_and_then)
    told = repair(location)
    assert told.left == []
    with Registry.open(location) as registry:
        assert [run.id for run in registry.runs()] == ["run-4", "run-3", "run-2", "run-1"]
        assert [policy.id for policy in registry.policies()] == ["policy-3", "policy-2", "policy-1"]
        assert (registry.run("run-3").status, registry.run("run-3").resumes) == ("running", 1)
        assert registry.run("run-1").frames == 10


def test_a_newer_registry_is_refused_and_not_touched(location: Path) -> None:
    sql("UPDATE alembic_version SET version_num = '9999'")(location)
    before = {path: path.read_bytes() for path in location.rglob("*") if path.is_file()}
    for work in (check, repair, collect):
        with pytest.raises(SchemaVersionError):
            work(location)
    assert {path: path.read_bytes() for path in location.rglob("*") if path.is_file()} == before


def test_an_older_registry_is_left_to_be_upgraded(tmp_path: Path) -> None:
    place = rebuilt("0001", tmp_path / "old")
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    (finding,) = check(place, read_data=True).findings
    assert (finding.kind, finding.fault) == ("older schema", False)
    assert repair(place).done == []
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before
    (place / "registry.db").write_bytes(b"damaged")
    with pytest.raises(IntegrityError, match="no manifests"):
        repair(place)
    assert (place / "runs/run-1/episodes.jsonl").exists()


def test_no_registry(tmp_path: Path) -> None:
    for work in (check, repair, collect):
        with pytest.raises(NotFoundError):
            work(tmp_path / "none")


def test_gc_frees_what_nobody_needs_once_it_is_old(location: Path) -> None:
    left = ["objects/" + "0" * 64 + ".safetensors", "objects/.x.part", "runs/run-1/.episodes.part"]
    for name in left:
        (location / name).write_bytes(b"left")
    assert collect(location) == []
    assert sorted(name for name, _ in collect(location, grace=0, dry=True)) == sorted(left)
    assert all((location / name).exists() for name in left)
    assert sorted(name for name, _ in collect(location, grace=0)) == sorted(left)
    assert check(location, read_data=True).findings == []


def test_gc_does_nothing_where_there_is_a_fault(location: Path) -> None:
    sql("DELETE FROM policies WHERE id = 2")(location)
    with pytest.raises(IntegrityError, match="nothing was removed"):
        collect(location, grace=0)


def test_a_run_whose_process_died_is_told_and_marked(location: Path, filler: Any) -> None:
    with Registry.open(location) as registry:
        add = filler(registry)
        assert add.run().id == "run-4"
        with registry.files.hold("run-4"):
            assert check(location).findings == []
        (finding,) = check(location).findings
        assert (finding.kind, finding.where, finding.fault) == ("stopped run", "run-4", False)
        assert "run-4: no process goes on with it; it is interrupted" in repair(location).done
        assert registry.run("run-4").status == "interrupted"
        assert check(location, read_data=True).findings == []


def test_ids_arent_given_twice_even_if_the_index_lost_some(location: Path, filler: Any) -> None:
    sql("DELETE FROM policies", "DELETE FROM runs", "DELETE FROM sqlite_sequence")(location)
    with Registry.open(location) as registry:
        add = filler(registry)
        assert add.run().id == "run-4"
        assert add.policy("run-4").id == "policy-3"
        told = repair(location)
        assert told.left == []
        assert {run.id for run in registry.runs()} == {f"run-{n}" for n in range(1, 5)}


def test_a_manifest_says_which_of_its_bytes_were_changed(location: Path) -> None:
    path = manifest(location)
    data = json.loads(path.read_text())
    data["content"]["row"]["seed"] = 7
    path.write_text(json.dumps(data))
    with pytest.raises(IntegrityError, match="SHA-256 differs"):
        manifests.read(location, "run-1")


def test_an_older_index_without_its_folder_is_refused(location: Path, tmp_path: Path) -> None:
    older = rebuilt("0002", tmp_path / "older")
    (location / "identity").unlink()
    (tmp_path / "alone").mkdir()
    for place in (location, tmp_path / "alone"):
        shutil.copy(older / "registry.db", place)
        for work in (check, repair):
            with pytest.raises(IntegrityError, match="doesn't belong"):
                work(place)
