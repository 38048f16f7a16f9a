"""How the layouts of several rooms are drawn, and which of them can be solved.

A layout can be solved if it can in an easier world, where a thing is in the way of nobody, as the agent may
carry it off, and where all keys that it came to are at hand.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from paddlectl.errors import PaddlectlError
from paddlectl.tasks.base import Ints, Split
from paddlectl.tasks.rooms.plan import BLOCKING, COLOURS, PASSAGES, THINGS, UNLOCKED, Plan
from paddlectl.tasks.split import belongs

T = TypeVar("T")

TRIES = 20_000
"""Layouts that are drawn until one can be solved and is of the split."""


_KINDS = (*PASSAGES, *THINGS)


class Item(NamedTuple):
    """What is in a cell.

    Attributes:
        what: One of THINGS; of a door, one of PASSAGES.
        colour: Of a door, or of the box that holds the thing; else empty.
    """

    what: str
    colour: str = ""

    @property
    def is_door(self) -> bool:
        return self.what in PASSAGES

    @property
    def code(self) -> int:
        """A number below 256 for each."""
        colour = COLOURS.index(self.colour) + 1 if self.colour else 0
        return _KINDS.index(self.what) * (len(COLOURS) + 1) + colour


class Layout(NamedTuple):
    """A starting position. Cells are numbered row by row.

    Attributes:
        agent: The agent's cell.
        facing: Its direction.
        items: What is in cells.
        target: The cell of what solves the task.
    """

    agent: int
    facing: int
    items: dict[int, Item]
    target: int

    def is_of(self, split: Split) -> bool:
        """Whether it belongs to a split, which its facing has no part in."""
        cells = [cell << 8 | self.items[cell].code for cell in sorted(self.items)]
        values: Ints = np.array([[self.agent, *cells]])
        return bool(belongs(values, split)[0])


class NoPlaceError(Exception):
    """A door, a thing or the agent has no place in a layout as far as that is drawn.

    Args:
        place: Where the task file has it.
        message: Why.
    """

    def __init__(self, place: tuple[str | int, ...], message: str) -> None:
        super().__init__(message)
        self.place = place


class Wall(NamedTuple):
    """Between two places of the plan that lie side by side.

    Attributes:
        rooms: Their names; the left or upper one is the first.
        cells: Where a door may be.
        across: From the second's side of a door to the first's, in cells.
    """

    rooms: tuple[str, str]
    cells: range
    across: int


class Ground:
    """What is the same in all layouts of a task, and how the rest is drawn.

    Attributes:
        width: Cells in a row.
        floor: Cells that aren't walls, as bits; a door's is a wall.
        walls: All in which a door may be.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._step = plan.room_size - 1
        self.height = self._step * len(plan.rooms) + 1
        self.width = self._step * len(plan.rooms[0]) + 1
        self._cells: dict[str, list[int]] = defaultdict(list)
        self.walls: list[Wall] = []
        for row, names in enumerate(plan.rooms):
            for column, name in enumerate(names):
                self._add_room(row, column, name)
        self.floor = _bits(cell for cells in self._cells.values() for cell in cells)

    def _add_room(self, row: int, column: int, name: str) -> None:
        step, width, rooms = self._step, self.width, self.plan.rooms
        first = row * step * width + column * step
        inner = range(1, step)
        self._cells[name] += [first + y * width + x for y in inner for x in inner]
        right = range(first + width + step, first + step * width + step, width)
        below = range(first + step * width + 1, first + step * width + step)
        beside = [(row, column + 1, right, -1), (row + 1, column, below, -width)]
        for other_row, other_column, cells, across in beside:
            if other_row < len(rooms) and other_column < len(rooms[0]):
                other = rooms[other_row][other_column]
                if other == name:
                    self._cells[name] += cells
                else:
                    self.walls.append(Wall((name, other), cells, across))

    def cells_of(self, room: str) -> list[int]:
        """The floor of a room."""
        return self._cells[room]

    def drawn(self, rng: np.random.Generator) -> Layout:
        """Any layout, whether it can be solved or not.

        Raises:
            NoPlaceError: If something has no place.
        """
        return _Drawing(self, rng).layout()

    def drawn_of(self, split: Split, rng: np.random.Generator) -> Layout:
        """A layout of a split that can be solved.

        Raises:
            PaddlectlError: If there is hardly one.
        """
        for _ in range(TRIES):
            try:
                layout = self.drawn(rng)
            except NoPlaceError:
                continue
            if layout.is_of(split) and self.reached(layout) >> layout.target & 1:
                return layout
        raise PaddlectlError(f"{self.plan.name} has hardly a layout for {split}", "give its rooms more cells")

    def reached(self, layout: Layout) -> int:
        """The cells that the agent comes to, as bits."""
        locks: dict[str, int] = defaultdict(int)
        keys: dict[str, int] = defaultdict(int)
        free = self.floor
        for cell, (what, colour) in layout.items.items():
            if what == "locked":
                locks[colour] |= 1 << cell
            elif what in PASSAGES:
                free |= 1 << cell
            elif what.endswith(" key"):
                keys[what.removesuffix(" key")] |= 1 << cell
        region, before = 1 << layout.agent, 0
        while region != before:
            before = region
            around = region << 1 | region >> 1 | region << self.width | region >> self.width
            region |= around & free
            for colour in [colour for colour in locks if region & keys[colour]]:
                free |= locks.pop(colour)
                before = 0
        return region


