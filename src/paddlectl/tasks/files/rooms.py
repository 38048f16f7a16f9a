"""Files of tasks of several rooms, by the words of `tasks.rooms.plan`."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from paddlectl.tasks.base import Split
from paddlectl.tasks.files.common import Given, TaskFile, bare, misnamed, misspelt
from paddlectl.tasks.rooms.layouts import Ground, Layout, NoPlaceError
from paddlectl.tasks.rooms.plan import (
    COLOURS,
    GOAL,
    PASSAGES,
    THINGS,
    UNLOCKED,
    Door,
    Need,
    Plan,
    Thing,
    mission_of,
    needs,
)
from paddlectl.tasks.stock.tasks import PREDICATES, SUBGOALS
from paddlectl.yaml_files import Closed, KeyPath, Kind, Problem, unknown

MOST_CELLS = 2_500
"""Of a grid."""

_MOST_ROWS = 10
_LONGEST = 10_000  # horizon
_USUAL_FACT = "is_open(way)"  # where none makes sense
_DRAWN = 200  # layouts that are looked at
_SOLVED = 0.1  # share of them that must be solvable; the rest is drawn again
_OF_EACH_SPLIT = 3  # layouts that must be found …
_LOOKED_FOR = 1000  # … among so many
_STARTS = 12  # at which milestones are looked at


def _listed(value: Any) -> Any:
    if isinstance(value, str):
        return (value,)
    return tuple(value) if isinstance(value, list) else value


Rooms = Annotated[tuple[str, ...], Field(max_length=_MOST_ROWS**2), BeforeValidator(_listed)]
SomeRooms = Annotated[
    tuple[str, ...], Field(min_length=1, max_length=_MOST_ROWS**2), BeforeValidator(_listed)
]
Row = Annotated[tuple[str, ...], Field(min_length=1, max_length=_MOST_ROWS)]


class DoorWords(Closed):
    """A door between a room of `near` and one of `far`."""

    near: SomeRooms
    far: SomeRooms
    passage: str = "closed"
    colour: str | None = None
    blocked: bool = False


class ThingWords(Closed):
    """A thing and where it lies; without `room` and `behind`, anywhere."""

    thing: str
    room: Rooms = ()
    behind: str | None = None
    box: str | None = None


class RoomsFile(TaskFile):
    """A task of several rooms, in words.

    Attributes:
        horizon: None is 4 steps for each cell of all rooms.
    """

    rooms: Annotated[tuple[Row, ...], Field(min_length=1, max_length=_MOST_ROWS)]
    room_size: Annotated[int, Field(ge=3, le=25)] = 6
    agent: Rooms = ()
    doors: Annotated[tuple[DoorWords, ...], Field(max_length=32)] = ()
    connect: bool = False
    things: Annotated[tuple[ThingWords, ...], Field(min_length=1, max_length=32)]
    target: str
    horizon: Annotated[int | None, Field(ge=1, le=_LONGEST)] = None


def plan_of(found: RoomsFile, path: Path) -> Plan:
    """The task, of a file whose words were checked."""
    doors, things = _doors(found), _things(found)
    there = needs(doors, found.connect, things, found.target)
    met = [word for word, need in there.items() if need.met]
    facts = [word for word in PREDICATES if word in met] or [_USUAL_FACT]
    subgoals = [word for word in SUBGOALS if bare(word) in met]
    rooms = len(found.rooms) * len(found.rooms[0])
    return Plan(
        name=found.name or path.stem,
        summary=found.summary or f"{mission_of(found.target).capitalize()}.",
        rooms=found.rooms,
        room_size=found.room_size,
        agent=found.agent,
        doors=doors,
        connect=found.connect,
        things=things,
        target=found.target,
        milestones=_subgoals(found.milestones),
        horizon=found.horizon or min(4 * rooms * found.room_size**2, _LONGEST),
        facts=found.facts or tuple(facts),
        subgoals=_subgoals(found.subgoals) if found.subgoals else tuple(subgoals),
    )


def _doors(found: RoomsFile) -> tuple[Door, ...]:
    return tuple(
        Door(door.near, door.far, door.passage, door.colour or UNLOCKED, door.blocked) for door in found.doors
    )


def _things(found: RoomsFile) -> tuple[Thing, ...]:
    return tuple(
        Thing(thing.thing, thing.room, thing.behind or "", thing.box or "") for thing in found.things
    )


def _subgoals(words: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{bare(word)}()" for word in words)


def _misuses(found: RoomsFile, path: Path) -> Iterator[Problem]:
    """What a schema can't know: names that are taken, words that there are not, and what can't be."""
    problems = [*misnamed(found, path), *_contradictions(found, path)]
    yield from problems
    if not problems:
        yield from _unsolvable(plan_of(found, path))


def _contradictions(found: RoomsFile, _: Path) -> Iterator[Problem]:
    subgoals = dict.fromkeys(map(bare, SUBGOALS))
    problems = [
        *misspelt(
            found,
            Given("milestones", "subgoal", found.milestones, subgoals),
            Given("subgoals", "subgoal", found.subgoals or (), subgoals),
            Given("facts", "fact", found.facts or (), PREDICATES),
        ),
        *(_misplanned(found) or (*_strange_rooms(found), *_wrong_doors(found), *_wrong_things(found))),
    ]
    yield from problems
    if not problems:
        yield from _apart(found)
        yield from _senseless(found)


def _misplanned(found: RoomsFile) -> list[Problem]:
    """Rows of several lengths, names that no room can have, and too large a grid."""
    first, problems = len(found.rooms[0]), []
    for row, names in enumerate(found.rooms):
        if len(names) != first:
            many = f"{len(names)} room{'s' * (len(names) != 1)}"
            problems.append(Problem(("rooms", row), f"a row of {many}, where the first has {first}"))
        for column, name in enumerate(names):
            fits = re.fullmatch("[A-Za-z][A-Za-z0-9_-]{0,31}", name)
            if not fits or name.lower() in ("true", "false", "null"):
                rule = "letters, digits, _ and -, a letter first"
                problems.append(Problem(("rooms", row, column), f"no room is called {name[:40]!r} ({rule})"))
    step = found.room_size - 1
    height, width = len(found.rooms) * step + 1, first * step + 1
    if height * width > MOST_CELLS:
        told = f"a grid of {height} x {width} cells; {MOST_CELLS:,} are the most"
        problems.append(Problem(("room_size",), f"{told}; write fewer rooms, or a smaller room_size"))
    return problems


def _strange_rooms(found: RoomsFile) -> Iterator[Problem]:
    """Rooms that the plan hasn't, and such as stand twice in a list."""
    known = tuple(dict.fromkeys(name for row in found.rooms for name in row))
    lists: list[tuple[KeyPath, tuple[str, ...]]] = [(("agent",), found.agent)]
    for index, door in enumerate(found.doors):
        lists += [(("doors", index, "near"), door.near), (("doors", index, "far"), door.far)]
    lists += [(("things", index, "room"), thing.room) for index, thing in enumerate(found.things)]
    for place, rooms in lists:
        for index, room in enumerate(rooms):
            if room not in known:
                yield Problem((*place, index), unknown("room", room, known))
            elif room in rooms[:index]:
                yield Problem((*place, index), f"{room!r} stands twice in {place[-1]}")


