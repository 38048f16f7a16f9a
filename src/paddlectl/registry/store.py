"""The registry: what was trained, with its programs, checkpoints and figures, in one folder."""

import json
import statistics
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Literal, Self

from sqlalchemy import ColumnElement, String, Table, cast, func, literal, null, or_, select, update

from paddlectl.errors import UsageError
from paddlectl.registry import fields
from paddlectl.registry.files import documents, layout, objects
from paddlectl.registry.files.faults import disk_faults
from paddlectl.registry.files.runfiles import RunFiles
from paddlectl.registry.index import labels
from paddlectl.registry.index.entry import enter, publish
from paddlectl.registry.index.index import Index
from paddlectl.registry.index.queries import (
    best_of_each,
    best_policy,
    count,
    find_policy,
    find_run,
    learned_by,
    next_step,
    programs,
    run_names,
)
from paddlectl.registry.names import ELSEWHERE, number_of
from paddlectl.registry.records import (
    RUN_STATES,
    Content,
    Label,
    Methods,
    PolicyRecord,
    RunRecord,
    StoredProgram,
    content_of,
)
from paddlectl.registry.schema import policies, policy_records, run_records, runs, select_runs

Which = Literal["policies", "programs", "runs", "transfers", "ended", "stopped"]
NOTHING: Mapping[str, str] = MappingProxyType({})


