"""What lies on the way in a grid of MiniGrid, read off its full grid: doors, keys, and what blocks them.

All is told by ways: the cheapest from one cell to another, where to pass a closed door or an object costs
some steps, and a locked door many: the more, the more others must be unlocked for its key. The *door* is the
first locked one on the way to what solves the task, the *key* is of its colour; where a locked door is on the
way to that, it is the *door*, and so on. What comes next is the key, a box that may hide it, the door, or
what solves the task. The *passage* is the first closed door on the way there, the *blockage* the first object
on that way, or else on the whole one, before a door that isn't open. So however many rooms, doors and keys
there are, all is told of those that come next.
"""

from functools import cached_property
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np

from paddlectl.tasks.base import Floats

NOWHERE = -1
REACH = 3  # cells seen to each side
_CLOSED, _OBJECT, _LOCKED = 5, 30, 1000  # what it costs to pass, in steps
_LATER = 64  # times as much as a locked door whose key can be had before
_FAR = _LOCKED * _LATER**64
_THINGS = ("key", "ball", "box")


class Facts(NamedTuple):
    """What is so with the agent in one cell.

    Attributes:
        key_held: The door's key is in hand; any key, if no door is locked any more.
        key_seen: The door's key lies on the grid.
        other_held: Something else is in hand.
        opened: No locked door is on the way.
        blocked: There is a blockage.
        clear: No closed door is on the way to what comes next.
        at_goal: The agent stands on the green square.
        target_held: What solves the task is in hand.
        door: Its cell, or NOWHERE; so with the others.
        key: Where it lies.
        blockage: Where it lies.
        passage: Where it is.
        box: The nearest that may hide a key.
        target: What solves the task.
        spent: In hand is a key whose doors are all unlocked, and it isn't the door's.
    """

    key_held: bool
    key_seen: bool
    other_held: bool
    opened: bool
    blocked: bool
    clear: bool
    at_goal: bool
    target_held: bool
    door: int
    key: int
    blockage: int
    passage: int
    box: int
    target: int
    spent: bool