def _wrong_doors(found: RoomsFile) -> Iterator[Problem]:
    for index, door in enumerate(found.doors):
        if door.passage not in PASSAGES:
            yield Problem(("doors", index, "passage"), unknown("passage", door.passage, PASSAGES))
        elif door.passage != "locked" and door.colour is not None:
            yield Problem(("doors", index, "colour"), "only a locked door has a colour, that of its key")
        elif door.passage == "locked" and door.colour is None:
            yield Problem(("doors", index), "a locked door has the colour of its key; write colour: red")
        elif door.colour == UNLOCKED:
            yield Problem(("doors", index, "colour"), "grey are the doors that aren't locked; take another")
        elif door.colour is not None and door.colour not in COLOURS:
            yield Problem(("doors", index, "colour"), unknown("colour", door.colour, COLOURS))


def _wrong_things(found: RoomsFile) -> Iterator[Problem]:
    locked = Counter(door.colour for door in found.doors if door.passage == "locked")
    here = Counter(thing.thing for thing in found.things)
    for index, thing in enumerate(found.things):
        place = ("things", index)
        if thing.thing not in THINGS:
            yield Problem((*place, "thing"), unknown("thing", thing.thing, THINGS))
        elif thing.thing == GOAL != found.target and here[found.target]:
            yield Problem((*place, "thing"), "a goal ends the episode; write target: goal, or leave it out")
        if thing.behind is not None:
            if thing.room:
                yield Problem((*place, "behind"), "it lies in a room or behind a door; write one of both")
            elif not locked[thing.behind]:
                known = tuple(sorted(filter(None, locked))) or ("none",)
                yield Problem((*place, "behind"), unknown("locked door", thing.behind, known))
            elif locked[thing.behind] > 1:
                told = f"{locked[thing.behind]} locked doors are {thing.behind}; write room: instead"
                yield Problem((*place, "behind"), told)
        if thing.box is not None:
            if not thing.thing.endswith(" key") or thing.thing == found.target:
                yield Problem((*place, "box"), "only a key that isn't the target can be in a box")
            elif thing.box not in COLOURS:
                yield Problem((*place, "box"), unknown("colour", thing.box, COLOURS))
    if not here[found.target]:
        yield Problem(("target",), unknown("target", found.target, tuple(here)))
    elif here[found.target] > 1:
        yield Problem(("target",), f"{here[found.target]} things are a {found.target}; the target is one")


