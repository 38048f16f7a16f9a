"""The seven MiniGrid tasks as data, and how their layouts are drawn.

An eighth task of the same kind is one more entry in SPECS.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, NamedTuple

import numpy as np

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import Bools, Ints, Split
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import ABSENT, CODE_OF_THING, HEIGHT, MIDDLE, WIDTH, Code, Codes, Thing
from paddlectl.tasks.split import belongs

HORIZON = 320


class Passage(Enum):
    """What fills the way between the rooms at first."""

    LOCKED = Code.LOCKED  # opened by toggle with the key in hand
    CLOSED = Code.CLOSED  # opened by toggle
    GAP = Code.GAP  # opens when the key is first picked up


@dataclass(frozen=True)
class Spec:
    """A task of two rooms (`tasks.base.Definition`).

    Attributes:
        name: As typed on the command line.
        summary: One line for a reader.
        mission: The same in MiniGrid's own words, for wrappers that know no others.
        passage: What fills the way between the rooms.
        near: Things in the room of the agent. The blockage stands before the passage; a box holds the key.
        far: Things in the other room.
        milestones: Subgoals that pay once an episode, when they first hold.
        success: Subgoals that solve the task when all of them hold.
        atoms: The vocabulary, in order.
        subgoals: The subgoals that programs may name.
    """

    MADE_BY: ClassVar = "paddlectl.tasks.minigrid.engine:task_of"
    ENVIRONMENT: ClassVar = "paddlectl.tasks.minigrid.env:PaddleEnv"

    name: str
    summary: str = field(compare=False)
    mission: str = field(compare=False)
    passage: Passage
    near: tuple[Thing, ...]
    far: tuple[Thing, ...]
    milestones: tuple[Atom, ...]
    success: tuple[Atom, ...]
    atoms: tuple[Atom, ...]
    subgoals: tuple[Atom, ...]

    @property
    def things(self) -> tuple[Thing, ...]:
        return self.near + self.far

    def document(self) -> dict[str, Any]:
        """All that a task file may say of it, nothing left to be filled in."""
        return {
            "name": self.name,
            "summary": self.summary,
            "passage": self.passage.name.lower(),
            "near": [thing.name.lower() for thing in self.near],
            "far": [thing.name.lower() for thing in self.far],
            "milestones": [subgoal.predicate.name for subgoal in self.milestones],
            "success": [subgoal.predicate.name for subgoal in self.success],
            "facts": [str(atom) for atom in self.atoms],
            "subgoals": [subgoal.predicate.name for subgoal in self.subgoals],
        }


_DOOR = (s.KEY_IN_HAND, s.KEY_IN_SIGHT, s.OPEN, s.BLOCKED)
_DOOR_BALL = (s.KEY_IN_HAND, s.KEY_IN_SIGHT, s.BALL_IN_HAND, s.OPEN, s.BLOCKED)
_BLOCKED = (s.KEY_IN_HAND, s.KEY_IN_SIGHT, s.BLOCKAGE_IN_HAND, s.BALL_IN_HAND, s.OPEN, s.BLOCKED)
_UNLOCK = (s.GT_BLOCKAGE, s.PUT_BLOCKAGE, s.GT_BOX, s.GT_KEY, s.GT_DOOR, s.PUT_KEY, s.GT_BALL)

SPECS = {
    spec.name: spec
    for spec in (
        Spec(
            name="BlockedDoor",
            summary="Clear the yellow ball from the locked door, fetch the key, open the door.",
            mission="pick up the yellow ball, then get the key and open the door",
            passage=Passage.LOCKED,
            near=(Thing.BLOCKAGE, Thing.KEY),
            far=(),
            milestones=(s.PUT_BLOCKAGE,),
            success=(s.GT_DOOR,),
            atoms=(s.KEY_IN_HAND, s.KEY_IN_SIGHT, s.BLOCKAGE_IN_HAND, s.OPEN, s.BLOCKED),
            subgoals=(s.GT_BLOCKAGE, s.PUT_BLOCKAGE, s.GT_KEY, s.GT_DOOR),
        ),
        Spec(
            name="GapBall",
            summary="Take the key out of its box, which opens the gap; fetch the green ball.",
            mission="get the key from the box, then fetch the green ball",
            passage=Passage.GAP,
            near=(Thing.BOX,),
            far=(Thing.BALL,),
            milestones=(s.GT_KEY,),
            success=(s.GT_BALL,),
            atoms=_DOOR_BALL,
            subgoals=(s.GT_BOX, s.GT_KEY, s.PUT_KEY, s.GT_BALL),
        ),
        Spec(
            name="DoorBall",
            summary="Fetch the key, open the locked door, put the key down, fetch the green ball.",
            mission="get the key and open the door, then fetch the green ball",
            passage=Passage.LOCKED,
            near=(Thing.KEY,),
            far=(Thing.BALL,),
            milestones=(s.GT_DOOR,),
            success=(s.GT_BALL,),
            atoms=_DOOR_BALL,
            subgoals=(s.GT_KEY, s.GT_DOOR, s.PUT_KEY, s.GT_BALL),
        ),
        Spec(
            name="OpenGoal",
            summary="Open the unlocked door and go to the goal; the key is of no use.",
            mission="open the door, then go to the goal",
            passage=Passage.CLOSED,
            near=(Thing.KEY,),
            far=(Thing.GOAL,),
            milestones=(),
            success=(s.GT_GOAL,),
            atoms=_DOOR,
            subgoals=(s.GT_KEY, s.GT_DOOR, s.PUT_KEY, s.GT_GOAL),
        ),
        Spec(
            name="BoxDoor",
            summary="Take the key out of its box, open the locked door.",
            mission="get the key from the box, then open the door",
            passage=Passage.LOCKED,
            near=(Thing.BOX,),
            far=(),
            milestones=(s.GT_KEY,),
            success=(s.GT_DOOR,),
            atoms=_DOOR,
            subgoals=(s.GT_BOX, s.GT_KEY, s.GT_DOOR),
        ),
        Spec(
            name="BlockedBoxUnlockPickup",
            summary="Clear the door, take the key out of its box, open the door, fetch the green ball.",
            mission="pick up the yellow ball, get the key from the box, then fetch the green ball",
            passage=Passage.LOCKED,
            near=(Thing.BLOCKAGE, Thing.BOX),
            far=(Thing.BALL,),
            milestones=(s.PUT_BLOCKAGE, s.GT_KEY, s.GT_DOOR),
            success=(s.GT_BALL,),
            atoms=_BLOCKED,
            subgoals=_UNLOCK,
        ),
        Spec(
            name="BlockedBoxPlaceGoal",
            summary="The same door; then the yellow ball on the yellow tile, the green ball on the red tile.",
            mission="put the yellow ball at the yellow square and the green ball at the red square",
            passage=Passage.LOCKED,
            near=(Thing.BLOCKAGE, Thing.BOX, Thing.YELLOW_TILE),
            far=(Thing.BALL, Thing.RED_TILE),
            milestones=(s.PLACE_BLOCKAGE, s.GT_KEY, s.GT_DOOR),
            success=(s.PLACE_BLOCKAGE, s.PLACE_BALL),
            atoms=(*_BLOCKED, s.BLOCKAGE_PLACED),
            subgoals=(*_UNLOCK, s.PLACE_BLOCKAGE, s.PLACE_BALL),
        ),
    )
}


class Layouts(NamedTuple):
    """n starting positions of one task.

    Attributes:
        agent: The agent's cell. [n]
        facing: Its direction. [n]
        where: Cell of each thing, or ABSENT. [n, 9]
    """

    agent: Ints
    facing: Ints
    where: Ints

    def of(self, split: Split) -> Bools:
        """Whether each belongs to a split, which its facing has no part in. [n]"""
        return belongs(np.column_stack([self.agent, self.where]), split)


def start_of(agent: int, facing: int, where: Iterable[int]) -> dict[str, Any]:
    """A layout as JSON: cells by number, of things that are there."""
    things = {thing.name: int(cell) for thing, cell in zip(Thing, where, strict=True) if cell != ABSENT}
    return {"agent": int(agent), "facing": int(facing), "things": things}


def layout_of(spec: Spec, start: Mapping[str, Any]) -> Layouts:
    """The one layout that `start_of` told.

    Raises:
        KeyError, TypeError or ValueError: If it is none of that task.
    """
    agent, facing, things = start["agent"], start["facing"], start["things"]
    cells = {Thing[name]: cell for name, cell in dict(things).items()}
    inside = {y * WIDTH + x for y in range(1, HEIGHT - 1) for x in range(1, WIDTH - 1) if x != MIDDLE}
    told = [agent, *(cells[thing] for thing in spec.things)]
    passages = {y * WIDTH + MIDDLE for y in range(1, HEIGHT - 1)}
    if not (
        cells.keys() == {*spec.things, Thing.PASSAGE}
        and all(type(number) is int for number in (facing, *told))
        and inside.issuperset(told)
        and len({*told}) == len(told)
        and cells[Thing.PASSAGE] in passages
        and facing in range(4)
    ):
        raise ValueError(f"no start of {spec.name}")
    where: Ints = np.full((1, len(Thing)), ABSENT)
    where[0, list(cells)] = list(cells.values())
    return Layouts(np.array([agent]), np.array([facing]), where)


_ROOM = 6  # rooms are 6 x 6 cells
_START = 3  # the agent starts in the first columns, away from the passage


def draw_layouts(spec: Spec, rng: np.random.Generator, count: int, split: Split = "training") -> Layouts:
    """Draws layouts of a split, every one of which can be solved.

    Both cells beside the passage stay free but for the blockage. Everything else that could be in the way
    can be opened or carried off, but for a tile; and no cell depends on the one way that a single tile shuts.
    Two tiles in one room may shut a corner: such layouts aren't drawn.
    """
    drawn, missing = [_drawn(spec, rng, 0)], count
    while missing:
        found = _drawn(spec, rng, missing)
        chosen = found.of(split) & ~_shut_a_corner(found.where)
        drawn.append(Layouts(*(values[chosen] for values in found)))
        missing -= int(chosen.sum())
    return Layouts(*map(np.concatenate, zip(*drawn, strict=True)))


def _drawn(spec: Spec, rng: np.random.Generator, count: int) -> Layouts:
    row = rng.integers(_ROOM, size=count)
    where: Ints = np.full((count, len(Thing)), ABSENT)
    where[:, Thing.PASSAGE] = _cell(MIDDLE, row)
    if Thing.BLOCKAGE in spec.near:
        where[:, Thing.BLOCKAGE] = _cell(MIDDLE - 1, row)
    scattered = [thing for thing in spec.near if thing is not Thing.BLOCKAGE]
    order = _shuffled(rng, row * _ROOM + _ROOM - 1)
    where[:, scattered] = _cell(1 + order % _ROOM, order // _ROOM)[:, : len(scattered)]
    rest = order[:, len(scattered) :]
    start = np.take_along_axis(rest, np.argmax(rest % _ROOM < _START, axis=1)[:, None], axis=1)[:, 0]
    if spec.far:
        order = _shuffled(rng, row * _ROOM)
        where[:, list(spec.far)] = _cell(MIDDLE + 1 + order % _ROOM, order // _ROOM)[:, : len(spec.far)]
    return Layouts(_cell(1 + start % _ROOM, start // _ROOM), rng.integers(4, size=count), where)


def _shut_a_corner(where: Ints) -> Bools:
    """Whether the tiles are on both ways to the corner of a room. [n]"""
    tiles = np.sort(where[:, [Thing.YELLOW_TILE, Thing.RED_TILE]], axis=1)
    shut = np.zeros(len(where), np.bool_)
    for corner, across, down in _CORNERS:
        shut |= (tiles == sorted((corner + across, corner + down))).all(axis=1)
    return shut


def build_grid(spec: Spec, where: Ints) -> Codes:
    """The codes of all cells at the start. [n, 120] uint8"""
    grid = np.zeros((len(where), HEIGHT, WIDTH), dtype=np.uint8)
    grid[:, [0, -1]] = Code.WALL
    grid[:, :, [0, MIDDLE, -1]] = Code.WALL
    flat = grid.reshape(len(where), -1)
    lanes = np.arange(len(where))
    flat[lanes, where[:, Thing.PASSAGE]] = spec.passage.value
    for thing in spec.things:
        flat[lanes, where[:, thing]] = CODE_OF_THING[thing]
    return flat


_CORNERS = [
    (y * WIDTH + x, across, down)
    for left in (1, MIDDLE + 1)
    for x, across in ((left, 1), (left + _ROOM - 1, -1))
    for y, down in ((1, WIDTH), (_ROOM, -WIDTH))
]
"""The corners of the rooms, and how far the cells beside each are. [8, 3]"""


def _cell(x: Ints | int, row: Ints) -> Ints:
    """The cell of a column and a row counted from a room's first."""
    cell: Ints = (row + 1) * WIDTH + x
    return cell


def _shuffled(rng: np.random.Generator, kept_free: Ints) -> Ints:
    """The 36 cells of a room in random order, the one kept free last. [n, 36]"""
    keys = rng.random((len(kept_free), _ROOM * _ROOM))
    np.put_along_axis(keys, kept_free[:, None], 2.0, axis=1)
    order: Ints = np.argsort(keys, axis=1)
    return order
