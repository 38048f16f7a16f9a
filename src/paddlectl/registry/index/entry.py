"""How rows come into the index: each with its manifest, and what belongs together in one transaction."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from sqlalchemy import Connection, Engine, delete, insert, update

from paddlectl.errors import IntegrityError
from paddlectl.registry.files import documents, layout, manifests, objects
from paddlectl.registry.files.rights import make_folder
from paddlectl.registry.files.runfiles import RunFiles
from paddlectl.registry.index.database import Database, require_current
from paddlectl.registry.index.faults import faults
from paddlectl.registry.index.queries import same_runs
from paddlectl.registry.names import number_of
from paddlectl.registry.schema import runs


class Entry(RunFiles):
    """The writing half of a registry."""

    _database: Database
    _writing: Engine

    def adopt(
        self,
        run: Mapping[str, Any],
        tables: Mapping[str, bytes],
        policy: Mapping[str, Any] | None,
        checkpoint: bytes,
    ) -> dict[str, Any]:
        """Enters a run that ended elsewhere, with its tables and its policy: wholly, or not at all.

        Returns:
            `{run, policy, known}`: the ids, and whether they were here already.
        """
        row = {**run, "resumes": 0}
        for name in ("sources", "settings", "versions", "results"):
            row[name] = documents.to_json(row[name], name)
        learned = None
        if policy is not None:
            extra = documents.to_json(policy["metadata"], "metadata")
            learned = {**policy, "metadata": extra, "checkpoint": self._bring_object(checkpoint)}
        with self._transaction(self._writing) as connection:
            for known in same_runs(connection, row, learned):
                folder = self.folder / "runs" / known["run"]
                if all((folder / table).exists() for table in tables):
                    return {**known, "known": True}
            published: list[str] = []
            if policy is not None:
                self._keep_object(checkpoint)
            try:
                return self._adopt(connection, row, tables, learned, published)
            except BaseException:
                self._withdraw(published)
                raise

    def _adopt(
        self,
        connection: Connection,
        run: Mapping[str, Any],
        tables: Mapping[str, bytes],
        policy: Mapping[str, Any] | None,
        published: list[str],
    ) -> dict[str, Any]:
        number = self._insert(connection, "run", {**run, "status": "running"})
        adopted = {"run": f"run-{number}", "policy": None, "known": False}
        published.append(f"run-{number}")
        self._publish(connection, f"run-{number}")  # as one that goes on, until all of it is there
        self._make_run_folder(f"run-{number}")
        for table, data in tables.items():
            objects.write_atomically(self.folder / "runs" / f"run-{number}" / table, data)
        connection.execute(update(runs).where(runs.c.id == number).values(status=run["status"]))
        if policy is not None:
            adopted["policy"] = name = (
                f"policy-{self._insert(connection, 'policy', {**policy, 'run': number})}"
            )
            published.append(name)
            self._publish(connection, name)
        self._publish(connection, f"run-{number}")
        return adopted

    def _withdraw(self, names: Sequence[str]) -> None:
        """Takes back the manifests and folders of rows that weren't committed."""
        for name in reversed(names):
            folder = self.folder / "runs" / name
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():  # else the manifest tells `gc` of it
                manifests.path_of(self.folder, name).unlink(missing_ok=True)

    def _bring_object(self, data: bytes) -> str:
        """Stores a policy's object, so that no transaction waits for it, and gives its name.

        `gc` may come first and take it away again, even half-written.
        """
        with faults(self.shown), suppress(FileNotFoundError):
            objects.publish(self.folder / "objects", data)
        return manifests.seal_of(data).sha256

    def _keep_object(self, data: bytes) -> None:
        """Makes sure in the transaction of its row that the object is there, from now on for good."""
        if not objects.object_path(self.folder / "objects", manifests.seal_of(data).sha256).exists():
            objects.publish(self.folder / "objects", data)

    def _insert(self, connection: Connection, kind: str, row: Mapping[str, Any]) -> int:
        """Adds a row under a number that no manifest has, not even one that the index lost."""
        table = layout.ROW_TABLES[kind]
        number = _inserted(connection.execute(insert(table).values(row)).inserted_primary_key)
        if manifests.path_of(self.folder, f"{kind}-{number}").exists():
            connection.execute(delete(table).where(table.c.id == number))
            numbers = (number_of(name, kind) for name in manifests.names(self.folder))
            number = 1 + max(found for found in numbers if found)
            connection.execute(insert(table).values({**row, "id": number}))
            self._database.count_from(connection, kind, number)
        return number

    def _publish(self, connection: Connection, name: str) -> None:
        """Writes the manifest of a row; what it says is true once the transaction is committed."""
        manifests.write(self.folder, layout.manifest_of(self.folder, connection, name))

    def _make_run_folder(self, run: str) -> None:
        folder = self.folder / "runs" / run
        make_folder(folder)
        if any(folder.iterdir()):
            raise IntegrityError(
                f"{folder} is there, but registry.db doesn't know it: is that an older copy?",
                "move that folder aside",
            )
        objects.sync_folder(folder.parent)

    @contextmanager
    def _transaction(self, engine: Engine) -> Iterator[Connection]:
        with faults(self.shown), engine.begin() as connection:
            require_current(connection, self._database.file)
            yield connection


def _inserted(key: Sequence[Any] | None) -> int:
    assert key is not None
    return int(key[0])