class _Drawing:
    """One layout while it is drawn."""

    def __init__(self, ground: Ground, rng: np.random.Generator) -> None:
        self._ground, self._rng = ground, rng
        self._items: dict[int, Item] = {}
        self._beside: set[int] = set()  # cells beside doors
        self._behind: dict[str, str] = {}  # colour of a locked door -> the room that it leads to
        self._left = {number: wall for number, wall in enumerate(ground.walls)}
        self._joined: dict[str, set[str]] = {name: {name} for row in ground.plan.rooms for name in row}

    def layout(self) -> Layout:
        plan, rng = self._ground.plan, self._rng
        for number in range(len(plan.doors)):
            self._add_door(number)
        if plan.connect:
            self._connect()
        cells = [self._add_thing(number) for number in range(len(plan.things))]
        target = cells[[thing.what for thing in plan.things].index(plan.target)]
        rooms = plan.agent or tuple(self._joined)
        free = [cell for cell in self._ground.cells_of(self._one(rooms)) if cell not in self._items]
        if not free:
            raise NoPlaceError(("agent",), "no cell is free where the agent is to start")
        return Layout(self._one(free), int(rng.integers(4)), self._items, target)

    def _one(self, among: Sequence[T]) -> T:
        return among[int(self._rng.integers(len(among)))]

    def _add_door(self, number: int) -> None:
        door = self._ground.plan.doors[number]
        fitting = [
            (each, turned)
            for each, wall in self._left.items()
            for turned in (False, True)
            if wall.rooms[turned] in door.near and wall.rooms[not turned] in door.far
        ]
        if not fitting:
            raise NoPlaceError(("doors", number), "no wall is left for it between near and far")
        chosen, turned = fitting[int(self._rng.integers(len(fitting)))]
        wall = self._left[chosen]
        cell = self._put_door(chosen, Item(door.passage, door.colour))
        near = cell - wall.across if turned else cell + wall.across
        if door.passage == "locked":
            self._behind[door.colour] = wall.rooms[not turned]
        if door.blocked:
            if near in self._items:
                raise NoPlaceError(("doors", number, "blocked"), "another ball stands there")
            self._items[near] = Item(BLOCKING)

    def _put_door(self, number: int, item: Item) -> int:
        wall = self._left.pop(number)
        cell = wall.cells[int(self._rng.integers(len(wall.cells)))]
        self._items[cell] = item
        self._beside |= {cell + wall.across, cell - wall.across}
        together = self._joined[wall.rooms[0]] | self._joined[wall.rooms[1]]
        self._joined.update(dict.fromkeys(together, together))
        return cell

    def _connect(self) -> None:
        """Adds closed doors in any order until all rooms are joined; none to a room that is locked."""
        shut = set(self._behind.values())
        order = [*self._left]
        self._rng.shuffle(order)
        for number in order:
            if len(self._joined[self._ground.plan.rooms[0][0]]) == len(self._joined):
                return
            if shut.isdisjoint(self._left[number].rooms):
                self._put_door(number, Item("closed", UNLOCKED))

    def _add_thing(self, number: int) -> int:
        thing = self._ground.plan.things[number]
        rooms = thing.room or tuple(self._joined)
        room = self._behind[thing.behind] if thing.behind else self._one(rooms)
        free = [cell for cell in self._ground.cells_of(room) if cell not in self._items]
        if not free:
            raise NoPlaceError(("things", number), f"no cell of {room} is free for the {thing.what}")
        cell = self._one([cell for cell in free if cell not in self._beside] or free)
        self._items[cell] = Item(thing.what, thing.box)
        return cell


def _bits(cells: Iterable[int]) -> int:
    return sum(1 << cell for cell in set(cells))
