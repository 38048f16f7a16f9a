"""The registry's tables, and the way from their rows to records."""

from collections.abc import Iterable, Sequence
from types import NoneType
from typing import Any

from sqlalchemy import (
    BigInteger,
    Column,
    Float,
    ForeignKey,
    Integer,
    MetaData,
    Select,
    Table,
    Text,
    select,
)

from paddlectl.errors import IntegrityError
from paddlectl.registry.files.documents import from_json
from paddlectl.registry.records import PolicyRecord, RunRecord

# Every revision in migrations/versions, oldest first. Kept here so that reading needs no alembic.
REVISIONS = ("0001", "0002", "0003", "0004", "0005")

# Named, because SQLite's batch migrations can only change constraints that have names.
metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_name)s",
    }
)

# SQLite's integers have 64 bits as they are.
Long = BigInteger().with_variant(Integer, "sqlite")

runs = Table(
    "runs",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("kind", Text, nullable=False),
    Column("method", Text, nullable=False),
    Column("task", Text, nullable=False),
    Column("scenario", Text),
    Column("sources", Text, nullable=False),
    Column("seed", Long, nullable=False),
    Column("status", Text, nullable=False),
    Column("settings", Text, nullable=False),
    Column("versions", Text, nullable=False),
    Column("frames", Long, nullable=False),
    Column("episodes", Long, nullable=False),
    Column("seconds", Float, nullable=False),
    Column("results", Text, nullable=False),
    Column("created", Text, nullable=False),
    Column("finished", Text),
    Column("resumes", Integer, nullable=False, server_default="0"),
    Column("name", Text),
    Column("tags", Text, nullable=False, server_default="[]"),
    sqlite_autoincrement=True,
)

policies = Table(
    "policies",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("run", Integer, ForeignKey("runs.id"), nullable=False, index=True),
    Column("task", Text, nullable=False, index=True),
    Column("domain", Text, nullable=False),
    Column("method", Text, nullable=False),
    Column("seed", Long, nullable=False),
    Column("frames", Long, nullable=False),
    Column("program", Text),
    Column("checkpoint", Text, nullable=False),
    Column("success_rate", Float, nullable=False),
    Column("mean_score", Float, nullable=False),
    Column("mean_length", Float, nullable=False),
    Column("crispness", Float),
    Column("created", Text, nullable=False),
    Column("metadata", Text, nullable=False),
    sqlite_autoincrement=True,
)

identity = Table("identity", metadata, Column("id", Text, primary_key=True))  # one row

ROW_TABLES = {"run": runs, "policy": policies}
"""By the kind that begins the names of their rows."""

_REPAIR = "run: paddlectl registry repair"
_VALUES = {"INTEGER": int, "BIGINT": int, "FLOAT": float, "TEXT": str}


def _expected(table: Table) -> list[tuple[type, ...]]:
    kinds = [_VALUES[str(column.type)] for column in table.columns]
    return [(kind, NoneType) if c.nullable else (kind,) for kind, c in zip(kinds, table.columns, strict=True)]


_RUN_FIELDS = [*runs.columns.keys(), "policy", "success_rate"]
_RUN_JSON = [("sources", list), ("settings", dict), ("versions", dict), ("results", dict), ("tags", list)]
_RUN_TYPES = [*_expected(runs), (int, NoneType), (float, NoneType)]
_POLICY_TYPES = _expected(policies)


def select_runs() -> Select[Any]:
    """Runs with their newest policy and its success rate, as `run_records` takes them."""
    own = policies.c.run == runs.c.id
    newest = [
        select(column).where(own).order_by(policies.c.id.desc()).limit(1).scalar_subquery().label(name)
        for name, column in {"policy": policies.c.id, "success_rate": policies.c.success_rate}.items()
    ]
    return select(*runs.columns, *newest)


def run_records(rows: Iterable[Sequence[Any]]) -> list[RunRecord]:
    """Records of rows of `select_runs`. Those with equal settings or versions share them.

    Raises:
        IntegrityError: If a row holds what was never stored.
    """
    known: dict[str, Any] = {}
    return [_run_record(row, known) for row in rows]


def _run_record(row: Sequence[Any], known: dict[str, Any]) -> RunRecord:
    _check(row, _RUN_TYPES, "runs")
    values = dict(zip(_RUN_FIELDS, row, strict=True))
    name = f"run-{values['id']}"
    for field, kind in _RUN_JSON:
        values[field] = _stored(kind, values[field], name, known)
    values["results"] = _renamed(values["kind"], values["results"], values.pop("success_rate"))
    values["id"] = name
    values["sources"], values["tags"] = tuple(values["sources"]), tuple(values["tags"])
    values["policy"] = None if values["policy"] is None else f"policy-{values['policy']}"
    return RunRecord(**values)


def _renamed(kind: str, results: dict[str, Any], success_rate: float | None) -> dict[str, Any]:
    """Results by their names: a transfer's `success_rate` was that of its last 100 episodes once."""
    if kind == "train" or "success_rate" not in results or "final_success" in results:
        return results
    now = {"final_success" if name == "success_rate" else name: value for name, value in results.items()}
    return now if success_rate is None else now | {"success_rate": success_rate}


def policy_records(rows: Iterable[Sequence[Any]]) -> list[PolicyRecord]:
    """Records of rows of `policies`. Those with equal metadata share them.

    Raises:
        IntegrityError: If a row holds what was never stored.
    """
    known: dict[str, Any] = {}
    return [_policy_record(row, known) for row in rows]


def policy_record(row: Sequence[Any]) -> PolicyRecord:
    """A record of one row of `policies`.

    Raises:
        IntegrityError: If the row holds what was never stored.
    """
    return _policy_record(row, {})


def _policy_record(row: Sequence[Any], known: dict[str, Any]) -> PolicyRecord:
    _check(row, _POLICY_TYPES, "policies")
    values = dict(zip(policies.columns.keys(), row, strict=True))
    name = f"policy-{values['id']}"
    extra = _stored(dict, values["metadata"], name, known)
    return PolicyRecord(**values | {"id": name, "run": f"run-{values['run']}", "metadata": extra})


def _check(row: Sequence[Any], types: list[tuple[type, ...]], table: str) -> None:
    if not all(map(isinstance, row, types)):
        raise IntegrityError(f"row {row[0]!r} of {table} in the index is damaged", _REPAIR)


def _stored(kind: type, text: str, name: str, known: dict[str, Any]) -> Any:
    if text not in known:
        known[text] = from_json(text, f"{name} in the index")
    if not isinstance(known[text], kind):
        raise IntegrityError(f"{name} in the index is damaged", _REPAIR)
    return known[text]
