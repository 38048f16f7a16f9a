"""Whether a task can be solved: all that can come to hold in an easier world, by search over drawn layouts.

In the easier world a thing that was put down is in the way of nobody and can be taken up from anywhere in its
room. So what can't be reached there can't be reached at all.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import Split
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import ABSENT, CELLS, MIDDLE, WIDTH, Thing
from paddlectl.tasks.minigrid.layouts import Layouts, Passage, Spec, draw_layouts

LAYOUTS = 12
"""Of each split that are looked at."""

_NEAR_ROOM = sum(1 << cell for cell in range(CELLS) if cell % WIDTH < MIDDLE)
_FLOOR = sum(1 << cell for cell in range(WIDTH, CELLS - WIDTH) if cell % WIDTH not in (0, MIDDLE, WIDTH - 1))
_FAR_ROOM = _FLOOR & ~_NEAR_ROOM
_CARRIED = (Thing.KEY, Thing.BLOCKAGE, Thing.BALL)
_TILES = (Thing.NOTHING, Thing.YELLOW_TILE, Thing.RED_TILE)
_NONE, _BOXED, _THERE, _IN_HAND, _DOWN_NEAR, _DOWN_FAR, _PLACED = range(7)


class _State(NamedTuple):
    """Where key, blockage and ball are, whether the passage is open, and a cell that the agent can be in."""

    places: tuple[int, int, int]
    opened: bool
    agent: int


class Reached(NamedTuple):
    """What can come to hold in an episode.

    Attributes:
        first: Subgoals that hold when it begins.
        ever: Those that hold at some time until the task is solved.
        solved: Whether all of `success` can hold at once.
        opened: Whether the passage can be opened.
    """

    first: frozenset[Atom]
    ever: frozenset[Atom]
    solved: bool
    opened: bool


def reached(spec: Spec, seed: int = 0) -> list[Reached]:
    """What can be reached in drawn layouts, those for training first, then those for evaluation."""
    splits: tuple[Split, ...] = ("training", "evaluation")
    found = []
    for split in splits:
        layouts = draw_layouts(spec, np.random.default_rng(seed), LAYOUTS, split)
        found += [_World(spec, layouts, index).reached() for index in range(LAYOUTS)]
    return found


class _World:
    """One layout."""

    def __init__(self, spec: Spec, layouts: Layouts, index: int) -> None:
        self._spec = spec
        self._where = [int(cell) for cell in layouts.where[index]]
        self._tiles = sum(_bit(self._where[tile]) for tile in _TILES)
        self._passage = _bit(self._where[Thing.PASSAGE])
        self._beside = self._passage << 1 | self._passage >> 1
        self._goal = _bit(self._where[Thing.GOAL])
        key = _BOXED if self._where[Thing.BOX] != ABSENT else self._at_first(Thing.KEY)
        others = (self._at_first(Thing.BLOCKAGE), self._at_first(Thing.BALL))
        self._first = _State((key, *others), opened=False, agent=int(layouts.agent[index]))

    def _at_first(self, thing: Thing) -> int:
        return _THERE if self._where[thing] != ABSENT else _NONE

    def reached(self) -> Reached:
        known = {self._first}
        queue = [self._first]
        first = self._holding(self._first, _bit(self._first.agent))
        ever, solved, opened = set(first), False, False
        for state in queue:
            region = self._region(state)
            holding = self._holding(state, region)
            ever |= holding
            opened |= state.opened
            if holding.issuperset(self._spec.success):
                solved = True
                continue
            for after in self._successors(state, region):
                if after not in known:
                    known.add(after)
                    queue.append(after)
        return Reached(frozenset(first), frozenset(ever), solved, opened)

    def _cell(self, thing: int) -> int:
        """Of a thing that wasn't touched, or 0."""
        boxed = thing == Thing.KEY and self._where[Thing.BOX] != ABSENT
        return _bit(self._where[Thing.BOX if boxed else thing])

    def _region(self, state: _State) -> int:
        """The cells that the agent can walk to, as bits."""
        free = _FLOOR & ~self._tiles | (self._passage if state.opened else 0)
        for thing, place in zip(_CARRIED, state.places, strict=True):
            if place in (_BOXED, _THERE):
                free &= ~self._cell(thing)
        region, before = 1 << state.agent, 0
        while region != before:
            before = region
            region |= (region << 1 | region >> 1 | region << WIDTH | region >> WIDTH) & free
        return region

    def _holding(self, state: _State, region: int) -> set[Atom]:
        """The subgoals that hold, or can by walking alone."""
        key, blockage, ball = state.places
        there = [
            self._cell(thing)
            for thing, place in zip(_CARRIED, state.places, strict=True)
            if place in (_BOXED, _THERE)
        ]
        clear = not any(cell & self._beside for cell in there)
        truth = {
            s.GT_BLOCKAGE: blockage == _IN_HAND,
            s.PUT_BLOCKAGE: blockage not in (_NONE, _IN_HAND) and clear,
            s.GT_BOX: self._where[Thing.BOX] != ABSENT and key != _BOXED,
            s.GT_KEY: key == _IN_HAND,
            s.GT_DOOR: state.opened,
            s.PUT_KEY: key in (_THERE, _DOWN_NEAR, _DOWN_FAR) and clear,
            s.GT_BALL: ball == _IN_HAND,
            s.GT_GOAL: bool(region & self._goal),
            s.PLACE_BLOCKAGE: blockage == _PLACED,
            s.PLACE_BALL: ball == _PLACED,
        }
        return {subgoal for subgoal, holds in truth.items() if holds}

    def _successors(self, state: _State, region: int) -> Iterator[_State]:
        """What one thing done somewhere in the region makes of it."""
        agent = (region & -region).bit_length() - 1
        edge = region << 1 | region >> 1 | region << WIDTH | region >> WIDTH
        hand_is_free = _IN_HAND not in state.places

        def put(index: int, place: int, *, opens: bool = False) -> _State:
            places = list(state.places)
            places[index] = place
            key, blockage, ball = places
            return _State((key, blockage, ball), state.opened or opens, agent)

        for index, (thing, tile) in enumerate(zip(_CARRIED, _TILES, strict=True)):
            place = state.places[index]
            if place == _BOXED and edge & self._cell(thing):
                yield put(index, _THERE)
            elif place == _IN_HAND:
                if region & _NEAR_ROOM:
                    yield put(index, _DOWN_NEAR)
                if region & _FAR_ROOM:
                    yield put(index, _DOWN_FAR)
                if edge & _bit(self._where[tile]):
                    yield put(index, _PLACED)
            elif hand_is_free and self._can_take(place, thing, region, edge):
                yield put(index, _IN_HAND, opens=thing == Thing.KEY and self._spec.passage is Passage.GAP)
        has_key = state.places[0] == _IN_HAND
        turns = self._spec.passage is Passage.CLOSED or (self._spec.passage is Passage.LOCKED and has_key)
        if not state.opened and turns and edge & self._passage:
            yield _State(state.places, opened=True, agent=agent)

    def _can_take(self, place: int, thing: int, region: int, edge: int) -> bool:
        if place == _THERE:
            return bool(edge & self._cell(thing))
        room = {_DOWN_NEAR: _NEAR_ROOM, _DOWN_FAR: _FAR_ROOM}.get(place, 0)
        return bool(region & room)


def _bit(cell: int) -> int:
    return 0 if cell == ABSENT else 1 << cell