def _apart(found: RoomsFile) -> Iterator[Problem]:
    """Rooms of one name, and those of a door, that don't lie side by side."""
    ground = Ground(plan_of(found, Path("Unnamed")))
    areas: dict[str, set[tuple[int, int]]] = {}
    for row, names in enumerate(found.rooms):
        for column, name in enumerate(names):
            if (row, column) not in areas.setdefault(name, _area(found.rooms, row, column)):
                told = f"another {name} lies elsewhere; rooms of one name are one, side by side"
                yield Problem(("rooms", row, column), told)
    pairs = {pair for wall in ground.walls for pair in (wall.rooms, wall.rooms[::-1])}
    for index, door in enumerate(found.doors):
        if pairs.isdisjoint((near, far) for near in door.near for far in door.far):
            told = f"{' or '.join(door.far)} doesn't lie beside {' or '.join(door.near)}"
            yield Problem(("doors", index, "far"), told)


def _area(rooms: Sequence[Sequence[str]], row: int, column: int) -> set[tuple[int, int]]:
    """The places of one name that are joined with a place."""
    queue = [(row, column)]
    for y, x in queue:
        for place in ((y, x + 1), (y, x - 1), (y + 1, x), (y - 1, x)):
            inside = 0 <= place[0] < len(rooms) and 0 <= place[1] < len(rooms[0])
            if inside and place not in queue and rooms[place[0]][place[1]] == rooms[row][column]:
                queue.append(place)
    return set(queue)


def _senseless(found: RoomsFile) -> Iterator[Problem]:
    """Facts and subgoals of what isn't there."""
    plan = plan_of(found, Path("Unnamed"))
    there: Mapping[str, Need] = needs(plan.doors, plan.connect, plan.things, plan.target)
    usual = "" if any(there[word].met for word in PREDICATES) else _USUAL_FACT
    for key in ("milestones", "subgoals", "facts"):
        for index, word in enumerate(map(bare, getattr(found, key) or ())):
            if not there[word].met and word != usual:
                yield Problem((key, index), f"{word} needs {there[word].told}")
            elif key == "milestones" and f"{word}()" not in plan.subgoals:
                yield Problem((key, index), f"{word} isn't among the subgoals; write it there, too")
    solving = "gt_goal()" if found.target == GOAL else "gt_target()"
    if solving not in plan.subgoals:
        yield Problem(("subgoals",), f"{bare(solving)} solves the task; write it there, too")


