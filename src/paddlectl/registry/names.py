"""Ids, `run-42` and `policy-7`, and what to say of one that isn't there."""

import difflib
import os
import re
import shlex
from collections.abc import Sequence

ELSEWHERE = "elsewhere:"
"""Before the id of a source that an imported run had in another registry."""

LATEST = "latest"
"""Stands for the newest run."""

_ID = re.compile(r"(run|policy)-([1-9][0-9]{0,17})")


def number_of(name: str, kind: str) -> int | None:
    """The number in an id of that kind, `run` or `policy`; None if the name isn't one."""
    found = _ID.fullmatch(name)
    return int(found[2]) if found and found[1] == kind else None


def is_id(name: str) -> bool:
    """Whether the name has the form of an id."""
    return _ID.fullmatch(name) is not None


def is_like_id(name: str) -> bool:
    """Whether the name is an id or may be taken for one: `RUN-1`, `run-01`, `policy_7`."""
    return re.fullmatch(r"(run|policy)[-_]?[0-9]+", name, re.IGNORECASE) is not None


def nearest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str:
    """`did you mean …? or `, or nothing if no known name is near."""
    folded = {text.casefold(): text for text in known}
    near = difflib.get_close_matches(name[:80].casefold(), folded, n=1, cutoff=cutoff)
    return f"did you mean {folded[near[0]]}? or " if near else ""


def shown(name: str) -> str:
    """The name, safe and short enough for a message."""
    short = shortened(name)
    return name if name and short == name and name.isprintable() else repr(short)


def quoted(text: str) -> str:
    """The text as a word of a shell's command line that can be pasted, whatever characters are in it."""
    if text.isprintable():
        return shlex.quote(text)
    return "$'" + "".join(map(_escaped, text)) + "'"


def _escaped(character: str) -> str:
    if character in "\\'":
        return f"\\{character}"
    if character.isprintable():
        return character
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(character))


def shortened(text: str) -> str:
    """At most 80 characters of the text; of an address only what follows its login."""
    return (f"…{text.rpartition('@')[2]}" if "://" in text else text)[:80]
