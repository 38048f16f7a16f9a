import errno
import os
import pwd
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.registry.files import objects
from paddlectl.registry.store import Registry


def _use_all(location: Path) -> None:
    registry = Registry.open(location, create=False)
    for run in registry.runs():
        assert registry.run(run.id) == run
    for policy in registry.policies():
        registry.read_checkpoint(policy)
        registry.policy(policy.task)


def _told_in_two_lines(error: PaddlectlError) -> bool:
    return 1 <= len(str(error).splitlines()) <= 2 and all(len(line) < 400 for line in str(error).splitlines())


# Objects


def test_every_change_of_an_object_is_found(registry: Registry, add: Any, location: Path) -> None:
    add.run()
    data = random.Random(1).randbytes(40_000)
    policy = add.policy("run-1", checkpoint=data)
    path = objects.object_path(location / "objects", policy.checkpoint)
    dice = random.Random(2)
    damaged = [_flip(data, dice.randrange(8 * len(data))) for _ in range(500)]
    damaged += [data[: dice.randrange(len(data))] for _ in range(50)]
    damaged += [b"", data + b"\0", bytes(len(data)), data[::-1]]
    for change in damaged:
        path.write_bytes(change)
        with pytest.raises(IntegrityError) as caught:
            registry.read_checkpoint(policy)
        assert caught.value.exit_code == 5
        assert policy.checkpoint in caught.value.message and "policy-1" in caught.value.message
        assert caught.value.hint == "train it again: paddlectl train BoxDoor"
    path.write_bytes(data)
    assert registry.read_checkpoint(policy) == data


