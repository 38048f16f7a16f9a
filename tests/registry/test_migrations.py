import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import create_engine

from filler import Filler
from paddlectl.errors import IntegrityError, PaddlectlError, SchemaVersionError
from paddlectl.registry import schema
from paddlectl.registry.care.check import check
from paddlectl.registry.index import database, sqlite
from paddlectl.registry.store import Registry
from released import SCHEMAS, rebuilt

SECOND = """
from alembic import op
import sqlalchemy as sa
revision = "0006"
down_revision = "0005"

def upgrade():
    with op.batch_alter_table("runs") as batch:
        batch.add_column(sa.Column("note", sa.Text))
        batch.alter_column("kind", existing_type=sa.Text, nullable=True)
    {then}
"""


RUN = (
    "INSERT INTO runs VALUES "
    "(7,'train','hdm','T',NULL,'[]',0,'running','{}','{}',0,0,0.0,'{}','t',NULL,0,NULL,'[]')"
)
POLICY = "INSERT INTO policies VALUES (3,7,'T','d','hdm',0,0,'','x',0.0,0.0,0.0,0.0,'t','{}')"


def _query(path: Path, sql: str) -> list[Any]:
    connection = sqlite3.connect(path)
    try:
        rows = connection.execute(sql).fetchall()
        connection.commit()
        return rows
    finally:
        connection.close()


def _layout(path: Path) -> dict[str, list[Any]]:
    tables = [name for (name,) in _query(path, "SELECT name FROM sqlite_master WHERE type = 'table'")]
    pragmas = ("table_xinfo", "index_list", "foreign_key_list")
    layout = {f"{t}.{p}": _query(path, f"PRAGMA {p}({t})") for t in tables for p in pragmas}
    for table in tables:
        layout[f"{table}.index_list"] = sorted(index[1:] for index in layout[f"{table}.index_list"])
    sql = _query(path, "SELECT sql FROM sqlite_master WHERE sql LIKE '%AUTOINCREMENT%' ORDER BY name")
    return layout | {"autoincrement": [text.split()[2].strip('"') for (text,) in sql]}


def test_migrating_gives_the_tables_of_the_schema(registry: Registry, location: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.db"
    engine = create_engine(f"sqlite:///{plain}")
    schema.metadata.create_all(engine)
    migrated = _layout(location / "registry.db")
    stamp = {key: migrated.pop(key) for key in list(migrated) if key.startswith("alembic_version")}
    assert stamp
    assert migrated == _layout(plain)
    with create_engine(f"sqlite:///{location / 'registry.db'}").connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []


def test_the_list_of_revisions_is_that_of_the_files() -> None:
    config = Config()
    config.set_main_option("script_location", str(database.MIGRATIONS))
    files = [script.revision for script in ScriptDirectory.from_config(config).walk_revisions()]
    assert list(schema.REVISIONS) == files[::-1]


def test_how_a_registry_is_kept(registry: Registry, location: Path) -> None:
    assert _query(location / "registry.db", "PRAGMA journal_mode") == [("delete",)]
    with registry.index.database.writing().connect() as connection:
        found = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("foreign_keys", "synchronous", "busy_timeout", "journal_mode", "trusted_schema")
        }
    expected = {"foreign_keys": 1, "synchronous": 2, "busy_timeout": 60_000}
    assert found == expected | {"journal_mode": "delete", "trusted_schema": 0}
    assert {path.name for path in location.iterdir()} == {
        "registry.db",
        "registry.lock",
        "identity",
        "objects",
        "runs",
        "manifests",
    }