class Registry:
    """A folder with `registry.db`, `identity`, `manifests/`, `objects/<sha256>.safetensors`, `runs/<run>/`.

    It holds no open file between calls, so it may be kept, closed, forked or dropped at any time. Processes
    share a registry by its location. Faults of disk and database come out of every method as PaddlectlError:
    RegistryBusyError after 60 s of waiting, IntegrityError for damage, SchemaVersionError for a registry
    that another version took over.

    Attributes:
        location: The folder or address, as it was given.
        shown: The same for messages, without a password.
        folder: Where its files are.
        index: The rows.
        files: The tables, documents and checkpoints of its runs.
    """

    def __init__(self, location: str | Path) -> None:
        self.location = str(location).removeprefix("sqlite:///")
        self.index = Index(location)
        self.shown, self.folder = self.index.shown, self.index.folder
        self.files = RunFiles(self.folder, self.shown)

    @classmethod
    def open(cls, location: str | Path, *, create: bool = True) -> "Registry":
        """Opens a registry; makes it, or brings an older one up to date, where needed.

        Args:
            location: A folder, `sqlite:///` and a folder, or `postgresql://…?files=` and a folder.
            create: Whether to make a registry where there is none.

        Raises:
            NotFoundError: If there is none and none shall be made.
            SchemaVersionError: If a newer paddlectl wrote it; nothing is touched then.
            IntegrityError: If it is damaged, or its folder isn't its own.
        """
        registry = cls(location)
        registry.index.open(create=create)
        return registry

    def close(self) -> None:
        """Ends the use of the registry."""
        self.index.close()

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
        name: str | None = None,
        tags: Sequence[str] = (),
    ) -> RunRecord:
        """Opens a run, `running` from now on, and its folder.

        Raises:
            UsageError: If a value isn't one that its field may hold (`fields`), another run or a task has
                the name, or a run the task's.
        """
        row: dict[str, Any] = {
            "kind": kind,
            "method": method,
            "task": task,
            "scenario": scenario,
            "sources": list(sources),
            "seed": int(seed),
            "settings": dict(settings),
            "versions": dict(versions),
        }
        _require(row, fields.RUN, "the run")
        row |= {name: documents.to_json(row[name], name) for name in ("sources", "settings", "versions")}
        row |= {"status": "running", "frames": 0, "episodes": 0, "seconds": 0.0, "results": "{}"}
        row |= {"created": _now(), **labels.row_of(name, tags)}
        with self.index.writing() as connection:
            labels.require_free(connection, name, [task])
            run = f"run-{enter(self.index.database, connection, 'run', row)}"
            layout.make_run(self.folder, run)
            publish(self.folder, connection, run)
            return find_run(connection, run)

    def require_free(self, name: str | None, tasks: Collection[str]) -> None:
        """Refuses a new run's name that a run or task has, and tasks whose names runs have.

        Raises:
            UsageError: If it is one, or one of them is a run's name.
        """
        with self.index.reading() as connection:
            labels.require_free(connection, name, tasks)

    def label_runs(
        self,
        named: Sequence[str],
        *,
        name: str | None = None,
        tags: Sequence[str] = (),
        untagged: Sequence[str] = (),
    ) -> list[RunRecord]:
        """Changes what runs are called, of all or of none; their files stay as they were sealed.

        Args:
            named: Runs, by id or name.
            name: What the one run shall be called; empty for nothing, None for what it is called.
            tags: To add.
            untagged: To take off.

        Raises:
            NotFoundError: If there is no such run.
            UsageError: If one can't be a label, or another run or a task has the name.
        """
        with self.index.writing() as connection:
            changed = labels.change(self.folder, connection, named, name, tags, untagged)
            return [find_run(connection, run) for run in changed]

    def finish_run(
        self, run: str, *, status: str, frames: int, episodes: int, seconds: float, results: Mapping[str, Any]
    ) -> RunRecord:
        """Tells how a run ended; its rows and documents are on the disk before that.

        Raises:
            NotFoundError: If there is no such run.
            UsageError: If a value isn't one that its field may hold.
        """
        if status not in RUN_STATES[1:]:
            raise ValueError(f"a run doesn't end as {status!r}")
        row: dict[str, Any] = {
            "status": status,
            "frames": int(frames),
            "episodes": int(episodes),
            "seconds": _unsigned(seconds),
            "finished": _now(),
        }
        _require(row, fields.RUN, run)
        row["results"] = documents.to_json(dict(results), "results")
        with self.index.writing() as connection:
            number = number_of(find_run(connection, run).id, "run")
            self.files.sync(run)
            connection.execute(update(runs).where(runs.c.id == number).values(row))
            publish(self.folder, connection, run)
            return find_run(connection, run)

    def resume_run(self, run: str) -> RunRecord:
        """Marks a run that had stopped as `running` again; its process holds it meanwhile (`files.hold`).

        Raises:
            NotFoundError: If there is no such run.
            UsageError: If it is finished.
        """
        with self.index.writing() as connection:
            found = find_run(connection, run)
            if found.status == "finished":
                raise UsageError(f"{run} is finished", next_step(found))
            again = {"status": "running", "finished": None, "resumes": found.resumes + 1}
            connection.execute(update(runs).where(runs.c.id == number_of(run, "run")).values(again))
            publish(self.folder, connection, run)
            return find_run(connection, run)

    def run(self, run: str) -> RunRecord:
        """The run of an id such as `run-42`, or of a name that its user gave it, or the newest for `latest`.

        Raises:
            NotFoundError: If there is none; with the nearest id.
        """
        with self.index.reading() as connection:
            return find_run(connection, run)

    def so_far(self, run: RunRecord) -> RunRecord:
        """The run; one that goes on with what the latest line of its log counts."""
        if run.status != "running":
            return run
        latest = next(iter(self.files.read_rows(run.id, "progress")[-1:]), {})
        frames, episodes = (
            max(done, latest[name]) if type(latest.get(name)) is int else done
            for name, done in (("frames", run.frames), ("episodes", run.episodes))
        )
        return replace(run, frames=frames, episodes=episodes)

    def run_called(self, name: str) -> RunRecord | None:
        """The run that its user gave this name, if there is one."""
        chosen = select_runs().where(runs.c.name == name)
        with self.index.reading() as connection:
            found = run_records(connection.execute(chosen)) if name.isprintable() else []
            return found[0] if found else None

    def run_names(self, like: str) -> list[str]:
        """Names of runs that may have been meant by `like`."""
        with self.index.reading() as connection:
            return run_names(connection, like)

    def runs(self) -> list[RunRecord]:
        """All runs, newest first."""
        return self.newest_runs()[0]

    def newest_runs(
        self, most: int | None = None, wanted: Mapping[str, str] = NOTHING, since: str = ""
    ) -> tuple[list[RunRecord], int]:
        """At most so many runs, newest first, and how many there are in all.

        Args:
            most: All of them if None.
            wanted: Column -> what it has to hold; `tag` -> one of its tags.
            since: Runs that began earlier are left out; in UTC, as `created` is written.
        """
        chosen = [*_equal(runs, wanted), *([runs.c.created >= since] if since else [])]
        with self.index.reading() as connection:
            newest_first = select_runs().where(*chosen).order_by(runs.c.id.desc()).limit(most)
            return run_records(connection.execute(newest_first)), count(connection, runs, *chosen)

    def stopped_runs(self) -> list[RunRecord]:
        """Runs that were stopped and that no process goes on with, oldest first; not those that failed."""
        free = {run.id for run in self._unfinished_runs() if not self.files.goes_on(run.id)}
        # Another process may have finished one before it was looked at, or resumed one since.
        return [run for run in self._unfinished_runs() if run.id in free and not self.files.goes_on(run.id)]

    def _unfinished_runs(self) -> list[RunRecord]:
        with self.index.reading() as connection:
            left = select_runs().where(runs.c.status.in_(("running", "interrupted")))
            return run_records(connection.execute(left.order_by(runs.c.id)))

    def newest_transfer(self) -> RunRecord | None:
        """The newest run that is a transfer, if there is one."""
        with self.index.reading() as connection:
            transfers = select_runs().where(runs.c.kind == "transfer")
            found = run_records(connection.execute(transfers.order_by(runs.c.id.desc()).limit(1)))
            return found[0] if found else None

    def scenarios(self) -> list[str]:
        """The scenarios that have finished transfers, by name."""
        c = runs.c
        names = select(c.scenario).distinct().where(c.scenario.is_not(None), c.status == "finished")
        with self.index.reading() as connection:
            return [str(name) for name in connection.scalars(names.order_by(c.scenario))]

    def seconds_per_frame(self, kind: str, method: str, task: str) -> float | None:
        """How long the latest finished runs of that sort took, by the median; None if there are none."""
        alike = [runs.c.kind == kind, runs.c.method == method, runs.c.task == task]
        done = [runs.c.status == "finished", runs.c.frames > 0]
        latest = (
            select(runs.c.seconds, runs.c.frames).where(*alike, *done).order_by(runs.c.id.desc()).limit(9)
        )
        with self.index.reading() as connection:
            took = [seconds / frames for seconds, frames in connection.execute(latest)]
        return statistics.median(took) if took else None

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
        program: str | None,
        checkpoint: bytes,
        success_rate: float,
        mean_score: float,
        mean_length: float,
        crispness: float | None,
        metadata: Mapping[str, Any],
    ) -> PolicyRecord:
        """Stores a policy: its checkpoint first, then all else in one transaction.

        `checkpoint` is the bytes of a safetensors file; the rest is as in PolicyRecord.

        Raises:
            NotFoundError: If there is no such run.
            UsageError: If a value isn't one that its field may hold.
        """
        row: dict[str, Any] = {
            "task": task,
            "domain": domain,
            "method": method,
            "seed": int(seed),
            "frames": int(frames),
            "success_rate": _unsigned(success_rate),
            "mean_score": _unsigned(mean_score),
            "mean_length": _unsigned(mean_length),
            "crispness": None if crispness is None else _unsigned(crispness),
            "created": _now(),
            "metadata": dict(metadata),
        }
        _require(row, fields.POLICY | fields.FIGURES, "the policy")
        row |= {"program": program, "metadata": documents.to_json(row["metadata"], "metadata")}
        with self.index.reading() as connection:
            owner = number_of(find_run(connection, run).id, "run")
        with disk_faults(self.shown):
            row |= {"run": owner, "checkpoint": objects.bring(self.folder / "objects", checkpoint)}
        with self.index.writing() as connection:
            objects.keep(self.folder / "objects", checkpoint)
            number = enter(self.index.database, connection, "policy", row)
            publish(self.folder, connection, f"policy-{number}")
            return find_policy(connection, number)

    def policy(self, name: str | Content, methods: Methods = None, *, clauses: bool = False) -> PolicyRecord:
        """The policy of an id such as `policy-7`, or the best one of a task, of these methods or of all.

        `clauses` asks of the task's policies only for such as have a program.
        The best has the highest success rate, then the highest mean score, then it is the newest.

        Raises:
            NotFoundError: If there is none; with the nearest name.
            UsageError: If the name is of several tasks, each defined in a file.
        """
        with self.index.reading() as connection:
            number = number_of(name, "policy") if isinstance(name, str) else None
            if number is not None:
                return find_policy(connection, number)
            return best_policy(connection, name, methods, clauses=clauses)

    def learned(self, task: Content, method: str) -> list[tuple[str, int, dict[str, Any]]]:
        """The policies of a task by one method, newest first: id, seed, and the settings of its run."""
        c = policies.c
        newest = select(c.id, c.seed, runs.c.settings).join(runs, c.run == runs.c.id)
        newest = newest.where(c.task == task.name, c.method == method).order_by(c.id.desc())
        with self.index.reading() as connection:
            found = [
                (f"policy-{number}", int(seed), documents.from_json(text, f"the run of policy-{number}"))
                for number, seed, text in connection.execute(newest)
            ]
        return [each for each in found if content_of(task.name, each[2]).identity == task.identity]

    def best_of_each(self, domain: str, methods: Methods = None) -> list[tuple[Content, str]]:
        """The tasks of a domain that have policies, each with the id of its best one, by name."""
        with self.index.reading() as connection:
            found = best_of_each(connection, domain, methods).values()
        return [(content, f"policy-{number}") for content, number in found]

    def programs(self, domain: str, methods: Methods) -> Iterator[StoredProgram]:
        """The programs of a domain's policies by these methods, oldest first, read as they are asked for."""
        with self.index.reading() as connection:
            yield from programs(connection, domain, methods)

    def policies(self) -> list[PolicyRecord]:
        """All policies, newest first."""
        return self.newest_policies()[0]

    def newest_policies(
        self, most: int | None = None, wanted: Mapping[str, str] = NOTHING
    ) -> tuple[list[PolicyRecord], int]:
        """At most so many policies, newest first, and how many there are in all; by column, as runs."""
        chosen = _equal(policies, wanted)
        with self.index.reading() as connection:
            newest_first = select(policies).where(*chosen).order_by(policies.c.id.desc()).limit(most)
            return policy_records(connection.execute(newest_first)), count(connection, policies, *chosen)

    def solved(self, domain: str | None = None, methods: Methods = None) -> list[str]:
        """The tasks that have a policy, those of one domain or all, of these methods or of all, by name."""
        tasks = select(policies.c.task).distinct().where(*learned_by(methods)).order_by(policies.c.task)
        if domain is not None:
            tasks = tasks.where(policies.c.domain == domain)
        with self.index.reading() as connection:
            return [str(task) for task in connection.scalars(tasks)]

    def labels(self, which: Which, begin: str = "", most: int | None = None) -> list[Label]:
        """Of policies, of those with clauses, of runs, transfers, runs that have ended, or can be resumed.

        The newest come first, so many at most: those whose id or name begins with `begin`.
        """
        c, kind = (policies.c, "policy") if which in ("policies", "programs") else (runs.c, "run")
        name = null() if kind == "policy" else runs.c.name
        rows = select(c.id, c.method, c.task, name).order_by(c.id.desc()).limit(most)
        if begin:
            texts = [literal(f"{kind}-") + cast(c.id, String), *([runs.c.name] if kind == "run" else [])]
            rows = rows.where(or_(*(text.startswith(begin, autoescape=True) for text in texts)))
        match which:
            case "programs":
                rows = rows.where(policies.c.program.is_not(None))
            case "transfers":
                rows = rows.where(c.kind == "transfer")
            case "ended":
                rows = rows.where(c.status != "running")
            case "stopped":
                own = ~c.sources.contains(ELSEWHERE)
                rows = rows.where(c.status != "finished", c.method != "random", own)
        with self.index.reading() as connection:
            found = [Label(f"{kind}-{number}", *told) for number, *told in connection.execute(rows)]
        return [label for label in found if which != "stopped" or not self.files.goes_on(label.id)]

    def way_on(self, run: RunRecord) -> str:
        """A hint: how a run comes to have what it lacks."""
        if run.status == "running" and self.files.goes_on(run.id):
            return f"wait for it: {run.id} goes on"
        own = not any(source.startswith(ELSEWHERE) for source in run.sources)
        resumable = run.status != "finished" and run.method != "random" and own
        return f"run: paddlectl resume {run.id}" if resumable else "run: paddlectl runs"

    def read_checkpoint(self, policy: PolicyRecord) -> bytes:
        """The policy's safetensors bytes, verified.

        Raises:
            IntegrityError: If they are missing or aren't what was stored.
        """
        hint = self.way_again(policy)
        with disk_faults(self.shown):
            return objects.read(self.folder / "objects", policy.checkpoint, policy.id, hint)

    def way_again(self, policy: PolicyRecord) -> str:
        """A hint: how such a policy is learned anew, by its own method if that trains sources."""
        if policy.content.definition is not None:
            return "train it again by its task file"
        own = policy.program is None and self.run(policy.run).kind == "train"
        by = f" --method {policy.method}" if own else ""
        return f"train it again: paddlectl train {policy.task}{by}"


def _equal(table: Table, wanted: Mapping[str, str]) -> list[ColumnElement[bool]]:
    """That each of these columns holds what is wanted."""
    return [
        _has_tag(table, value) if name == "tag" else table.c[name] == value for name, value in wanted.items()
    ]


def _has_tag(table: Table, tag: str) -> ColumnElement[bool]:
    """By `replace`, which minds the case of letters in every database; LIKE doesn't."""
    return func.replace(table.c.tags, json.dumps(tag), "") != table.c.tags


def _require(values: Mapping[str, Any], kinds: Mapping[str, Any], what: str) -> None:
    if wrong := fields.misfit(values, kinds):
        raise UsageError(f"{what} can't be stored: {wrong}")


def _unsigned(value: float) -> float:
    """The number, -0.0 as 0.0: SQLite keeps no sign of zero, PostgreSQL does."""
    return float(value) + 0.0


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
