"""Task files: tasks of two rooms by the words of `tasks.minigrid.words`, also as a registry keeps them."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field

from paddlectl.errors import IntegrityError, InvalidFileError
from paddlectl.logic.atoms import Atom
from paddlectl.registry.fields import TASK
from paddlectl.registry.names import is_id
from paddlectl.tasks import suite
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import Thing
from paddlectl.tasks.minigrid.layouts import Passage, Spec
from paddlectl.tasks.minigrid.planner import Reached, reached
from paddlectl.tasks.minigrid.words import (
    FACTS,
    PASSAGES,
    SUBGOALS,
    THINGS,
    Defined,
    facts_for,
    lacking,
    mission_of,
    subgoals_for,
)
from paddlectl.yaml_files import Closed, KeyPath, Kind, Problem, check_values, load_file, unknown

T = TypeVar("T")

Words = Annotated[tuple[str, ...], Field(max_length=32)]
SomeWords = Annotated[tuple[str, ...], Field(min_length=1, max_length=32)]


class TaskFile(Closed):
    """A task of two rooms, in words.

    Attributes:
        name: None is the file's, without its suffix.
        summary: One line for a reader; empty is what `success` says.
        facts: What the bodies of clauses speak of; None is all that the things allow, as of `subgoals`.
    """

    name: str | None = None
    summary: Annotated[str, Field(max_length=200)] = ""
    passage: str
    near: Words = ()
    far: Words = ()
    milestones: Words = ()
    success: SomeWords
    facts: SomeWords | None = None
    subgoals: SomeWords | None = None


def load_task(path: Path) -> Defined:
    """Reads and checks a task file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task, or one that can't be solved; the message starts with
            file:line:column.
    """
    return Defined(_spec(load_file(path, _KIND), path), str(path))


def make_environment(task: str, **kwargs: Any) -> Any:
    """The environment of a task file, a `tasks.minigrid.env.PaddleEnv`, with its other arguments.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task, or one that can't be solved.
    """
    from paddlectl.tasks.minigrid.env import PaddleEnv  # loads MiniGrid

    return PaddleEnv(load_task(Path(task)).spec, **kwargs)


def stored_task(name: str, definition: Mapping[str, Any]) -> Defined:
    """The task of a run or policy, as it was when that was learned.

    Raises:
        IntegrityError: If what is stored isn't a task of that name.
    """
    try:
        spec = _spec(check_values(definition, _STORED), Path(name))
    except InvalidFileError as error:
        raise IntegrityError(
            f"the definition of {name} isn't what this version keeps: {error.message}",
            "use the version of paddlectl that learned it",
        ) from error
    if spec.name != name:
        raise IntegrityError(f"the definition of {name} is of {spec.name}", "run: paddlectl registry check")
    return Defined(spec)


def _spec(found: TaskFile, path: Path) -> Spec:
    near, far = (tuple(THINGS[word] for word in words) for words in (found.near, found.far))
    passage, success = PASSAGES[found.passage], _subgoals(found.success)
    things, mission = near + far, mission_of(success)
    return Spec(
        name=found.name or path.stem,
        summary=found.summary or f"{mission.capitalize()}.",
        mission=mission,
        passage=passage,
        near=near,
        far=far,
        milestones=_subgoals(found.milestones),
        success=success,
        atoms=tuple(FACTS[word] for word in found.facts) if found.facts else facts_for(things),
        subgoals=_subgoals(found.subgoals) if found.subgoals else subgoals_for(things, passage),
    )


def _subgoals(words: Sequence[str]) -> tuple[Atom, ...]:
    return tuple(SUBGOALS[_bare(word)] for word in words)


def _bare(word: str) -> str:
    """`gt_key` of `gt_key()`, as programs have it."""
    return word.removesuffix("()")


def _misuses(found: TaskFile, path: Path) -> Iterator[Problem]:
    """What a schema can't know: names that are taken, words that there are not, and what can't be."""
    problems = [*_misnamed(found, path), *_contradictions(found, path)]
    yield from problems
    if not problems:
        yield from _unsolvable(_spec(found, path), found)


def _misnamed(found: TaskFile, path: Path) -> Iterator[Problem]:
    name = found.name if found.name is not None else path.stem
    place: KeyPath = () if found.name is None else ("name",)
    if not re.fullmatch(TASK, name) or is_id(name):
        rule = "letters, digits, _ and -, a letter first, 64 at most"
        write = "; write another after name:" if found.name is None else ""
        yield Problem(place, f"no task can be called {name[:80]!r} ({rule}){write}")
    elif suite.known(name):
        yield Problem(place, f"there is a task {name} without this file; give this one another name")


def _contradictions(found: TaskFile, _: Path) -> Iterator[Problem]:
    words: list[tuple[str, str, Sequence[str], Mapping[str, Any]]] = [
        ("near", "thing", found.near, THINGS),
        ("far", "thing", found.far, THINGS),
        ("milestones", "subgoal", found.milestones, SUBGOALS),
        ("success", "subgoal", found.success, SUBGOALS),
        ("subgoals", "subgoal", found.subgoals or (), SUBGOALS),
        ("facts", "fact", found.facts or (), FACTS),
    ]
    problems = []
    if not found.summary.isprintable():
        problems.append(Problem(("summary",), "summary: must be one line of plain text"))
    if found.passage not in PASSAGES:
        problems.append(Problem(("passage",), unknown("passage", found.passage, tuple(PASSAGES))))
    for key, kind, given, known in words:
        bare = [_bare(word) if kind == "subgoal" else word for word in given]
        for index, word in enumerate(bare):
            if word not in known:
                problems.append(Problem((key, index), unknown(kind, word, tuple(known))))
            elif word in bare[:index]:
                problems.append(Problem((key, index), f"{word!r} stands twice in {key}"))
    yield from problems
    if not problems:
        spec = _spec(found, Path("Unnamed"))
        yield from _misplaced(spec)
        yield from _senseless(spec, found)


def _misplaced(spec: Spec) -> Iterator[Problem]:
    """Things where they can't be."""
    for key, things in (("near", spec.near), ("far", spec.far)):
        for index, thing in enumerate(things):
            word = thing.name.lower()
            if key == "far" and thing in spec.near:
                yield Problem((key, index), f"{word} is in near, too; there is one of each thing")
            elif key == "far" and thing is Thing.BLOCKAGE:
                yield Problem((key, index), "the blockage stands before the passage: write it in near")
            elif thing is Thing.BLOCKAGE and spec.passage is Passage.GAP:
                yield Problem((key, index), "a gap can't be blocked; leave it out, or write passage: locked")
            elif thing in (Thing.KEY, Thing.BOX) and {Thing.KEY, Thing.BOX} <= {
                *things[: index + 1],
                *(spec.near if key == "far" else ()),
            }:
                yield Problem((key, index), "the box holds the key, of which there is one; write one of both")


