"""A registry that several users share: what one makes the others can use, whatever the umask of each."""

import os
import pwd
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import PaddlectlError
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.files import rights
from paddlectl.registry.index.faults import faults
from paddlectl.registry.store import Registry
from released import rebuilt

NOBODY = pwd.getpwnam("nobody").pw_uid
GROUP = 54_321
AS_ANOTHER = """
import os, sys
from pathlib import Path
from filler import Filler
from paddlectl.errors import PaddlectlError
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
import sqlalchemy.dialects.sqlite.pysqlite
uid, gid, place = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
os.umask(0o077)
os.setgroups([gid]); os.setgid(uid); os.setuid(uid)
"""


@pytest.fixture
def umask() -> Iterator[Callable[[int], int]]:
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


@pytest.fixture
def shared(umask: Callable[[int], int]) -> Iterator[Path]:
    """A folder of a group, as its administrator makes it, where all else is private.

    Not below `tmp_path`: any other run of pytest takes from others the right to what lies there.
    """
    with tempfile.TemporaryDirectory() as own:
        folder = Path(own) / "registry"
        folder.mkdir()
        folder.chmod(0o2770)
        umask(0o077)
        yield folder


def filled(place: Path, filler: Any) -> None:
    """All that a registry holds: an upgrade's copy, runs with checkpoints, an import, a repair."""
    registry = Registry.open(place)
    filler(registry).all_kinds()
    with registry.files.hold("run-3"):
        pass
    bundles.export(registry, "run-1", place.parent / "run.zip")
    with Registry.open(place) as other:
        run = filler(other).run(task="GapBall").id
        other.files.append_rows(run, "episodes", [{"order": 0}])
    next((place / "objects").iterdir()).write_bytes(b"damaged")
    (place / "registry.db").rename(place / "gone")
    (place / "gone").unlink()
    assert repair(place, drop_lost=True).done
    bundles.import_(lambda: Registry.open(place), place.parent / "run.zip")
    registry.index.database.copy("mine")


def modes(place: Path) -> dict[str, int]:
    """Of all that is in the folder."""
    return {str(path.relative_to(place)): stat.S_IMODE(path.lstat().st_mode) for path in place.rglob("*")}


@pytest.mark.parametrize("mode", [0o2770, 0o2750, 0o700, 0o755, 0o775, 0o2775])
@pytest.mark.parametrize("mask", [0o077, 0o002])
def test_all_that_is_made_has_the_rights_of_its_folder(
    mode: int, mask: int, shared: Path, filler: Any, umask: Callable[[int], int]
) -> None:
    shared.chmod(mode)
    umask(mask)
    filled(shared, filler)
    found = modes(shared)
    kinds = {Path(name).name.partition("-")[0] for name in found}
    assert {
        "identity",
        "registry.db",
        "registry.lock",
        "lock",
        "checkpoints",
        "aside",
        "mapping.json",
    } <= kinds
    for name, given in found.items():
        assert given == (mode if (shared / name).is_dir() else mode & 0o666), (name, oct(given))
    assert stat.S_IMODE((shared.parent / "run.zip").stat().st_mode) == 0o666 & ~mask  # a user's own


def test_an_upgrade_leaves_the_folders_rights(tmp_path: Path, umask: Callable[[int], int]) -> None:
    place = rebuilt("0001", tmp_path / "old")
    for path in [place, *place.rglob("*")]:
        path.chmod(0o2770 if path.is_dir() else 0o660)
    umask(0o077)
    Registry.open(place)
    assert {oct(mode & 0o770) for mode in modes(place).values()} == {"0o660", "0o770"}


def test_where_all_may_write_but_only_to_their_own_nobody_may_write_to_anothers(
    tmp_path: Path, filler: Any
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o1777)
    filler(Registry.open(tmp_path / "open")).all_kinds()
    assert not [name for name, mode in modes(tmp_path / "open").items() if mode & 0o022]


def as_another(code: str, place: Path, group: int = GROUP) -> list[str]:
    """What code prints as a user of that group alone, with a umask of 077."""
    place.parent.chmod(0o755)
    line = [sys.executable, "-c", AS_ANOTHER + code, str(NOBODY), str(group), str(place)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(line, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


USE = """
with Registry.open(place) as registry:
    add = Filler(registry)
    add.all_kinds()
    registry.resume_run("run-3")
    registry.files.rewind("run-3")
    registry.files.append_rows("run-3", "episodes", [{"order": 9}])
    with registry.files.hold("run-3"):
        registry.files.save_checkpoint("run-3", {}, b"x")
    registry.finish_run("run-3", status="interrupted", frames=1, episodes=1, seconds=1.0, results={})
print(len(registry.runs()), check(place).faults)
"""
root = pytest.mark.skipif(os.getuid() != 0, reason="only root can become somebody else")


@root
@pytest.mark.parametrize("mode", [0o2770, 0o770])
def test_two_users_use_one_registry(mode: int, shared: Path, filler: Any) -> None:
    os.chown(shared, -1, GROUP)
    shared.chmod(mode)
    for runs in (3, 9):
        filler(Registry.open(shared)).all_kinds()
        assert as_another(USE, shared) == [f"{runs + 3} []"]
    assert not check(shared).faults
    assert {path.stat().st_gid for path in shared.rglob("*")} == {GROUP}
    owners = {path.stat().st_uid for path in (shared / "manifests").iterdir()}
    assert owners == {0, NOBODY}


REFUSED = """
def told(work):
    try:
        print(work())
    except PaddlectlError as error:
        print(error.exit_code, str(error).replace(chr(10), " | "))
registry = Registry(place)
told(registry.runs)
told(lambda: registry.files.append_rows("run-1", "episodes", [{}]))
told(lambda: Filler(registry).run())
told(lambda: registry.files.read_rows("run-1", "episodes"))
"""


@root
def test_a_refusal_names_the_right_the_file_and_its_owner(shared: Path, filler: Any) -> None:
    os.chown(shared, -1, GROUP)
    filler(Registry.open(shared)).all_kinds()
    table, index = shared / "runs/run-1/episodes.jsonl", shared / "registry.db"
    owner = pwd.getpwuid(os.getuid()).pw_name

    def expected(what: str, path: Path, change: str = "rw") -> str:
        hint = f"ask {owner} to run: chmod g+{change} {path}"
        return f"1 no permission to {what} {path}, which belongs to {owner} | {hint}"

    table.chmod(0o600)
    index.chmod(0o600)
    read, append, write, rows = as_another(REFUSED, shared)
    assert read == write == expected("read or write", index)
    assert append == rows == expected("read or write", table)
    table.chmod(0o640)
    index.chmod(0o640)
    _, append, write, rows = as_another(REFUSED, shared)
    assert (append, write) == (expected("write", table), expected("write", index))
    assert rows.startswith("[{'order': 0}")
    index.chmod(0o660)
    shared.chmod(0o2750)
    assert as_another(REFUSED, shared)[2] == expected("write", shared, "rwX")
    shared.chmod(0o2700)
    assert as_another(REFUSED, shared)[0] == expected("read or write", shared, "rwX")
    shared.chmod(0o2770)
    (read, *_) = as_another(REFUSED, shared, group=GROUP + 1)
    assert read.endswith(f"belongs to {owner} | ask {owner} to give it to a group that you are in")


def test_what_has_no_rights_to_blame_is_told_as_it_is(tmp_path: Path) -> None:
    with pytest.raises(PaddlectlError, match=r"can't be used \(Permission denied: .*\)"), faults("place"):
        raise PermissionError(13, "Permission denied", str(tmp_path))
    assert rights.refused(tmp_path) is None
