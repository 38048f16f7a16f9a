"""What is PostgreSQL's own: addresses, upgrades, faults. The rest runs in test_store and others."""

from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, inspect, text

from paddlectl.errors import NotFoundError, PaddlectlError, SchemaVersionError, UsageError
from paddlectl.registry import schema
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.index import database
from paddlectl.registry.index.location import database_of
from paddlectl.registry.store import Registry
from postgres import Server
from released import rebuilt

QUOTED = "s3cret%2Fp%40ss"


@pytest.fixture
def address(location: Path, postgres: Server) -> str:
    return postgres.new(location)


def engine(address: str) -> Any:
    return create_engine(database_of(address)._url)  # type: ignore[attr-defined]


def run_sql(address: str, *statements: str) -> None:
    with engine(address).begin() as connection:
        for statement in statements:
            connection.execute(text(statement))


def columns(address: str) -> dict[str, list[tuple[str, str, bool]]]:
    there = inspect(engine(address))
    return {
        table: [(c["name"], str(c["type"]), c["nullable"]) for c in there.get_columns(table)]
        for table in sorted(there.get_table_names())
    }


def test_the_schema_is_the_released_one(address: str) -> None:
    Registry.open(address)
    found = columns(address)
    assert [name for name, *_ in found["runs"]] == schema.runs.columns.keys()
    assert dict((n, t) for n, t, _ in found["runs"])["seed"] == "BIGINT"
    nullable = {n for n, _, null in found["runs"] if null}
    assert nullable == {"scenario", "finished", "name"}
    keys = inspect(engine(address)).get_foreign_keys("policies")
    assert [(k["name"], k["referred_table"]) for k in keys] == [("fk_policies_run", "runs")]


def test_an_older_schema_is_copied_and_upgraded(
    address: str, location: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on SQLite: the rows of the released fixture, entered into the first schema."""
    import sqlite3

    rebuilt("0001", location)
    old = sqlite3.connect(location / "registry.db")
    rows = {
        table: old.execute(f"SELECT * FROM {table} ORDER BY id").fetchall() for table in ("runs", "policies")
    }
    old.close()
    (location / "registry.db").unlink()
    with engine(address).begin() as connection:
        from alembic import command
        from alembic.config import Config

        config = Config(attributes={"connection": connection})
        config.set_main_option("script_location", str(database.MIGRATIONS))
        command.upgrade(config, "0001")
        for table, values in rows.items():
            for row in values:
                marks = ", ".join(f":v{n}" for n in range(len(row)))
                given = {f"v{n}": value for n, value in enumerate(row)}
                connection.execute(text(f"INSERT INTO {table} VALUES ({marks})"), given)
    with Registry.open(address) as registry:
        assert [run.id for run in registry.runs()] == ["run-4", "run-3", "run-2", "run-1"]
        assert registry.run("run-2").seed == 2**40 + 1
        assert registry.policy("policy-2").program.startswith("1e-05 :: gt_box()")
        assert registry.read_checkpoint(registry.policy("policy-1"))
        assert registry.files.read_rows("run-1", "episodes")[3] == {"order": 3, "score": 1.5}
    (copy,) = [
        name for name in inspect(engine(address)).get_schema_names() if name.startswith("paddlectl_0001_")
    ]
    with engine(address).connect() as connection:
        for table, values in rows.items():
            assert [
                tuple(r) for r in connection.execute(text(f"SELECT * FROM {copy}.{table} ORDER BY id"))
            ] == values
    assert not check(address, read_data=True).faults


def test_a_newer_schema_is_refused_and_left(address: str) -> None:
    Registry.open(address)
    run_sql(address, "UPDATE alembic_version SET version_num = '9999'")
    for work in (Registry.open, check, repair):
        with pytest.raises(SchemaVersionError) as caught:
            work(address)
        assert caught.value.exit_code == 7


def test_check_and_repair(address: str, filler: Any) -> None:
    registry = Registry.open(address)
    filler(registry).all_kinds()
    before = registry.runs(), registry.policies()
    assert check(address, read_data=True).findings == []
    plants = (
        ("lost row", ["DELETE FROM policies WHERE id = 2"]),
        ("other row", ["UPDATE policies SET mean_score = 0.99 WHERE id = 1"]),
        ("damaged row", ["UPDATE runs SET settings = '{' WHERE id = 1"]),
        ("missing database index", ["DROP INDEX ix_policies_task"]),
        ("damaged index", ["DROP TABLE policies"]),
        ("damaged index", ["DELETE FROM alembic_version"]),
    )
    for kind, statements in plants:
        run_sql(address, *statements)
        assert kind in {finding.kind for finding in check(address).faults}, kind
        told = repair(address)
        assert told.done and not told.left, (kind, told)
        assert (registry.runs(), registry.policies()) == before
    assert filler(registry).run().id == "run-4"


def test_no_registry(address: str, location: Path) -> None:
    for work in (check, repair, lambda place: Registry.open(place, create=False)):
        with pytest.raises(NotFoundError):
            work(address)
    assert not location.exists()


@pytest.mark.parametrize(
    "wrong",
    [
        f"postgresql://me:{QUOTED}@localhost/x",
        f"postgresql://me:{QUOTED}@localhost/?files=/tmp/x",
        f"postgresql://me:{QUOTED}@localhost:port/x?files=/tmp/x",
        f"mysql://me:{QUOTED}@localhost/x?files=/tmp/x",
        f"postgresql://me:{QUOTED}@localhost:1/x?files=/tmp/x",
        f"postgresql://me:{QUOTED}@/x?host=/nowhere&files=/tmp/x&password={QUOTED}",
    ],
)
def test_no_address_gives_its_password_away(wrong: str) -> None:
    with pytest.raises(PaddlectlError) as caught:
        Registry.open(wrong)
    assert isinstance(caught.value, UsageError) or caught.value.exit_code == 1
    assert "s3cret" not in str(caught.value)