def _unsolvable(plan: Plan) -> Iterator[Problem]:
    """What has no place, and what can't be reached, or holds from the start, in layouts of the task."""
    ground, rng = Ground(plan), np.random.default_rng(0)
    solvable: list[Layout] = []
    failed: list[Layout] = []
    faults: Counter[tuple[KeyPath, str]] = Counter()
    missing: dict[Split, int] = {"training": _OF_EACH_SPLIT, "evaluation": _OF_EACH_SPLIT}
    for drawn in range(1, _LOOKED_FOR + 1):
        try:
            layout = ground.drawn(rng)
        except NoPlaceError as error:
            faults[error.place, str(error)] += 1
        else:
            if ground.reached(layout) >> layout.target & 1:
                solvable.append(layout)
                missing["evaluation" if layout.is_of("evaluation") else "training"] -= 1
            else:
                failed.append(layout)
        if drawn == _DRAWN and len(solvable) < _SOLVED * _DRAWN:
            yield _never(plan, ground, failed, faults)
            return
        if drawn >= _DRAWN and max(missing.values()) <= 0:
            yield from _from_the_start(plan, solvable[:_STARTS])
            return
    yield Problem(("rooms",), "hardly two layouts differ, so none is left to evaluate on; write larger rooms")


def _never(
    plan: Plan, ground: Ground, failed: list[Layout], faults: "Counter[tuple[KeyPath, str]]"
) -> Problem:
    """Why hardly a layout can be solved."""
    if faults.total() > len(failed):
        (place, told), _ = faults.most_common(1)[0]
        return Problem(place, told)
    told = f"{plan.target} can't be reached in {len(failed)} of {_DRAWN} layouts"
    told = told if len(failed) < _DRAWN else f"{plan.target} can't be reached"
    return Problem(("target",), f"{told}: {_why(plan, ground, failed[0])}")


def _why(plan: Plan, ground: Ground, layout: Layout) -> str:
    opened = {
        cell: item._replace(what="open") if item.is_door else item for cell, item in layout.items.items()
    }
    if not ground.reached(layout._replace(items=opened)) >> layout.target & 1:
        return "no way leads there from the agent"
    inside = ground.reached(layout)
    width = ground.width
    edge = inside << 1 | inside >> 1 | inside << width | inside >> width
    shut = sorted(
        item.colour for cell, item in layout.items.items() if item.what == "locked" and edge >> cell & 1
    )
    keys = {thing.what for thing in plan.things}
    colour = next((colour for colour in shut if f"{colour} key" not in keys), shut[0])
    why = f"the {colour} key is beyond what can be reached"
    why = why if f"{colour} key" in keys else f"there is no {colour} key"
    return f"the {colour} door never opens, as {why}"


def _from_the_start(plan: Plan, layouts: Sequence[Layout]) -> Iterator[Problem]:
    if not plan.milestones:
        return
    from paddlectl.tasks.rooms.env import RoomsEnv  # loads MiniGrid

    env, first = RoomsEnv(plan), set()
    for layout in layouts:
        env.place(layout)
        first |= env.holding()
    for index, subgoal in enumerate(plan.milestones):
        if subgoal in first:
            told = f"{bare(subgoal)} holds at the start already, so it is no milestone"
            yield Problem(("milestones", index), told)


_SECTIONS: Mapping[KeyPath, type[Closed]] = {
    (): RoomsFile,
    ("doors", "*"): DoorWords,
    ("things", "*"): ThingWords,
}
KIND = Kind("task", RoomsFile, _SECTIONS, _misuses)
STORED = replace(KIND, misuses=_contradictions)
