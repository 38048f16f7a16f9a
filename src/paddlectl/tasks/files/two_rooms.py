"""Files of tasks of two rooms, by the words of `tasks.minigrid.words`."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.files.common import (
    Given,
    SomeWords,
    TaskFile,
    Words,
    bare,
    misnamed,
    misspelt,
)
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import Thing
from paddlectl.tasks.minigrid.layouts import Passage, Spec
from paddlectl.tasks.minigrid.planner import Reached, reached
from paddlectl.tasks.minigrid.words import (
    FACTS,
    PASSAGES,
    SUBGOALS,
    THINGS,
    facts_for,
    lacking,
    mission_of,
    subgoals_for,
)
from paddlectl.yaml_files import Kind, Problem, unknown


class TwoRoomsFile(TaskFile):
    """A task of two rooms, in words."""

    passage: str
    near: Words = ()
    far: Words = ()
    success: SomeWords


def spec_of(found: TwoRoomsFile, path: Path) -> Spec:
    """The task, of a file whose words were checked."""
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
    return tuple(SUBGOALS[bare(word)] for word in words)


def _misuses(found: TwoRoomsFile, path: Path) -> Iterator[Problem]:
    """What a schema can't know: names that are taken, words that there are not, and what can't be."""
    problems = [*misnamed(found, path), *_contradictions(found, path)]
    yield from problems
    if not problems:
        yield from _unsolvable(spec_of(found, path), found)


def _contradictions(found: TwoRoomsFile, _: Path) -> Iterator[Problem]:
    problems = [
        *misspelt(
            found,
            Given("near", "thing", found.near, THINGS),
            Given("far", "thing", found.far, THINGS),
            Given("milestones", "subgoal", found.milestones, SUBGOALS),
            Given("success", "subgoal", found.success, SUBGOALS),
            Given("subgoals", "subgoal", found.subgoals or (), SUBGOALS),
            Given("facts", "fact", found.facts or (), FACTS),
        )
    ]
    if found.passage not in PASSAGES:
        problems.append(Problem(("passage",), unknown("passage", found.passage, tuple(PASSAGES))))
    yield from problems
    if not problems:
        spec = spec_of(found, Path("Unnamed"))
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


def _senseless(spec: Spec, found: TwoRoomsFile) -> Iterator[Problem]:
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


def _unsolvable(spec: Spec, found: TwoRoomsFile) -> Iterator[Problem]:
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


KIND = Kind("task", TwoRoomsFile, {(): TwoRoomsFile}, _misuses)
STORED = replace(KIND, misuses=_contradictions)
