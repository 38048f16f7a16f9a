"""A folder and an index that don't belong together are refused by every command, and nothing changes."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from filler import Filler
from paddlectl.errors import IntegrityError, NotFoundError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.garbage import collect
from paddlectl.registry.care.repair import repair
from paddlectl.registry.index import identity
from paddlectl.registry.store import Registry
from postgres import Server, server
from released import rebuilt
from samples import Command
from trials.faults import sql

COMMANDS = (
    "runs", "show policy-1", "train BoxDoor", "resume --all", "registry check", "registry repair",
    "registry repair --drop-lost", "registry gc", "registry upgrade",
    "registry export run-1 {folder}/new.zip", "registry import {folder}/run.zip",
)  # fmt: skip


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry, and beside it one of its runs as a bundle."""
    place = tmp_path_factory.mktemp("filled") / "registry"
    Filler(Registry.open(place)).all_kinds()
    bundles.export(Registry.open(place), "run-1", place.parent / "run.zip")
    return place


@pytest.fixture
def location(filled: Path, tmp_path: Path) -> Path:
    shutil.copytree(filled.parent, tmp_path, dirs_exist_ok=True)
    return tmp_path / "registry"


@pytest.fixture
def another(tmp_path: Path) -> Path:
    Filler(Registry.open(tmp_path / "another")).all_kinds()
    return tmp_path / "another"


def contents(folder: Path) -> dict[Path, bytes]:
    return {
        path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock"
    }


def everything_is_refused(address: str | Path, folder: Path, command: Command, *words: str) -> None:
    before = contents(folder)
    for work in (Registry.open, partial(Registry.open, create=False), check, repair, collect):
        with pytest.raises(IntegrityError) as caught:
            work(address)
        for word in words:
            assert word in caught.value.message
        assert caught.value.hint
    for line in COMMANDS:
        answer = command(*line.format(folder=folder).split(), "--registry", address)
        assert (answer.code, answer.out) == (5, ""), line
    assert contents(folder) == before


# SQLite


def in_anothers_folder(location: Path, another: Path) -> None:
    shutil.copy(another / "registry.db", location / "registry.db")


def in_an_empty_folder(location: Path, another: Path) -> None:
    shutil.rmtree(location)
    location.mkdir()
    shutil.copy(another / "registry.db", location / "registry.db")


def without_identity(location: Path, another: Path) -> None:
    (location / "identity").unlink()


def with_anothers_identity(location: Path, another: Path) -> None:
    shutil.copy(another / "identity", location / "identity")


def with_a_bit_changed(location: Path, another: Path) -> None:
    text = (location / "identity").read_text()
    (location / "identity").write_text(("1" if text[0] == "0" else "0") + text[1:])


@pytest.mark.parametrize(
    "mix",
    [in_anothers_folder, in_an_empty_folder, without_identity, with_anothers_identity, with_a_bit_changed],
)
def test_an_index_with_a_folder_that_isnt_its_own(
    location: Path, another: Path, command: Command, mix: Callable[[Path, Path], None]
) -> None:
    mix(location, another)
    everything_is_refused(location, location.parent, command, str(location), "registry.db")


def test_what_the_hint_says_brings_a_lost_identity_back(location: Path) -> None:
    rows = Registry.open(location).runs()
    (location / "identity").unlink()
    with pytest.raises(IntegrityError) as caught:
        Registry.open(location)
    subprocess.run(caught.value.hint.partition("run: ")[2], shell=True, check=True)
    assert Registry.open(location).runs() == rows
    assert check(location, read_data=True).findings == []


def test_an_index_made_again_has_its_folders_identity(location: Path, tmp_path: Path) -> None:
    shutil.copy(location / "registry.db", tmp_path / "copy.db")
    before, rows = (location / "identity").read_bytes(), Registry.open(location).runs()
    (location / "registry.db").unlink()
    assert repair(location).left == []
    assert (location / "identity").read_bytes() == before
    shutil.copy(tmp_path / "copy.db", location / "registry.db")
    assert Registry.open(location).runs() == rows


def test_a_copy_of_the_index_from_before_comes_up_to_date(location: Path, tmp_path: Path) -> None:
    shutil.copy(location / "registry.db", tmp_path / "copy.db")
    Filler(Registry.open(location)).run(seed=7)
    Registry.open(location).finish_run(
        "run-4", status="finished", frames=1, episodes=1, seconds=1.0, results={}
    )
    shutil.copy(tmp_path / "copy.db", location / "registry.db")
    assert len(Registry.open(location).runs()) == 3
    told = repair(location)
    assert told.done and not told.left and not told.lost
    assert Registry.open(location).run("run-4").seed == 7


def test_a_damaged_identity_in_the_index_is_damage(location: Path) -> None:
    for statement in ("DELETE FROM identity", "UPDATE identity SET id = 'x'", "DROP TABLE identity"):
        sql(statement)(location)
        with pytest.raises(IntegrityError):
            Registry.open(location)
        assert {finding.kind for finding in check(location).faults} == {"damaged index"}
        assert repair(location).left == []
        assert len(Registry.open(location).runs()) == 3


def test_an_empty_registry_is_made_anew(tmp_path: Path) -> None:
    Registry.open(tmp_path / "registry")
    (tmp_path / "registry/registry.db").unlink()
    with pytest.raises(NotFoundError):
        Registry.open(tmp_path / "registry", create=False)
    assert Registry.open(tmp_path / "registry").runs() == []


