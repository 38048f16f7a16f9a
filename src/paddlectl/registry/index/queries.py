"""Rows of the index, chosen by the database, and what to say of one that isn't there."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, Table, case, func, or_, select

from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.files.documents import from_json
from paddlectl.registry.names import LATEST, is_id, nearest, number_of, shown
from paddlectl.registry.records import (
    DEFINITION,
    Content,
    Methods,
    PolicyRecord,
    RunRecord,
    StoredProgram,
    content_of,
)
from paddlectl.registry.schema import ROW_TABLES, policies, policy_record, run_records, runs, select_runs

_READ = 1_000  # rows at a time, where all are read
_LISTED = 200
"""Newest ids among which that is looked for which may have been meant."""


def rows_of(connection: Connection) -> dict[str, dict[str, Any]]:
    """All rows, column by column, by the name of the run or policy."""
    found: dict[str, dict[str, Any]] = {}
    for kind, table in ROW_TABLES.items():
        columns = table.columns.keys()
        for row in connection.execute(select(table)):
            found[f"{kind}-{row[0]}"] = dict(zip(columns, row, strict=True))
    return found


def count(connection: Connection, table: Table, *chosen: ColumnElement[bool]) -> int:
    """How many rows the table has, or so many as are chosen."""
    return int(connection.scalar(select(func.count()).select_from(table).where(*chosen)) or 0)


def find_run(connection: Connection, name: str) -> RunRecord:
    """The run of an id, or of a name that a user gave it, or the newest for `latest`.

    Raises:
        NotFoundError: If there is none; with the nearest id or name.
    """
    number = number_of(name, "run")
    if name == LATEST:
        number = connection.scalar(select(func.max(runs.c.id)))
    own = runs.c.id == number if number else runs.c.name == name
    row = connection.execute(select_runs().where(own)).first() if name.isprintable() else None
    if row is None:
        if number := number_of(name, "policy"):
            its = connection.scalar(select(policies.c.run).where(policies.c.id == number))
            if its is not None:
                raise NotFoundError(f"{name} is a policy; run-{its} learned it", "run: paddlectl runs")
        known = [*_like(connection, runs, "run", name), *run_names(connection, name)]
        raise NotFoundError(f"no run {shown(name)}", nearest(name, known) + "run: paddlectl runs")
    return run_records([row])[0]


def run_names(connection: Connection, like: str) -> list[str]:
    """What users called runs: the newest, and such as differ from `like` only in the case of letters."""
    same = runs.c.name.in_([]) if not like.isprintable() else func.lower(runs.c.name) == like.lower()
    newest = select(runs.c.name).where(runs.c.name.is_not(None)).order_by(runs.c.id.desc()).limit(_LISTED)
    return [
        *map(str, connection.scalars(newest)),
        *map(str, connection.scalars(select(runs.c.name).where(same))),
    ]


def find_policy(connection: Connection, number: int) -> PolicyRecord:
    """The policy of a number.

    Raises:
        NotFoundError: If there is none; with the nearest id.
    """
    row = connection.execute(select(policies).where(policies.c.id == number)).first()
    if row is None:
        name = f"policy-{number}"
        known = _like(connection, policies, "policy", name)
        raise NotFoundError(f"no policy {name}", nearest(name, known) + "run: paddlectl policies")
    return policy_record(row)


def _like(connection: Connection, table: Table, kind: str, name: str) -> list[str]:
    """Ids that may have been meant: those with the same digits, and the newest."""
    digits = "".join(re.findall(r"[0-9]", name))[:18]
    meant = [int(digits[:length]) for length in range(1, len(digits) + 1)]
    newest = connection.scalar(select(func.max(table.c.id))) or 0
    chosen = or_(table.c.id.in_(meant), table.c.id > newest - _LISTED)
    return [f"{kind}-{number}" for number in connection.scalars(select(table.c.id).where(chosen))]


def best_policy(
    connection: Connection, task: str | Content, methods: Methods = None, *, clauses: bool = False
) -> PolicyRecord:
    """The best policy of a task: by success rate, then by mean score, then the newest.

    A name is of the task that needs no definition, if that has a policy.

    Raises:
        NotFoundError: If there is none; with the nearest name.
        UsageError: If policies of that name solve several tasks, each defined in a file.
    """
    name = task if isinstance(task, str) else task.name
    row = None
    if name.isprintable():  # others can't even be asked for
        found = _best_first(methods).where(policies.c.task == name).limit(1)
        if clauses:
            found = found.where(policies.c.program.is_not(None))
        row = connection.execute(_of(connection, task, found)).first()
    if row is None:
        by = f" by {_named(methods)[0]}" if methods else ""
        raise NotFoundError(f"no policy for {shown(name)}{by}", _way_to_policy(connection, name, methods))
    return policy_record(row)


def best_of_each(
    connection: Connection, domain: str, methods: Methods = None
) -> dict[str, tuple[Content, int]]:
    """The tasks of a domain that have policies, by identity, each with the number of its best one."""
    c = policies.c
    rows = _best_first(methods).with_only_columns(c.task, c.id, _KEPT).where(c.domain == domain)
    found: dict[str, tuple[Content, int]] = {}
    for task, number, kept in connection.execute(rows):
        content = _content(task, kept, number)
        found.setdefault(content.identity, (content, number))
    return dict(sorted(found.items()))


def programs(connection: Connection, domain: str, methods: Methods) -> Iterator[StoredProgram]:
    """Those of a domain's policies by these methods, oldest first; read as they are asked for."""
    c = policies.c
    rows = (
        select(c.id, c.task, _KEPT, c.program, c.success_rate, c.mean_score)
        .where(c.domain == domain, *learned_by(methods), c.program.is_not(None))
        .order_by(c.id)
        .execution_options(yield_per=_READ)
    )
    for number, task, kept, *rest in connection.execute(rows):
        yield StoredProgram(f"policy-{number}", _content(task, kept, number), *rest)


