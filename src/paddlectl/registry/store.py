"""The registry: what was trained, with its programs, checkpoints and figures, in one folder."""

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Connection, Engine, insert, select, update

from paddlectl.errors import IntegrityError, NotFoundError, PaddlectlError, UsageError
from paddlectl.registry import database, documents, objects
from paddlectl.registry.faults import faults
from paddlectl.registry.records import RUN_STATES, PolicyRecord, RunRecord
from paddlectl.registry.schema import REVISIONS, policies, policy_record, run_records, runs, select_runs

_ID = re.compile(r"(run|policy)-([1-9][0-9]{0,17})")
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_LARGEST = 2**63 - 1


class Registry:
    """A folder with `registry.db`, `objects/<sha256>.safetensors` and `runs/<run>/`.

    It holds no open file between calls, so it may be kept, closed, forked or dropped at any time. Processes
    share a registry by its location. Faults of disk and database come out of every method as PaddlectlError:
    RegistryBusyError after 60 s of waiting, IntegrityError for damage, SchemaVersionError for a registry
    that another version took over.

    Attributes:
        location: The folder, as it was given.
    """

    location: str

    def __init__(self, folder: Path) -> None:
        self.location = str(folder)
        self._folder = folder
        path = database.database_path(folder)
        self._reading, self._writing = database.reading(path), database.writing(path)

    @classmethod
    def open(cls, location: str | Path, *, create: bool = True) -> "Registry":
        """Opens a registry; makes it, or brings an older one up to date, where needed.

        Args:
            location: A folder, or `sqlite:///` and a folder.
            create: Whether to make a registry where there is none.

        Raises:
            NotFoundError: If there is none and none shall be made.
            SchemaVersionError: If a newer paddlectl wrote it; nothing is touched then.
            IntegrityError: If it is damaged.
        """
        folder = _folder(location)
        with faults(str(folder)):
            if not database.database_path(folder).exists():
                if not create:
                    raise NotFoundError(f"no registry at {folder}", "run: paddlectl train BoxDoor")
                database.create(folder)
            registry = cls(folder)
            with registry._reading.begin() as connection:
                found = database.stamp(connection)
            if found in REVISIONS[:-1]:
                database.upgrade(folder)
        with registry._transaction(registry._reading):
            return registry

    def close(self) -> None:
        """Ends the use of the registry."""
        self._reading.dispose()
        self._writing.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # Runs

    def add_run(
        self,
        *,
        kind: str,
        method: str,
        task: str,
        scenario: str | None,
        sources: Sequence[str],
        seed: int,
        settings: Mapping[str, Any],
        versions: Mapping[str, str],
    ) -> RunRecord:
        """Opens a run, `running` from now on, and its folder."""
        row = {
            "kind": kind,
            "method": method,
            "task": task,
            "scenario": scenario,
            "sources": documents.to_json(list(sources), "sources"),
            "seed": _integer(seed, "seed"),
            "status": "running",
            "settings": documents.to_json(dict(settings), "settings"),
            "versions": documents.to_json(dict(versions), "versions"),
            "frames": 0,
            "episodes": 0,
            "seconds": 0.0,
            "results": "{}",
            "created": _now(),
        }
        with self._transaction(self._writing) as connection:
            number = _inserted(connection.execute(insert(runs).values(row)).inserted_primary_key)
            self._make_run_folder(f"run-{number}")
            return _find_run(connection, f"run-{number}")

    def finish_run(
        self, run: str, *, status: str, frames: int, episodes: int, seconds: float, results: Mapping[str, Any]
    ) -> RunRecord:
        """Tells how a run ended; its rows and documents are on the disk before that.

        Raises:
            NotFoundError: If there is no such run.
        """
        if status not in RUN_STATES[1:]:
            raise ValueError(f"a run doesn't end as {status!r}")
        row = {
            "status": status,
            "frames": _integer(frames, "frames"),
            "episodes": _integer(episodes, "episodes"),
            "seconds": _finite(seconds, "seconds"),
            "results": documents.to_json(dict(results), "results"),
            "finished": _now(),
        }
        with self._transaction(self._writing) as connection:
            number = int(_find_run(connection, run).id.removeprefix("run-"))
            documents.sync_files(self._run_folder(run))
            connection.execute(update(runs).where(runs.c.id == number).values(row))
            return _find_run(connection, run)

    def run(self, run: str) -> RunRecord:
        """The run of an id such as `run-42`.

        Raises:
            NotFoundError: If there is none; with the nearest id.
        """
        with self._transaction(self._reading) as connection:
            return _find_run(connection, run)

    def runs(self) -> list[RunRecord]:
        """All runs, newest first."""
        with self._transaction(self._reading) as connection:
            return run_records(connection.execute(select_runs().order_by(runs.c.id.desc())))

    # Policies

    def add_policy(
        self,
        *,
        run: str,
        task: str,
        domain: str,
        method: str,
        seed: int,
        frames: int,
        program: str,
        checkpoint: bytes,
        success_rate: float,
        mean_score: float,
        mean_length: float,
        crispness: float,
        metadata: Mapping[str, Any],
    ) -> PolicyRecord:
        """Stores a policy: its checkpoint first, then all else in one transaction.

        `checkpoint` is the bytes of a safetensors file; the rest is as in PolicyRecord.

        Raises:
            NotFoundError: If there is no such run.
        """
        row = {
            "task": task,
            "domain": domain,
            "method": method,
            "seed": _integer(seed, "seed"),
            "frames": _integer(frames, "frames"),
            "program": program,
            "success_rate": _finite(success_rate, "success_rate"),
            "mean_score": _finite(mean_score, "mean_score"),
            "mean_length": _finite(mean_length, "mean_length"),
            "crispness": _finite(crispness, "crispness"),
            "created": _now(),
            "metadata": documents.to_json(dict(metadata), "metadata"),
        }
        with self._transaction(self._reading) as connection:
            number = int(_find_run(connection, run).id.removeprefix("run-"))
        with faults(self.location):
            digest = objects.publish(self._folder / "objects", checkpoint)
        with self._transaction(self._writing) as connection:
            statement = insert(policies).values(row | {"run": number, "checkpoint": digest})
            return _find_policy(connection, _inserted(connection.execute(statement).inserted_primary_key))

    def policy(self, name: str) -> PolicyRecord:
        """The policy of an id such as `policy-7`, or the best one of a task.

        The best has the highest success rate, then the highest mean score, then it is the newest.

        Raises:
            NotFoundError: If there is none; with the nearest name.
        """
        with self._transaction(self._reading) as connection:
            number = _number(name, "policy")
            if number is not None:
                return _find_policy(connection, number)
            return _best_policy(connection, name)

    def policies(self) -> list[PolicyRecord]:
        """All policies, newest first."""
        with self._transaction(self._reading) as connection:
            newest_first = select(policies).order_by(policies.c.id.desc())
            return [policy_record(row) for row in connection.execute(newest_first)]

    def read_checkpoint(self, policy: PolicyRecord) -> bytes:
        """The policy's safetensors bytes, verified.

        Raises:
            IntegrityError: If they are missing or aren't what was stored.
        """
        with faults(self.location):
            hint = f"train it again: paddlectl train {policy.task}"
            return objects.read(self._folder / "objects", policy.checkpoint, policy.id, hint)

    # The run's folder

    def append_rows(self, run: str, name: str, rows: Iterable[Mapping[str, Any]]) -> None:
        """Adds rows to the run's `<name>.jsonl`."""
        with faults(self.location):
            documents.append_rows(self._run_folder(run), name, rows)

    def read_rows(self, run: str, name: str) -> list[dict[str, Any]]:
        """The rows of the run's `<name>.jsonl`; empty if there is none."""
        with faults(self.location):
            return documents.read_rows(self._run_folder(run), name)

    def write_document(self, run: str, name: str, document: Any) -> None:
        """Writes or replaces the run's `<name>.json` whole."""
        with faults(self.location):
            documents.write_document(self._run_folder(run), name, document)

    def read_document(self, run: str, name: str) -> Any | None:
        """The value of the run's `<name>.json`; None if there is none."""
        with faults(self.location):
            return documents.read_document(self._run_folder(run), name)

    def _run_folder(self, run: str) -> Path:
        if _number(run, "run") is None or not (self._folder / "runs" / run).is_dir():
            raise NotFoundError(f"no folder of a run {_shown(run)}", "run: paddlectl runs")
        return self._folder / "runs" / run

    def _make_run_folder(self, run: str) -> None:
        folder = self._folder / "runs" / run
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise IntegrityError(
                f"{folder} is there, but registry.db doesn't know it: is that an older copy?",
                "move that folder aside",
            )
        objects.sync_folder(folder.parent)

    @contextmanager
    def _transaction(self, engine: Engine) -> Iterator[Connection]:
        with faults(self.location), engine.begin() as connection:
            database.require_current(connection)
            yield connection


