"""What all task files have in common: keys, names, and how words are checked."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field

from paddlectl.registry.fields import TASK
from paddlectl.registry.names import is_id
from paddlectl.tasks import suite
from paddlectl.yaml_files import Closed, KeyPath, Problem, unknown

Words = Annotated[tuple[str, ...], Field(max_length=32)]
SomeWords = Annotated[tuple[str, ...], Field(min_length=1, max_length=32)]


class TaskFile(Closed):
    """A task in words.

    Attributes:
        name: None is the file's, without its suffix.
        summary: One line for a reader; empty is what is to be done.
        facts: What the bodies of clauses speak of; None is all that the things allow, as of `subgoals`.
    """

    name: str | None = None
    summary: Annotated[str, Field(max_length=200)] = ""
    milestones: Words = ()
    facts: SomeWords | None = None
    subgoals: SomeWords | None = None


class Given(NamedTuple):
    """Words that a file has.

    Attributes:
        key: Under which.
        kind: What one is called.
        words: They.
        known: All that there are.
    """

    key: str
    kind: str
    words: Sequence[str]
    known: Mapping[str, object]


def bare(word: str) -> str:
    """`gt_key` of `gt_key()`, as programs have it."""
    return word.removesuffix("()")


def misnamed(found: TaskFile, path: Path) -> Iterator[Problem]:
    """Names that no task can have, or that another has."""
    name = found.name if found.name is not None else path.stem
    place: KeyPath = () if found.name is None else ("name",)
    if not re.fullmatch(TASK, name) or is_id(name):
        rule = "letters, digits, _ and -, a letter first, 64 at most"
        write = "; write another after name:" if found.name is None else ""
        yield Problem(place, f"no task can be called {name[:80]!r} ({rule}){write}")
    elif suite.known(name):
        yield Problem(place, f"there is a task {name} without this file; give this one another name")


def misspelt(found: TaskFile, *lists: Given) -> Iterator[Problem]:
    """A summary of several lines, words that there are not, and such as stand twice."""
    if not found.summary.isprintable():
        yield Problem(("summary",), "summary: must be one line of plain text")
    for key, kind, given, known in lists:
        words = [bare(word) if kind == "subgoal" else word for word in given]
        for index, word in enumerate(words):
            if word not in known:
                yield Problem((key, index), unknown(kind, word, tuple(known)))
            elif word in words[:index]:
                yield Problem((key, index), f"{word!r} stands twice in {key}")