def _flip(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


# The database


def _foreign(path: Path) -> None:
    path.unlink()
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE customers (id INTEGER)")
    connection.close()


def _sql(statement: str) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        connection = sqlite3.connect(path)
        connection.execute(statement)
        connection.commit()
        connection.close()

    return change


def _bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(change(path.read_bytes())) and None  # type: ignore[func-returns-value]


DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": _bytes(lambda data: b""),
    "one byte": _bytes(lambda data: data[:1]),
    "cut in the header": _bytes(lambda data: data[:60]),
    "cut in half": _bytes(lambda data: data[: len(data) // 2]),
    "cut by a page": _bytes(lambda data: data[:-4096]),
    "random bytes": _bytes(lambda data: random.Random(3).randbytes(len(data))),
    "zeros": _bytes(lambda data: bytes(len(data))),
    "text": _bytes(lambda data: b"name: A\ntarget: BoxDoor\n" * 400),
    "header's magic": _bytes(lambda data: b"X" + data[1:]),
    "first page": _bytes(lambda data: data[:100] + random.Random(4).randbytes(3996) + data[4096:]),
    "all but the first page": _bytes(lambda data: data[:4096] + bytes(len(data) - 4096)),
    "another program's database": _foreign,
    "a table less": _sql("DROP TABLE policies"),
    "a column less": _sql("ALTER TABLE runs DROP COLUMN results"),
    "settings no JSON": _sql("UPDATE runs SET settings = '{'"),
    "settings a list": _sql("UPDATE runs SET settings = '[]'"),
    "settings too deep": _sql("UPDATE runs SET settings = '" + "[" * 100_000 + "'"),
    "text that isn't UTF-8": _sql("UPDATE runs SET task = CAST(x'ff' AS TEXT)"),
    "a blob for a text": _sql("UPDATE runs SET task = x'00'"),
    "a text for a number": _sql("UPDATE policies SET mean_score = 'good'"),
    "a path for a digest": _sql("UPDATE policies SET checkpoint = '../../../etc/passwd'"),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_a_damaged_database(
    registry: Registry, add: Any, location: Path, damage: Callable[[Path], None]
) -> None:
    for _ in range(30):
        add.run(settings={"text": "x" * 500})
    add.policy("run-1")
    path = location / "registry.db"
    damage(path)
    before = path.read_bytes()
    with pytest.raises(IntegrityError) as caught:
        _use_all(location)
    assert caught.value.exit_code == 5
    assert _told_in_two_lines(caught.value), str(caught.value)
    assert path.read_bytes() == before


def test_any_damage_is_told_and_never_a_traceback(registry: Registry, add: Any, location: Path) -> None:
    for _ in range(10):
        add.run(settings={"text": "x" * 300})
    add.policy("run-1")
    path, dice = location / "registry.db", random.Random(6)
    good, found = path.read_bytes(), 0
    for _ in range(200):
        bad = bytearray(good)
        for _ in range(dice.choice([1, 4, 64])):
            bad[dice.randrange(len(bad))] = dice.randrange(256)
        path.write_bytes(bytes(bad[: dice.choice([len(bad), len(bad), dice.randrange(len(bad))])]))
        try:
            _use_all(location)
            Registry.open(location).add_run(
                kind="", method="", task="", scenario=None, sources=[], seed=0, settings={}, versions={}
            )
        except PaddlectlError as error:
            assert _told_in_two_lines(error), str(error)
            found += 1
        shutil.rmtree(location / "runs")
        (location / "runs").mkdir()
        for leftover in location.glob("registry.db-*"):
            leftover.unlink()
    assert found > 60


def test_a_folder_in_the_databases_place(location: Path) -> None:
    (location / "registry.db").mkdir(parents=True)
    with pytest.raises(PaddlectlError, match="can't be opened"):
        Registry.open(location)


def test_a_file_in_the_folders_place(location: Path) -> None:
    location.write_text("a file")
    with pytest.raises(PaddlectlError, match="is no folder"):
        Registry.open(location)
    assert location.read_text() == "a file"


def test_a_lost_database_isnt_replaced_by_an_empty_one(registry: Registry, add: Any, location: Path) -> None:
    add.run()
    add.policy("run-1")
    (location / "registry.db").unlink()
    with pytest.raises(IntegrityError, match=r"its registry\.db is missing"):
        Registry.open(location)
    with pytest.raises(PaddlectlError, match="can't be opened"):
        registry.runs()
    assert not (location / "registry.db").exists()


# The disk


def _as_somebody_else(code: str, location: Path) -> subprocess.CompletedProcess[str]:
    """Runs code without root's right to write everywhere."""
    drop = "import os\nif os.getuid() == 0: os.setgid(65534); os.setuid(65534)\n"
    for folder in [location, *location.parents]:
        if Path(tempfile.gettempdir()) in folder.parents:
            folder.chmod(folder.stat().st_mode | 0o055)
    return subprocess.run(
        [sys.executable, "-c", CHILD + drop + code],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


CHILD = """
import sys
from alembic import command
from paddlectl.errors import PaddlectlError
from paddlectl.registry.store import Registry
import sqlalchemy.dialects.sqlite.pysqlite
import paddlectl.registry.files.objects
plain = dict(kind="train", method="hdm", task="BoxDoor", scenario=None, sources=[], seed=0, versions={})
def told(work):
    try:
        print(work())
    except PaddlectlError as error:
        print(error.exit_code, str(error).replace(chr(10), " | "))
"""


def test_a_read_only_registry_is_read_but_not_written(registry: Registry, add: Any, location: Path) -> None:
    add.run()
    registry.files.append_rows("run-1", "episodes", [{"order": 0}])
    for path in [location, *location.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    code = f"""
r = Registry.open({str(location)!r})
told(lambda: (len(r.runs()), r.files.read_rows("run-1", "episodes")))
told(lambda: r.add_run(**plain, settings={{}}))
told(lambda: r.files.append_rows("run-1", "episodes", [{{"order": 1}}]))
told(lambda: r.files.write_document("run-1", "mapping", 1))
told(lambda: Registry.open({str(location / "runs" / "new")!r}))
"""
    result = _as_somebody_else(code, location)
    read, *refused = result.stdout.splitlines()
    assert read == "(1, [{'order': 0}])", result.stderr
    assert [line.split()[0] for line in refused] == ["1"] * 4, result.stderr
    owner = pwd.getpwuid(os.getuid()).pw_name
    files = ("registry.db", "runs/run-1/episodes.jsonl", "runs/run-1", "runs")
    for line, file in zip(refused, files, strict=True):
        assert f"no permission to write {location / file}, which belongs to {owner} | " in line
    assert len(registry.runs()) == 1


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO])
def test_a_failing_disk_while_publishing(
    registry: Registry, add: Any, location: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    add.run()

    def fail(handle: int) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        for work in (
            lambda: add.policy("run-1"),
            lambda: registry.files.write_document("run-1", "mapping", 1),
        ):
            with pytest.raises(PaddlectlError) as caught:
                work()
            assert caught.value.exit_code == 1
            assert _told_in_two_lines(caught.value)
            assert ("disk is full" in caught.value.message) == (number in {errno.ENOSPC, errno.EDQUOT})
    assert registry.policies() == []
    assert not list(location.rglob("*.part"))
    assert add.policy("run-1").id == "policy-1"


def test_a_full_database(registry: Registry, add: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    run = add.run()
    connect = sqlite3.connect

    def small(*args: Any, **options: Any) -> sqlite3.Connection:
        connection = connect(*args, **options)
        connection.execute("PRAGMA max_page_count=1")  # no more than it has
        return connection

    with monkeypatch.context() as patch:
        patch.setattr(sqlite3, "connect", small)
        with pytest.raises(PaddlectlError, match="disk is full"):
            add.run(settings={"text": "x" * 50_000})
    assert registry.runs() == [run]
    assert add.run(settings={"text": "x" * 50_000}).id == "run-2"


FULL = """
import errno
from pathlib import Path
r = Registry.open("{disk}/registry")
done, faults = 0, 0
while faults < 20:
    try:
        name = r.add_run(**plain, settings={{"text": "x" * 3000}}).id
        done += 1
        r.files.append_rows(name, "episodes", [{{"order": i, "score": 0.5}} for i in range(100)])
    except PaddlectlError as error:
        assert error.exit_code == 1 and ("full" in str(error) or "disk" in str(error)), str(error)
        faults += 1
assert done == len(r.runs()), (done, len(r.runs()))
assert all(len(r.files.read_rows(run.id, "episodes")) in (0, 100) for run in r.runs())
Path("{disk}/filler").unlink()
r.add_run(**plain, settings={{}})
print("whole", done > 5)
"""


def test_a_really_full_disk(tmp_path: Path) -> None:
    mount = f"mount -t tmpfs -o size=1m tmpfs {tmp_path}"
    if subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True).returncode:
        pytest.skip("no right to mount a small disk")
    fill = f"head -c 500000 /dev/zero > {tmp_path}/filler"
    command = ["unshare", "-m", "sh", "-c", f'{mount} && {fill} && "$0" -c "$1"', sys.executable]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    code = CHILD + FULL.format(disk=tmp_path)
    result = subprocess.run([*command, code], capture_output=True, text=True, env=environment)
    assert result.stdout == "whole True\n", result.stderr