def _folder(location: str | Path) -> Path:
    text = str(location).removeprefix("sqlite:///")
    if address := _ADDRESS.match(text):
        raise UsageError(f"a registry can't be at a {address[1]} address", "give a folder")
    if not text or "\0" in text:
        raise UsageError("that is no place for a registry", "give a folder")
    return Path(text)


def _find_run(connection: Connection, name: str) -> RunRecord:
    number = _number(name, "run")
    row = connection.execute(select_runs().where(runs.c.id == number)).first() if number else None
    if row is None:
        known = [f"run-{i}" for i in connection.scalars(select(runs.c.id))]
        raise NotFoundError(f"no run {_shown(name)}", _nearest(name, known) + "run: paddlectl runs")
    return run_records([row])[0]


def _find_policy(connection: Connection, number: int) -> PolicyRecord:
    row = connection.execute(select(policies).where(policies.c.id == number)).first()
    if row is None:
        name, known = f"policy-{number}", [f"policy-{i}" for i in connection.scalars(select(policies.c.id))]
        raise NotFoundError(f"no policy {name}", _nearest(name, known) + "run: paddlectl policies")
    return policy_record(row)


def _best_policy(connection: Connection, task: str) -> PolicyRecord:
    c = policies.c
    best_first = (c.success_rate.desc(), c.mean_score.desc(), c.id.desc())
    row = connection.execute(select(policies).where(c.task == task).order_by(*best_first).limit(1)).first()
    if row is None:
        raise NotFoundError(f"no policy for {_shown(task)}", _way_to_policy(connection, task))
    return policy_record(row)