@pytest.mark.parametrize("stamp", ["0006", "9f3c1a", "0000"])
def test_another_versions_registry_is_refused_byte_for_byte(
    registry: Registry, add: Any, location: Path, stamp: str
) -> None:
    add.run()
    path = location / "registry.db"
    _query(path, f"UPDATE alembic_version SET version_num = '{stamp}'")
    before = {p: p.read_bytes() for p in location.rglob("*") if p.is_file()}
    for refused in (
        lambda: Registry.open(location),
        lambda: Registry.open(location, create=False),
        registry.runs,
        lambda: registry.run("run-1"),
        registry.policies,
        lambda: registry.policy("BoxDoor"),
        add.run,
    ):
        with pytest.raises(SchemaVersionError) as caught:
            refused()
        assert caught.value.exit_code == 7
        assert stamp in caught.value.message
    assert {p: p.read_bytes() for p in location.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize(
    "change", ["DELETE FROM alembic_version", "INSERT INTO alembic_version VALUES ('0006')"]
)
def test_a_registry_without_one_clear_stamp_is_damaged(
    registry: Registry, location: Path, change: str
) -> None:
    _query(location / "registry.db", change)
    with pytest.raises(IntegrityError, match="schema"):
        Registry.open(location)


# Released schemas


@pytest.mark.parametrize("released", SCHEMAS)
def test_a_released_schema_is_upgraded_row_for_row(released: str, registry: Registry, tmp_path: Path) -> None:
    place = rebuilt(released, tmp_path / "old")
    tables = ("runs", "policies")
    before = {table: _query(place / "registry.db", f"SELECT * FROM {table} ORDER BY id") for table in tables}
    with Registry.open(place, create=False) as opened:
        assert opened.run("run-2").seed == 2**40 + 1
        assert opened.policy("policy-1").metadata["note"] == "é\u2028\x01"
        assert len(opened.files.read_rows("run-1", "episodes")) == 5
        assert opened.read_checkpoint(opened.policy("policy-2"))
        assert opened.resume_run("run-3").resumes == 1
        opened.finish_run("run-3", status="interrupted", frames=4096, episodes=7, seconds=2.0, results={})
    after = {table: _query(place / "registry.db", f"SELECT * FROM {table} ORDER BY id") for table in tables}
    kept = schema.runs.columns.keys().index("finished")  # and what follows wasn't there, or changed
    assert [row[:kept] for row in after["runs"]] == [row[:kept] for row in before["runs"]]
    assert after["policies"] == before["policies"]
    assert _layout(place / "registry.db") == _layout(Path(registry.location) / "registry.db")
    assert not check(place, read_data=True).faults


def test_one_step_down_and_up_again_loses_only_what_the_older_cant_hold(tmp_path: Path) -> None:
    place = rebuilt("0001", tmp_path / "old")
    path = place / "registry.db"
    before = {table: _query(path, f"SELECT * FROM {table} ORDER BY id") for table in ("runs", "policies")}
    Registry.open(place)
    with sqlite._migrating(path).begin() as connection:
        config = Config(attributes={"connection": connection})
        config.set_main_option("script_location", str(database.MIGRATIONS))
        command.downgrade(config, "0001")
    assert {table: _query(path, f"SELECT * FROM {table} ORDER BY id") for table in before} == before
    with Registry.open(place) as opened:
        assert [run.resumes for run in opened.runs()] == [0, 0, 0, 0]
    assert not check(place, read_data=True).faults


@pytest.mark.parametrize("released", SCHEMAS)
def test_an_id_that_was_given_once_isnt_given_again_after_an_upgrade(released: str, tmp_path: Path) -> None:
    place = rebuilt(released, tmp_path / "old")
    _query(place / "registry.db", "UPDATE sqlite_sequence SET seq = 90")  # those up to 90 were removed
    with Registry.open(place) as opened:
        add = Filler(opened)
        run = add.run().id
        assert (run, add.policy(run).id) == ("run-91", "policy-91")


def test_a_policy_may_be_kept_without_a_program(registry: Registry, add: Any) -> None:
    add.policy(add.run().id, program=None, crispness=None)
    assert (registry.policy("policy-1").program, registry.policy("policy-1").crispness) == (None, None)


def test_a_step_down_keeps_a_policy_without_a_program(registry: Registry, add: Any, location: Path) -> None:
    run, path = add.run().id, location / "registry.db"
    add.policy(run)
    add.policy(run, program=None, crispness=None)
    columns = "SELECT program, crispness FROM policies ORDER BY id"
    rest = "SELECT id, run, task, method, checkpoint, success_rate, metadata FROM policies ORDER BY id"
    before = _query(path, columns), _query(path, rest)
    with sqlite._migrating(path).begin() as connection:
        config = Config(attributes={"connection": connection})
        config.set_main_option("script_location", str(database.MIGRATIONS))
        command.downgrade(config, "0003")
    assert (_query(path, columns), _query(path, rest)) == ([before[0][0], ("", 0.0)], before[1])
    with Registry.open(location) as opened:
        assert opened.policy("policy-2").program == ""
        assert add.policy(run, program=None, crispness=None).id == "policy-3"
    assert not check(location, read_data=True).faults


# A further revision, which there isn't yet


@pytest.fixture
def next_version(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Turns this paddlectl into one that is a revision ahead; gives its new revision's file."""
    folder = tmp_path / "100% migrations"
    shutil.copytree(database.MIGRATIONS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(database, "MIGRATIONS", folder)
    monkeypatch.setattr(schema, "REVISIONS", (*schema.REVISIONS, "0006"))
    monkeypatch.setattr("paddlectl.registry.index.index.REVISIONS", schema.REVISIONS)
    return folder / "versions" / "0006_note.py"


def test_an_older_registry_is_copied_and_upgraded(
    registry: Registry, add: Any, location: Path, next_version: Path
) -> None:
    next_version.write_text(SECOND.format(then=""))
    path = location / "registry.db"
    _query(path, RUN)
    _query(path, POLICY)
    before = _query(path, "SELECT * FROM runs")
    Registry.open(location, create=False)
    Registry.open(location, create=False)
    assert _query(path, "SELECT version_num FROM alembic_version") == [("0006",)]
    assert _query(path, "SELECT * FROM runs") == [(*before[0], None)]
    assert _query(path, "SELECT id, run FROM policies") == [(3, 7)]
    (copy,) = location.glob("registry.db.0005.*")
    assert _query(copy, "SELECT * FROM runs") == before
    assert _query(copy, "SELECT version_num FROM alembic_version") == [("0005",)]
    with pytest.raises(sqlite3.IntegrityError):  # the foreign key outlived the move of its table
        connection = sqlite3.connect(path)
        connection.execute("PRAGMA foreign_keys=ON")
        connection.execute("DELETE FROM runs")


def test_a_failed_upgrade_leaves_the_registry_as_it_was_and_may_be_tried_again(
    registry: Registry, add: Any, location: Path, next_version: Path
) -> None:
    path = location / "registry.db"
    before = path.read_bytes()
    for fault in ('op.execute("INSERT INTO nowhere VALUES (1)")', 'raise OSError(28, "No space left")'):
        next_version.write_text(SECOND.format(then=fault))
        with pytest.raises(PaddlectlError):
            Registry.open(location)
        assert path.read_bytes() == before
    next_version.write_text(SECOND.format(then=""))
    Registry.open(location)
    assert not _query(path, "SELECT name FROM sqlite_master WHERE name LIKE '_alembic_tmp%'")
    assert _query(path, "SELECT version_num FROM alembic_version") == [("0006",)]


def test_an_upgrade_that_orphans_rows_is_undone(
    registry: Registry, add: Any, location: Path, next_version: Path
) -> None:
    path = location / "registry.db"
    _query(path, RUN)
    _query(path, POLICY)
    before = path.read_bytes()
    next_version.write_text(SECOND.format(then='op.execute("DELETE FROM runs")'))
    with pytest.raises(IntegrityError, match="whose run is missing"):
        Registry.open(location)
    assert path.read_bytes() == before


def test_a_creation_that_was_killed_starts_anew(location: Path) -> None:
    location.mkdir()
    (location / "registry.db.new").write_bytes(b"half")
    (location / "registry.db.new-journal").write_bytes(b"half")
    assert Registry.open(location).runs() == []
    assert not list(location.glob("registry.db.new*"))