def _senseless(spec: Spec, found: TaskFile) -> Iterator[Problem]:
    """Facts and subgoals of what isn't there, and such as no program may name."""
    named = {"milestones": spec.milestones, "success": spec.success}
    named |= {"subgoals": spec.subgoals if found.subgoals else ()}
    named |= {"facts": spec.atoms if found.facts else ()}
    for key, symbols in named.items():
        for index, symbol in enumerate(symbols):
            word = str(symbol) if key == "facts" else symbol.predicate.name
            if missing := lacking(symbol, spec.things):
                yield Problem((key, index), f"{word} needs {missing}, which is neither near nor far")
            elif symbol == s.GT_DOOR and spec.passage is Passage.GAP:
                yield Problem((key, index), "a gap opens when the key is taken; write gt_key for gt_door")
            elif key in ("milestones", "success") and symbol not in spec.subgoals:
                yield Problem((key, index), f"{word} isn't among the subgoals; write it there, too")


def _unsolvable(spec: Spec, found: TaskFile) -> Iterator[Problem]:
    """What can't be reached, or holds from the start, in layouts of the task."""
    layouts = reached(spec)
    ever = frozenset.union(*(each.ever for each in layouts))
    first = frozenset.union(*(each.first for each in layouts))
    if any(each.first >= set(spec.success) for each in layouts):
        yield Problem(("success",), "it holds at the start already, so there is nothing to learn")
        return
    for key, subgoals in (("success", spec.success), ("milestones", spec.milestones)):
        for index, subgoal in enumerate(subgoals):
            word = subgoal.predicate.name
            if subgoal not in ever:
                before = " before the task is solved" if any(each.solved for each in layouts) else ""
                yield Problem((key, index), f"{word} can't be reached{before or _why(spec, layouts)}")
            elif key == "milestones" and subgoal in first:
                yield Problem((key, index), f"{word} holds at the start already, so it is no milestone")
    failed = sum(not each.solved for each in layouts)
    if failed and set(spec.success) <= ever:
        of = "" if failed == len(layouts) else f" in {failed} of {len(layouts)} layouts"
        names = " and ".join(found.success)
        yield Problem(("success",), f"{names} can't hold at once{of}{_why(spec, layouts)}")


def _why(spec: Spec, layouts: Sequence[Reached]) -> str:
    if any(each.opened for each in layouts):
        return ""
    key = next((thing for thing in (Thing.KEY, Thing.BOX) if thing in spec.things), None)
    if key in spec.near:
        return ": the passage never opens"
    where = "there is no key" if key is None else f"the {key.name.lower()} is beyond it"
    return f": the passage never opens, as {where}"


_KIND = Kind("task", TaskFile, {(): TaskFile}, _misuses)
_STORED = replace(_KIND, misuses=_contradictions)