def _way_to_policy(connection: Connection, task: str) -> str:
    solved = [str(name) for name in connection.scalars(select(policies.c.task).distinct())]
    # A high bar: many tasks have names that are alike, and this one may only lack a policy.
    near = _nearest(task, solved, 0.85)
    return (
        f"{near}run: paddlectl policies"
        if near or _ID.fullmatch(task)
        else f"run: paddlectl train {_shown(task)}"
    )


def _nearest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str:
    folded = {text.casefold(): text for text in known}
    near = difflib.get_close_matches(name[:80].casefold(), folded, n=1, cutoff=cutoff)
    return f"did you mean {folded[near[0]]}? or " if near else ""


def _number(name: str, kind: str) -> int | None:
    found = _ID.fullmatch(name)
    return int(found[2]) if found and found[1] == kind else None


def _shown(name: str) -> str:
    return name if name.isprintable() and len(name) <= 80 else repr(name[:80])


def _inserted(key: Sequence[Any] | None) -> int:
    assert key is not None
    return int(key[0])


def _finite(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise PaddlectlError(f"{what} can't be stored: {value} is no finite number")
    return float(value)


def _integer(value: int, what: str) -> int:
    if abs(value) > _LARGEST:
        raise UsageError(f"{what} is too large: {value}", f"at most {_LARGEST}")
    return int(value)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
