"""Who may do what in a registry: what is made in it is as open as its folder, whatever the umask."""

import os
import pwd
import stat
import uuid
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

from paddlectl.registry.names import quoted


class Refusal(NamedTuple):
    """What this process may not do, and what to do about it."""

    what: str
    hint: str


def share(path: Path) -> None:
    """Gives a file or folder that was just made the group and the rights of the folder that it is in.

    A sticky folder lets nobody change what is another's, and so do the rights that it gives.
    """
    above, made = path.parent.stat(), path.stat()
    folder = stat.S_ISDIR(made.st_mode)
    mode = above.st_mode & (0o2777 if folder else 0o666) | (0o700 if folder else 0o600)
    if above.st_mode & stat.S_ISVTX:
        mode &= ~0o022
    with suppress(PermissionError):  # of a group that one isn't in, or a file system without rights
        if made.st_gid != above.st_gid:
            os.chown(path, -1, above.st_gid)
    with suppress(PermissionError):
        if stat.S_IMODE(path.stat().st_mode) != mode:
            path.chmod(mode)


def make_folder(folder: Path) -> None:
    """Makes a folder of a registry, and those above it, where they are missing."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    temporary = _beside(folder)
    temporary.mkdir()
    try:
        share(temporary)  # before others can see it
        temporary.rename(folder)
    except OSError:
        temporary.rmdir()
        if not folder.is_dir():  # else another process was first
            raise


def make_file(path: Path) -> None:
    """Makes an empty file of a registry, where it is missing."""
    temporary = _beside(path)
    temporary.open("xb").close()
    try:
        share(temporary)
        os.link(temporary, path)  # a rename would take the place of another process's
    except FileExistsError:
        pass
    except OSError:  # a file system without links
        path.open("ab").close()
        share(path)
    finally:
        temporary.unlink()


def opened(path: Path, mode: str) -> BinaryIO:
    """Opens a file of a registry to write to it; makes it where it is missing."""
    if not path.exists():
        make_file(path)
    file: BinaryIO = path.open(mode)  # type: ignore[assignment]
    return file


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")


def refused(path: Path) -> Refusal | None:
    """What the rights of a path, or of the folder that it would be made in, forbid; None if nothing."""
    for place in (path, *path.parents):
        try:
            found = place.stat()
            if os.statvfs(place).f_flag & os.ST_RDONLY:
                return None
        except OSError:  # not there, or not to be seen
            continue
        search = os.X_OK if stat.S_ISDIR(found.st_mode) else 0
        wanted = {"read": os.R_OK | search, "write": os.W_OK}
        lacking = [what for what, right in wanted.items() if not os.access(place, right)]
        return _refusal(place, found, lacking) if lacking else None
    return None


def _refusal(place: Path, found: os.stat_result, lacking: list[str]) -> Refusal:
    try:
        owner = pwd.getpwuid(found.st_uid).pw_name
    except KeyError:
        owner = f"user {found.st_uid}"
    name, change = quoted(str(place)), "rwX" if stat.S_ISDIR(found.st_mode) else "rw"
    what = f"no permission to {' or '.join(lacking)} {place}, which belongs to {owner}"
    if found.st_uid == os.geteuid():
        return Refusal(what, f"run: chmod u+{change} {name}")
    if found.st_gid in {os.getegid(), *os.getgroups()}:
        return Refusal(what, f"ask {owner} to run: chmod g+{change} {name}")
    return Refusal(what, f"ask {owner} to give it to a group that you are in")
