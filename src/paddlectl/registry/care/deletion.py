"""`registry delete`: runs with their policies, and nothing that another run builds on.

A run's policy goes with it. What goes is written down before the transaction of its rows is committed
(`tombstones`), so that whatever stops it, `gc`, `repair` or the next deletion ends it, or nothing is deleted.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from sqlalchemy import Connection, delete, select

from paddlectl.errors import RegistryBusyError, UsageError
from paddlectl.registry.care import tombstones
from paddlectl.registry.files import layout
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.files.runfiles import goes_on
from paddlectl.registry.index.index import Index
from paddlectl.registry.index.queries import find_policy, find_run
from paddlectl.registry.names import number_of
from paddlectl.registry.records import RunRecord
from paddlectl.registry.schema import policies, run_records, runs, select_runs

NAMED = 5


def chosen_runs(
    location: str | Path, names: Iterable[str], *, with_dependants: bool = False
) -> list[RunRecord]:
    """The runs that would be deleted, oldest first.

    Args:
        location: The registry.
        names: Ids of runs, or of policies, each of which stands for its run.
        with_dependants: Whether runs that reuse what these learned are deleted, too, and so on.

    Raises:
        NotFoundError: If there is no such run or policy.
        UsageError: If other runs build on them, and `with_dependants` isn't asked for.
    """
    with Index(location).open(create=False).reading() as connection:
        asked = {_run_of(connection, name) for name in names}
        every = _with_dependants(connection, asked)
        found = run_records(connection.execute(select_runs().where(runs.c.id.in_(every)).order_by(runs.c.id)))
    building = [run for run in found if number_of(run.id, "run") not in asked]
    if building and not with_dependants:
        shown = ", ".join(run.id for run in building[:NAMED])
        more = f" and {len(building) - NAMED:,} more" if len(building) > NAMED else ""
        raise UsageError(
            f"{shown}{more} reused what was learned there",
            "keep it, or delete those as well: --with-dependants",
        )
    return found


def remove(location: str | Path, chosen: Sequence[RunRecord]) -> int:
    """Deletes these runs with their policies and files; gives the bytes that are free by it.

    Raises:
        RegistryBusyError: If one of them goes on, or another run has come to build on them meanwhile.
    """
    numbers = {int(run.id.partition("-")[2]) for run in chosen}
    index = Index(location).open(create=False)
    with index.writing() as connection, disk_faults(index.shown):
        if _with_dependants(connection, numbers) != numbers:
            raise RegistryBusyError("a run that builds on these has begun", "run the same command again")
        for run in chosen:
            _require_still(connection, index.folder, run.id)
        own = connection.execute(
            select(policies.c.id, policies.c.checkpoint).where(policies.c.run.in_(numbers))
        ).all()
        names = [*(f"policy-{row.id}" for row in own), *(run.id for run in chosen)]
        tombstones.begin(index.folder, names, {row.checkpoint for row in own})
        connection.execute(delete(policies).where(policies.c.run.in_(numbers)))
        connection.execute(delete(runs).where(runs.c.id.in_(numbers)))
    with disk_faults(index.shown):
        return sum(size for _, size in tombstones.finish(index))


def _require_still(connection: Connection, folder: Path, run: str) -> None:
    """Refuses a run that goes on. None begins to in this transaction: a run begins by one of its own.

    Raises:
        RegistryBusyError: If it does.
    """
    status = connection.scalar(select(runs.c.status).where(runs.c.id == number_of(run, "run")))
    if goes_on(folder, run) if status == "running" else layout.is_held(folder / "runs" / run):
        raise RegistryBusyError(f"{run} goes on in another process", "wait for it, or stop that process")


def _run_of(connection: Connection, name: str) -> int:
    number = number_of(name, "policy")
    run = find_policy(connection, number).run if number else find_run(connection, name).id
    return int(run.partition("-")[2])


def _with_dependants(connection: Connection, numbers: Iterable[int]) -> set[int]:
    """Runs, those that reuse their policies, those that reuse theirs, and so on."""
    owner = {f"policy-{row.id}": row.run for row in connection.execute(select(policies.c.id, policies.c.run))}
    reusing = connection.execute(select(runs.c.id, runs.c.sources).where(runs.c.sources != "[]")).all()
    taught = {row.id: {owner.get(source) for source in json.loads(row.sources)} for row in reusing}
    every: set[int] = set()
    new = set(numbers)
    while new:
        every |= new
        new = {run for run, teachers in taught.items() if teachers & new} - every
    return every
