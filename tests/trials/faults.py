"""Faults to plant in a registry that `Filler.all_kinds` filled, each with the kind that `check` calls it."""

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any


def sql(*statements: str) -> Callable[[Path], None]:
    def plant(location: Path) -> None:
        connection = sqlite3.connect(location / "registry.db")
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        connection.close()

    return plant


def an_object(location: Path) -> Path:
    return sorted((location / "objects").iterdir())[0]


def table(location: Path) -> Path:
    return location / "runs/run-1/episodes.jsonl"


def manifest(location: Path) -> Path:
    return location / "manifests/run-1.json"


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))
    path.with_name("elsewhere").rename(path.parents[1] / "elsewhere")


def swap(location: Path) -> None:
    one, two = sorted((location / "objects").iterdir())[:2]
    data = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(data)


FAULTS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "no index": ("missing index", lambda r: (r / "registry.db").unlink()),
    "index of zeros": ("damaged index", lambda r: (r / "registry.db").write_bytes(bytes(9000))),
    "index cut": ("damaged index", lambda r: cut(r / "registry.db")),
    "a table less": ("damaged index", sql("DROP TABLE policies")),
    "a column less": ("damaged index", sql("ALTER TABLE runs DROP COLUMN results")),
    "no stamp": ("damaged index", sql("DELETE FROM alembic_version")),
    "a database index less": ("missing database index", sql("DROP INDEX ix_policies_task")),
    "a run's row gone": ("lost row", sql("DELETE FROM policies", "DELETE FROM runs WHERE id = 1")),
    "a policy's row gone": ("lost row", sql("DELETE FROM policies WHERE id = 2")),
    "a policy without its run": ("missing run", sql("DELETE FROM runs WHERE id = 2")),
    "another figure": ("other row", sql("UPDATE policies SET mean_score = 0.99 WHERE id = 1")),
    "another program": ("damaged program", sql("UPDATE policies SET program = 'gt_key(' WHERE id = 1")),
    "a rate above one": ("impossible row", sql("UPDATE policies SET success_rate = 1.5 WHERE id = 1")),
    "a count below zero": ("impossible row", sql("UPDATE runs SET frames = -1 WHERE id = 1")),
    "an unknown status": ("impossible row", sql("UPDATE runs SET status = 'done' WHERE id = 1")),
    "settings no JSON": ("damaged row", sql("UPDATE runs SET settings = '{' WHERE id = 1")),
    "a blob": ("damaged row", sql("UPDATE runs SET task = x'00' WHERE id = 1")),
    "a digest that is none": ("impossible row", sql("UPDATE policies SET checkpoint = '../x' WHERE id = 1")),
    "a source gone": ("missing source", sql("UPDATE runs SET sources = '[\"policy-9\"]' WHERE id = 3")),
    "an object gone": ("missing file", lambda r: an_object(r).unlink()),
    "an object cut": ("changed size", lambda r: cut(an_object(r))),
    "an object empty": ("changed size", lambda r: an_object(r).write_bytes(b"")),
    "a bit of an object": ("changed bytes", lambda r: flip(an_object(r))),
    "two objects swapped": ("changed bytes", swap),
    "an object a link": ("strange file", lambda r: link(an_object(r))),
    "a file among the objects": ("stray file", lambda r: (r / "objects/notes.txt").write_text("x")),
    "a table gone": ("missing file", lambda r: table(r).unlink()),
    "a table cut": ("changed size", lambda r: cut(table(r))),
    "a bit of a table": ("changed bytes", lambda r: flip(table(r))),
    "a row more": ("changed size", lambda r: table(r).open("a").write("{}\n")),
    "a document more": ("unsealed file", lambda r: (r / "runs/run-1/trace.json").write_text("{}")),
    "a file in a run": ("stray file", lambda r: (r / "runs/run-1/notes.txt").write_text("x")),
    "a run's folder gone": ("missing file", lambda r: shutil.rmtree(r / "runs/run-1")),
    "a folder among the runs": ("stray file", lambda r: (r / "runs/mine").mkdir()),
    "a manifest gone": ("missing manifest", lambda r: manifest(r).unlink()),
    "a bit of a manifest": ("damaged manifest", lambda r: flip(manifest(r))),
    "a manifest cut": ("damaged manifest", lambda r: cut(manifest(r))),
    "a manifest under another name": (
        "damaged manifest",
        lambda r: shutil.copy(manifest(r), r / "manifests/run-2.json"),
    ),
    "a checkpoint's arrays gone": (
        "damaged checkpoint",
        lambda r: (r / "runs/run-3/checkpoints/2.safetensors").unlink(),
    ),
    "a bit of a checkpoint": (
        "damaged checkpoint",
        lambda r: flip(r / "runs/run-3/checkpoints/2.safetensors"),
    ),
    "a run unknown": ("lost run", lambda r: shutil.copytree(r / "runs/run-1", r / "runs/run-77")),
}  # fmt: skip
ONLY_IN_THE_DATA = {"a bit of an object", "two objects swapped", "a bit of a table", "a bit of a checkpoint"}