def learned_by(methods: Methods) -> list[ColumnElement[bool]]:
    """What policies must meet that were learned by one of the methods; nothing if any will do."""
    return [] if methods is None else [policies.c.method.in_(_named(methods))]


def _named(methods: str | tuple[str, ...]) -> tuple[str, ...]:
    return (methods,) if isinstance(methods, str) else methods


def _best_first(methods: Methods) -> Select[Any]:
    c = policies.c
    found = select(policies).order_by(c.success_rate.desc(), c.mean_score.desc(), c.id.desc())
    return found.where(*learned_by(methods))


_KEPT = case((policies.c.metadata.contains(f'"{DEFINITION}"'), policies.c.metadata))
"""Metadata where there may be a definition in it."""


def _content(task: str, kept: str | None, number: int) -> Content:
    return Content(task) if kept is None else content_of(task, from_json(kept, f"policy-{number}"))


def _of(connection: Connection, task: str | Content, found: Select[Any]) -> Select[Any]:
    """Those of the policies found, all of one name, that solve the task."""
    name = task if isinstance(task, str) else task.name
    c = policies.c
    kept = select(c.id, _KEPT).where(c.task == name, _KEPT.is_not(None)).order_by(c.id)
    defined = {
        number: content.identity
        for number, text in connection.execute(kept)
        if (content := _content(name, text, number)).definition is not None
    }
    if isinstance(task, Content) and task.definition is not None:
        return found.where(c.id.in_([n for n, identity in defined.items() if identity == task.identity]))
    if not defined:
        return found
    others = found.where(c.id.not_in(list(defined)))
    if isinstance(task, Content) or connection.execute(others).first() is not None:
        return others
    _require_one(name, defined)
    return found


def _require_one(name: str, defined: Mapping[int, str]) -> None:
    first = {identity: number for number, identity in sorted(defined.items(), reverse=True)}
    if len(first) > 1:
        ids = [f"policy-{number}" for number in sorted(first.values())]
        raise UsageError(
            f"{shown(name)} is the name of {len(first)} tasks here: {_listed(ids)} solve one each",
            "name a policy, or the task's file",
        )


def _listed(ids: Sequence[str]) -> str:
    return ", ".join(ids[:5]) + (f" and {len(ids) - 5} more" if len(ids) > 5 else "")


def _way_to_policy(connection: Connection, task: str, methods: Methods) -> str:
    tasks = select(policies.c.task).distinct().where(*learned_by(methods))
    solved = [str(name) for name in connection.scalars(tasks)]
    # A high bar: many tasks have names that are alike, and this one may only lack a policy.
    near = nearest(task, solved, 0.85)
    return f"{near}run: paddlectl policies" if near or is_id(task) else f"run: paddlectl train {shown(task)}"


def next_step(run: RunRecord) -> str:
    """A hint: the command that shows what a run learned, or that lets it go on."""
    if run.kind == "transfer":
        return f"run: paddlectl explain {run.id}"
    if run.policy:
        without_program = run.results.get("crispness", 1.0) is None
        return f"run: paddlectl {'evaluate' if without_program else 'show'} {run.policy}"
    stopped = run.status in ("interrupted", "failed") and run.method != "random"
    return f"run: paddlectl resume {run.id}" if stopped else "run: paddlectl runs"


def same_runs(
    connection: Connection, run: Mapping[str, Any], policy: Mapping[str, Any] | None
) -> Iterator[dict[str, Any]]:
    """`{run, policy}` of every run that is the same as this one, with its policy if that is the same too."""
    same = [runs.c[name] == run[name] for name in ("created", "task", "method", "seed")]
    for number in connection.scalars(select(runs.c.id).where(*same)).all():
        if policy is None:
            yield {"run": f"run-{number}", "policy": None}
            continue
        wanted = [policies.c[name] == policy[name] for name in ("checkpoint", "created", "program")]
        found = connection.scalar(select(policies.c.id).where(policies.c.run == number, *wanted))
        if found is not None:
            yield {"run": f"run-{number}", "policy": f"policy-{found}"}