@pytest.mark.parametrize("schema", ["0001", "0002"])
def test_an_older_registry_gets_an_identity_unless_its_folder_is_anothers(
    schema: str, tmp_path: Path, another: Path
) -> None:
    place = rebuilt(schema, tmp_path / "old")
    shutil.copy(place / "registry.db", another / "registry.db")
    bare = tmp_path / "bare"
    bare.mkdir()
    shutil.copy(place / "registry.db", bare / "registry.db")
    for wrong in (another, bare):
        before = contents(wrong)
        with pytest.raises(IntegrityError, match="doesn't hold its runs"):
            Registry.open(wrong)
        assert contents(wrong) == before
    old = (place / "registry.db").read_bytes()
    with Registry.open(place, create=False) as opened:
        assert len(opened.runs()) == 4
    told = (place / "identity").read_bytes()
    (place / "registry.db").write_bytes(old)  # from before the upgrade
    assert len(Registry.open(place).runs()) == 4
    assert (place / "identity").read_bytes() == told
    assert not check(place, read_data=True).faults


# PostgreSQL


@pytest.fixture(scope="module")
def postgres() -> Iterator[Server]:
    with server() as running:
        yield running


@pytest.fixture
def address(postgres: Server, tmp_path: Path) -> str:
    made = postgres.new(tmp_path / "files")
    Filler(Registry.open(made)).all_kinds()
    bundles.export(Registry.open(made), "run-1", tmp_path / "run.zip")
    return made


def database_in(address: str) -> str:
    return address.partition("?")[0].rpartition("/")[2]


@pytest.mark.parametrize("wrong", ["nowhere", "empty", "another", "copied"])
def test_a_mistyped_folder_of_a_database(
    wrong: str, address: str, another: Path, tmp_path: Path, command: Command
) -> None:
    (tmp_path / "empty").mkdir()
    shutil.copytree(tmp_path / "files", tmp_path / "copied")
    (tmp_path / "copied/identity").unlink()
    rows = Registry.open(address).runs(), Registry.open(address).policies()
    mistyped = address.replace(f"files={tmp_path}/files", f"files={tmp_path}/{wrong}")
    told = (str(tmp_path / wrong), f"the database {database_in(address)}")
    everything_is_refused(mistyped, tmp_path, command, *told)
    assert not (tmp_path / "nowhere").exists()
    assert (Registry.open(address).runs(), Registry.open(address).policies()) == rows


def test_an_older_database_gets_an_identity_unless_its_folder_is_anothers(
    address: str, another: Path, postgres: Server, tmp_path: Path
) -> None:
    rows, name = Registry.open(address).runs(), database_in(address)
    (tmp_path / "files/identity").unlink()
    postgres.run("DROP TABLE identity", name)
    postgres.run("ALTER TABLE runs DROP COLUMN name, DROP COLUMN tags", name)
    postgres.run("UPDATE alembic_version SET version_num = '0002'", name)
    shutil.copytree(another, tmp_path / "older")
    (tmp_path / "older/identity").unlink()
    for wrong in ("nowhere", "another", "older"):
        with pytest.raises(IntegrityError, match="doesn't belong to the database"):
            Registry.open(address.replace("/files", f"/{wrong}"))
    assert not (tmp_path / "nowhere").exists() and not (tmp_path / "older/identity").exists()
    assert Registry.open(address).runs() == rows
    assert (tmp_path / "files/identity").read_text().endswith(f" the database {name}\n")


def test_the_folder_of_a_database_without_its_address(address: str, tmp_path: Path, command: Command) -> None:
    everything_is_refused(tmp_path / "files", tmp_path, command, "its index is the database")


def test_a_mistyped_database(address: str, postgres: Server, tmp_path: Path, command: Command) -> None:
    everything_is_refused(postgres.new(tmp_path / "files"), tmp_path, command, "its index is the database")


def test_a_database_that_was_lost_leaves_its_folder_for_good(
    address: str, postgres: Server, tmp_path: Path
) -> None:
    """The way that the refusal tells; afterwards the old one, should it come back, is refused."""
    other = postgres.new(tmp_path / "files")
    rows = Registry.open(address).runs()
    with pytest.raises(IntegrityError) as caught:
        repair(other)
    subprocess.run(caught.value.hint.partition("run: ")[2], shell=True, check=True)
    assert repair(other).left == []
    assert Registry.open(other).runs() == rows
    with pytest.raises(IntegrityError, match="doesn't belong"):
        Registry.open(address)


def test_one_that_lost_its_tables_gets_a_new_identity(address: str, postgres: Server, tmp_path: Path) -> None:
    name = database_in(address)
    before, rows = (tmp_path / "files/identity").read_bytes(), Registry.open(address).runs()
    postgres.run("DROP TABLE policies", name)
    assert repair(address).left == [] and (tmp_path / "files/identity").read_bytes() == before
    for table in ("policies", "runs", "identity", "alembic_version"):
        postgres.run(f"DROP TABLE {table}", name)
    assert repair(address).left == [] and (tmp_path / "files/identity").read_bytes() != before
    assert Registry.open(address).runs() == rows


def test_completion_says_nothing(address: str, location: Path, tmp_path: Path) -> None:
    from paddlectl.cli.completion import policy_names, stopped_names, transfer_names

    (location / identity.FILE).unlink()
    for place in (str(location), f"{address}x"):
        assert [names(place) for names in (policy_names, transfer_names, stopped_names)] == [[], [], []]
