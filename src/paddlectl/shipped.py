"""Scenarios and studies that come with paddlectl, by name: `A`, `minigrid/KeyCorridor`, `paper/fig4`.

In a checkout the folder is a link to the `scenarios/` at its top; an installed package holds the files.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path

from paddlectl.errors import NotFoundError, UsageError
from paddlectl.registry.names import shown

FOLDER = Path(__file__).parent / "scenarios"
SUFFIX = ".yaml"


def scenarios() -> tuple[str, ...]:
    """Their names, sorted."""
    return tuple(name for name in _names() if not _is_study(name))


def studies() -> tuple[str, ...]:
    """Their names, sorted."""
    return tuple(name for name in _names() if _is_study(name))


def scenario(text: str, folder: Path = Path()) -> Path:
    """The file of the scenario that a user names; where a path leads to a file, it is that.

    Args:
        text: A path, or the name of one that comes with paddlectl.
        folder: Where a relative path begins.

    Raises:
        NotFoundError: If it is neither; with the nearest names.
        UsageError: If it is the name of a study.
    """
    if text in studies() and not (folder / text).is_file():
        raise UsageError(f"{text} is a study, not a scenario", f"run: paddlectl sweep {text} --dry-run")
    return _given(text, folder, "scenario", scenarios())


def study(text: str) -> Path:
    """The same of a study.

    Raises:
        NotFoundError: If it is neither; with the nearest names.
        UsageError: If it is the name of a scenario.
    """
    if text in scenarios() and not Path(text).is_file():
        raise UsageError(f"{text} is a scenario, not a study", "run: paddlectl sweep --help")
    return _given(text, Path(), "study", studies())


def _given(text: str, folder: Path, noun: str, known: Sequence[str]) -> Path:
    path = folder / text
    if path.is_file():
        return path
    if text in known:
        return _file(text)
    bare = text.removeprefix("./").removeprefix("scenarios/").removesuffix(SUFFIX)
    if path.is_dir():
        told = f"{shown(text)} is a folder, no {noun}" if text else f"no {noun} is named"
        raise NotFoundError(told, _advice(text, path, known))
    if os.path.lexists(path) or (path.suffix and bare not in known):
        return path  # of which its reader tells what is wrong
    raise NotFoundError(
        f"no file {shown(text)}, and no {noun} of that name is shipped", _advice(text, path, known)
    )


def _advice(text: str, path: Path, known: Sequence[str]) -> str:
    """What may have been meant: a file beside it, those of a shipped folder of that name, or one like it."""
    if path.name and path.with_name(f"{path.name}{SUFFIX}").is_file():
        return f"did you mean {shown(text.rstrip('/'))}{SUFFIX}?"
    name = text.strip("/").removeprefix("./").removeprefix("scenarios/").removesuffix(SUFFIX)
    if inner := [each for each in known if name and each.startswith(f"{name}/")]:
        return f"did you mean {' or '.join(inner)}?"
    folded = {part.casefold(): whole for whole in known for part in (whole.rpartition("/")[2], whole)}
    near = get_close_matches(name[:80].casefold(), folded, n=3)
    found = dict.fromkeys(folded[part] for part in near)
    return f"did you mean {' or '.join(found)}?" if found else f"there are {', '.join(known)}"


def _names() -> list[str]:
    files = (path.relative_to(FOLDER).with_suffix("") for path in FOLDER.rglob(f"*{SUFFIX}"))
    return sorted(file.as_posix() for file in files)


def _is_study(name: str) -> bool:
    with suppress(OSError):
        return b"\nscenarios:" in _file(name).read_bytes()
    return False


def _file(name: str) -> Path:
    return FOLDER / f"{name}{SUFFIX}"