class Map:
    """A grid as it is between two changes. Cells are numbered row by row.

    Args:
        env: MiniGrid's environment.

    Attributes:
        width: Cells in a row.
        cells: MiniGrid's object in each cell, or None.
        held: What is in hand, or None.
        seen: Of each cell around which the agent may stand, the observations that were made there.
    """

    def __init__(self, env: Any) -> None:
        self.width: int = env.grid.width
        self.cells: list[Any] = list(env.grid.grid)
        self.held: Any = env.carrying
        self.seen: dict[Any, Floats] = {}
        self._object: Any = getattr(env, "obj", None)
        self._target = self._find_target()
        self._ways: dict[int, tuple[list[int], list[int]]] = {}
        self._facts: dict[int, Facts] = {}
        self._costs = [self._cost(cell) for cell in self.cells]
        x, y = env.agent_pos
        self._raise_costs(int(y) * self.width + int(x))

    def _find_target(self) -> int:
        for number, cell in enumerate(self.cells):
            if cell is not None and (cell is self._object if self._object else cell.type == "goal"):
                return number
        return NOWHERE

    def _cost(self, cell: Any) -> int:
        if cell is None or cell.can_overlap():
            return 1
        if cell.type == "door":
            return _LOCKED if cell.is_locked else _CLOSED
        return _OBJECT if cell.type in _THINGS else _FAR

    def _raise_costs(self, agent: int) -> None:
        """Makes each locked door dearer than all whose keys can be had before its own."""
        locked = [cell for cell, cost in enumerate(self._costs) if cost == _LOCKED]
        if len(locked) < 2:
            return
        inside: set[int] = set()
        cost, edge = _LOCKED, [agent]
        while edge:
            self._flood(inside, edge)
            frontier = [cell for cell in locked if not inside.isdisjoint(self._beside(cell))]
            boxes = not inside.isdisjoint(self._boxes())
            edge = [cell for cell in frontier if self._can_be_opened(cell, inside, boxes)]
            edge = edge or (frontier if boxes else [])
            locked = [cell for cell in locked if cell not in edge]
            for cell in edge:
                self._costs[cell] = cost
            cost *= _LATER
        for cell in locked:
            self._costs[cell] = cost

    def _flood(self, inside: set[int], edge: list[int]) -> None:
        """Adds the cells from which an edge is reached by no locked door."""
        queue = [*edge]
        inside.update(edge)
        for cell in queue:
            for beside in self._beside(cell):
                if beside not in inside and self._costs[beside] < _LOCKED:
                    inside.add(beside)
                    queue.append(beside)

    def _can_be_opened(self, door: int, inside: set[int], boxes: bool) -> bool:
        """Whether its key is at hand; or, if none is anywhere, there are boxes that may hide it."""
        keys = self._keys(self.cells[door].color)
        held = self._is_key(self.held, self.cells[door].color)
        return held or (boxes and not keys) or not inside.isdisjoint(keys)

    def _beside(self, cell: int) -> list[int]:
        cells = (cell - 1, cell + 1, cell - self.width, cell + self.width)
        return [each for each in cells if 0 <= each < len(self.cells)]

    @cached_property
    def obstacles(self) -> Floats:
        """1 where the agent can't walk, with a margin of `REACH` cells. [H + 6, W + 6]"""
        walls = [cell is not None and not cell.can_overlap() for cell in self.cells]
        rows = np.array(walls, np.float32).reshape(-1, self.width)
        return np.pad(rows, REACH, constant_values=1)

    def route(self, start: int, end: int) -> list[int]:
        """The cells of the cheapest way, without the start; empty if there is none."""
        if end == NOWHERE:
            return []
        costs, following = self._way_to(end)
        if costs[start] >= _FAR:
            return []
        cells = []
        while start != end:
            start = following[start]
            cells.append(start)
        return cells

    def _way_to(self, end: int) -> tuple[list[int], list[int]]:
        """Of each cell the cost to get from there to the end, and the next cell on the way (Dijkstra)."""
        if end in self._ways:
            return self._ways[end]
        costs, following = [_FAR] * len(self.cells), [NOWHERE] * len(self.cells)
        costs[end] = 0
        queue = [(0, end)]
        while queue:
            cost, cell = heappop(queue)
            if cost > costs[cell]:
                continue
            more = cost + (1 if cell == end else self._costs[cell])
            for before in self._beside(cell):
                if more < costs[before] and self._costs[before] < _FAR:
                    costs[before], following[before] = more, cell
                    heappush(queue, (more, before))
        self._ways[end] = costs, following
        return self._ways[end]

    def doorway(self, route: list[int]) -> int:
        """The first door on a route, open or not."""
        return next((cell for cell in route if self._is(cell, "door")), NOWHERE)

    def _is(self, cell: int, kind: str) -> bool:
        return self.cells[cell] is not None and self.cells[cell].type == kind

    def facts(self, agent: int) -> Facts:
        """What is so with the agent in that cell."""
        if agent not in self._facts:
            self._facts[agent] = self._told(agent)
        return self._facts[agent]

    def _told(self, agent: int) -> Facts:
        way = self.route(agent, self._target)
        door, key, box = self._locked_way(agent, way)
        colour = self.cells[door].color if door != NOWHERE else None
        key_held = self._is_key(self.held, colour)
        following = next((cell for cell in (key, box, door) if cell != NOWHERE), self._target)
        ahead = [cell for cell in self.route(agent, following) if cell != following]
        passage = next((cell for cell in ahead if self._costs[cell] == _CLOSED), NOWHERE)
        between = self._open(ahead) + [cell for cell in self._open(way) if cell != self._target]
        blockage = next((cell for cell in between if self._costs[cell] == _OBJECT), NOWHERE)
        return Facts(
            key_held=key_held,
            key_seen=key != NOWHERE,
            other_held=self.held is not None and not key_held,
            opened=door == NOWHERE,
            blocked=blockage != NOWHERE,
            clear=passage == NOWHERE,
            at_goal=self._is(agent, "goal"),
            target_held=self.held is not None and self.held is self._object,
            door=door,
            key=key,
            blockage=blockage,
            passage=passage,
            box=box,
            target=self._target,
            spent=not key_held and self._is_spent(self.held),
        )

    def _locked_way(self, agent: int, way: list[int]) -> tuple[int, int, int]:
        """The door that is to be unlocked next, its key, and a box that may hide that."""
        door = key = box = NOWHERE
        tried: set[int] = set()
        while (ahead := self._first_locked(way)) not in {NOWHERE, *tried}:
            door, key, box = ahead, NOWHERE, NOWHERE
            tried.add(door)
            colour = self.cells[door].color
            if self._is_key(self.held, colour):
                break
            keys, boxes = self._keys(colour), self._boxes()
            key = self._nearest(agent, keys, self._costs[door])
            if key == NOWHERE:
                box = self._nearest(agent, boxes, self._costs[door])
            if key == box == NOWHERE:
                key = self._nearest(agent, keys)
            way = self.route(agent, box if key == NOWHERE else key)
        return door, key, box

    def _first_locked(self, way: list[int]) -> int:
        return next((cell for cell in way if self._is_locked(cell)), NOWHERE)

    def _open(self, way: list[int]) -> list[int]:
        """The way as far as no closed or locked door is on it."""
        shut = (n for n, cell in enumerate(way) if self._is(cell, "door") and not self.cells[cell].is_open)
        return way[: next(shut, len(way))]

    def _is_locked(self, cell: int) -> bool:
        return self._is(cell, "door") and bool(self.cells[cell].is_locked)

    def _keys(self, colour: str) -> list[int]:
        """Where keys of a colour lie."""
        return [cell for cell, each in enumerate(self.cells) if self._is_key(each, colour)]

    def _boxes(self) -> list[int]:
        """Those that may hide a key."""
        return [cell for cell in range(len(self.cells)) if self._is(cell, "box") and cell != self._target]

    def _is_spent(self, thing: Any) -> bool:
        if not self._is_key(thing, None):
            return False
        doors = [cell for cell in range(len(self.cells)) if self._is(cell, "door")]
        fitting = [cell for cell in doors if self.cells[cell].color == thing.color]
        return bool(fitting) and not any(self._is_locked(cell) for cell in fitting)

    def _is_key(self, thing: Any, colour: str | None) -> bool:
        return thing is not None and thing.type == "key" and colour in (None, thing.color)

    def _nearest(self, agent: int, cells: list[int], within: int = _FAR) -> int:
        """The cell to which the way is the cheapest, and costs less than that."""
        costs = {cell: self._way_to(cell)[0][agent] for cell in cells}
        near = [cell for cell in cells if costs[cell] < within]
        return min(near, key=costs.__getitem__, default=NOWHERE)


class View(NamedTuple):
    """A state as all functions of a task are given it.

    Attributes:
        map: The grid.
        agent: The agent's cell.
        facing: Its direction.
    """

    map: Map
    agent: int
    facing: int

    @property
    def facts(self) -> Facts:
        return self.map.facts(self.agent)
