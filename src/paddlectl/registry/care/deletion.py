"""`registry delete`: runs with their policies, and nothing that another run builds on.

A run's policy goes with it. Rows and manifests go in one transaction, so that an index made again from
manifests doesn't have them either; then the files that nobody needs any more.
"""

import json
import shutil
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

from sqlalchemy import Connection, delete, select

from paddlectl.errors import RegistryBusyError, UsageError
from paddlectl.registry.files import manifests
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.files.objects import object_path
from paddlectl.registry.files.runfiles import RunFiles
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
            f"{shown}{more} built on what shall go", "keep it, or delete those as well: --with-dependants"
        )
    return found


def remove(location: str | Path, chosen: Sequence[RunRecord]) -> int:
    """Deletes these runs with their policies and files; gives the bytes that are free by it.

    Raises:
        RegistryBusyError: If one of them goes on, or another run has come to build on them meanwhile.
    """
    numbers = {int(run.id.partition("-")[2]) for run in chosen}
    index = Index(location).open(create=False)
    folder, files = index.folder, RunFiles(index.folder, index.shown)
    with ExitStack() as held:
        for run in chosen:
            if (folder / "runs" / run.id).is_dir():
                held.enter_context(files.hold(run.id))
        with index.writing() as connection:
            if _with_dependants(connection, numbers) != numbers:
                raise RegistryBusyError("a run that builds on these has begun", "run the same command again")
            own = connection.execute(
                select(policies.c.id, policies.c.checkpoint).where(policies.c.run.in_(numbers))
            ).all()
            gone = [*(f"policy-{row.id}" for row in own), *(run.id for run in chosen)]
            connection.execute(delete(policies).where(policies.c.run.in_(numbers)))
            connection.execute(delete(runs).where(runs.c.id.in_(numbers)))
            with disk_faults(index.shown):
                freed = sum(_unlinked(manifests.path_of(folder, name)) for name in gone)
        with index.writing() as connection, disk_faults(index.shown):
            needed = set(connection.scalars(select(policies.c.checkpoint)))
            for checkpoint in {row.checkpoint for row in own} - needed:
                freed += _unlinked(object_path(folder / "objects", checkpoint))
        with disk_faults(index.shown):
            return freed + sum(_removed(folder / "runs" / run.id) for run in chosen)


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


def _unlinked(path: Path) -> int:
    """The bytes of a file that was there."""
    try:
        size = path.lstat().st_size
        path.unlink()
    except FileNotFoundError:
        return 0
    return size


def _removed(folder: Path) -> int:
    """The bytes of a folder that was there."""
    size = sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())
    shutil.rmtree(folder, ignore_errors=not folder.exists())
    return size
