"""Shortest plans in primitive actions: A* over the true rules, written here once more.

Its lower bound is the exact cost of an easier world, in which a thing that was put down lies nowhere and can
be taken up again from anywhere. That bound is consistent, so the first plan found is a shortest one.
"""

import heapq
from typing import NamedTuple

import numpy as np

from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.grid import ABSENT, CELLS, DELTA, MIDDLE, WIDTH, Action, Held, Thing
from paddlectl.tasks.minigrid.layouts import Layouts, Passage, Spec

_FACING = (2, 0, 3, 1)  # of left, right, up, down
_STEP = tuple(int(delta) for delta in DELTA)
_ROOMS = frozenset(y * WIDTH + x for y in range(1, 7) for x in range(1, 14) if x != MIDDLE)
_FAR_AWAY = 999
_THING = {Held.KEY: "key", Held.BLOCKAGE: "blockage", Held.BALL: "ball"}


class State(NamedTuple):
    """Cells, or ABSENT for a thing in hand, in its box, or not of this task."""

    agent: int
    facing: int
    held: int
    key: int
    box: int
    blockage: int
    ball: int
    opened: bool


class World:
    """One layout: its rules and its lower bound."""

    def __init__(self, spec: Spec, layouts: Layouts, lane: int) -> None:
        where = [int(cell) for cell in layouts.where[lane]]
        self.spec = spec
        self.passage, self.goal = where[Thing.PASSAGE], where[Thing.GOAL]
        self.tile = {Held.BLOCKAGE: where[Thing.YELLOW_TILE], Held.BALL: where[Thing.RED_TILE]}
        self.floor = _ROOMS - set(self.tile.values())
        self.start = State(
            int(layouts.agent[lane]),
            int(layouts.facing[lane]),
            Held.NOTHING,
            *where[: Thing.GOAL],
            opened=False,
        )
        self.key_cell = min(self.start.key, self.start.box)
        self._phases = _phases(self)
        self._bound = _cost_to_go(self, self._phases)

    def bound(self, state: State) -> int:
        """No plan from here is shorter."""
        return self._bound[self._phases[self.phase(state)]][state.agent * 4 + state.facing]

    def phase(self, state: State) -> "Phase":
        if state.held == Held.KEY:
            key = "held"
        elif state.key == ABSENT:
            key = "boxed" if state.box != ABSENT else "none"
        else:
            key = "there" if state.key == self.key_cell and not state.opened else "down"
        balls = (
            "held"
            if state.held == held
            else "none"
            if cell == ABSENT
            else "placed"
            if cell == self.tile[held]
            else "there"
            if cell == start
            else "down"
            for held, cell, start in (
                (Held.BLOCKAGE, state.blockage, self.start.blockage),
                (Held.BALL, state.ball, self.start.ball),
            )
        )
        return Phase(key, *balls, state.opened)

    def solved(self, state: State) -> bool:
        truth = {
            s.GT_DOOR: state.opened,
            s.GT_BALL: state.held == Held.BALL,
            s.GT_GOAL: state.agent == self.goal,
            s.PLACE_BLOCKAGE: state.blockage == self.tile[Held.BLOCKAGE],
            s.PLACE_BALL: state.ball == self.tile[Held.BALL],
        }
        return all(truth[subgoal] for subgoal in self.spec.success)

    def successors(self, state: State):
        """Every (action, state) that changes something."""
        taken = {state.key, state.box, state.blockage, state.ball}
        for action in range(4):
            facing = _FACING[action]
            front = state.agent + _STEP[facing]
            free = (front in self.floor and front not in taken) or (front == self.passage and state.opened)
            yield action, state._replace(agent=front if free else state.agent, facing=facing)
        front = state.agent + _STEP[state.facing]
        if state.held == Held.NOTHING:
            yield from self._pick_up(state, front)
        else:
            empty = front in self.floor and front not in taken and front != self.goal
            own_tile = front == self.tile.get(state.held) and front not in taken
            if empty or own_tile:
                yield Action.DROP, state._replace(held=Held.NOTHING, **{_THING[state.held]: front})
        if front == state.box:
            yield Action.TOGGLE, state._replace(box=ABSENT, key=front)
        if front == self.passage and not state.opened and self._unlocks(state.held == Held.KEY):
            yield Action.TOGGLE, state._replace(opened=True)

    def _pick_up(self, state: State, front: int):
        for held, name in _THING.items():
            if front == getattr(state, name) and front != self.tile.get(held):
                opened = state.opened or (held == Held.KEY and self.spec.passage is Passage.GAP)
                yield Action.PICK_UP, state._replace(held=held, opened=opened, **{name: ABSENT})

    def _unlocks(self, has_key: bool) -> bool:
        return self.spec.passage is Passage.CLOSED or (self.spec.passage is Passage.LOCKED and has_key)


def shortest_plan(spec: Spec, layouts: Layouts, lane: int = 0, limit: int = 200_000) -> list[int]:
    """The actions of a shortest plan.

    Raises:
        LookupError: If there is none, or the search grows beyond the limit.
    """
    world = World(spec, layouts, lane)
    cost = {world.start: 0}
    came_from: dict[State, tuple[State, int]] = {}
    queue = [(world.bound(world.start), 0, 0, world.start)]
    order = 0
    while queue and len(cost) < limit:
        bound, minus_g, _, state = heapq.heappop(queue)
        if world.solved(state):
            return _actions(came_from, state)
        if -minus_g > cost[state] or bound >= _FAR_AWAY:
            continue
        for action, successor in world.successors(state):
            g = cost[state] + 1
            if g < cost.get(successor, _FAR_AWAY):
                cost[successor] = g
                came_from[successor] = (state, action)
                order -= 1
                heapq.heappush(queue, (g + world.bound(successor), -g, order, successor))
    raise LookupError(f"no plan for layout {lane} of {spec.name}")


def _actions(came_from: dict[State, tuple[State, int]], state: State) -> list[int]:
    actions = []
    while state in came_from:
        state, action = came_from[state]
        actions.append(int(action))
    return actions[::-1]


class Phase(NamedTuple):
    """The easier world but for the agent.

    A thing is none, boxed, there (where it began), held, down (somewhere) or placed.
    """

    key: str
    blockage: str
    ball: str
    opened: bool

    @property
    def holding(self) -> str | None:
        return next((name for name in ("key", "blockage", "ball") if getattr(self, name) == "held"), None)


def _phases(world: World) -> dict[Phase, int]:
    """Every phase that can follow from the first, as far as the task isn't solved before."""
    found = {world.phase(world.start): 0}
    for phase in (queue := list(found)):
        for _, _, after in () if _done(world, phase).all() else _interactions(world, phase):
            if after not in found:
                found[after] = len(found)
                queue.append(after)
    return found


def _cost_to_go(world: World, phases: dict[Phase, int]) -> list[list[int]]:
    """The easier world's exact costs over phase x (cell, facing), by sweeps until nothing changes."""
    cells = np.arange(CELLS)
    front = np.clip(cells[:, None] + DELTA, 0, CELLS - 1)
    free = np.stack([_free(world, phase) for phase in phases])
    n = len(phases)
    base = np.arange(n)[:, None] * CELLS * 4
    moves = np.stack([base + np.where(free[:, front[:, d]], front[:, d], cells) * 4 + d for d in range(4)])
    poses = np.arange(n * CELLS * 4).reshape(n, CELLS, 4)
    acts = np.tile(poses, (4, 1, 1, 1))
    cost = np.full((n, CELLS, 4), _FAR_AWAY, dtype=np.int16)
    for phase, i in phases.items():
        cost[i][_done(world, phase)] = 0
        for kind, where, after in () if cost[i].max() == 0 else _interactions(world, phase):
            mask = where[front] if where is not None else np.ones_like(front, dtype=bool)
            acts[kind, i][mask] = poses[phases[after]][mask]
    acts = [(np.flatnonzero(to != poses), to[to != poses]) for to in acts]
    while True:
        best = cost.take(moves).min(axis=0)[:, :, None]
        new = np.minimum(cost, 1 + best)
        for before, after in acts:
            new.ravel()[before] = np.minimum(new.take(before), 1 + cost.take(after))
        if np.array_equal(new, cost):
            return cost.reshape(n, -1).tolist()
        cost = new


def _mask(*cells: int) -> np.ndarray:
    mask = np.zeros(CELLS + 1, dtype=bool)
    mask[list(cells)] = True
    return mask[:CELLS]


def _free(world: World, phase: Phase) -> np.ndarray:
    taken = {world.key_cell} if phase.key in ("boxed", "there") else set()
    taken |= {world.start.blockage} if phase.blockage == "there" else set()
    taken |= {world.start.ball} if phase.ball == "there" else set()
    return _mask(*(world.floor - taken), *([world.passage] if phase.opened else []))


def _done(world: World, phase: Phase) -> np.ndarray:
    truth = {
        s.GT_DOOR: phase.opened,
        s.GT_BALL: phase.ball == "held",
        s.PLACE_BLOCKAGE: phase.blockage == "placed",
        s.PLACE_BALL: phase.ball == "placed",
    }
    if world.spec.success == (s.GT_GOAL,):
        return _mask(world.goal)
    return np.full(CELLS, all(truth[subgoal] for subgoal in world.spec.success))


def _interactions(world: World, phase: Phase):
    """What can be done: (kind, the cells in front where it works, the phase after); None: all cells.

    Of one kind, one thing at most can be done in a pose.
    """
    start = {"key": world.key_cell, "blockage": world.start.blockage, "ball": world.start.ball}
    tile = {"blockage": world.tile[Held.BLOCKAGE], "ball": world.tile[Held.BALL]}
    needed = {"key": not phase.opened, "blockage": s.PLACE_BLOCKAGE in world.spec.success, "ball": True}
    if phase.holding is None:
        for kind, (name, cell) in enumerate(start.items()):
            gap = name == "key" and world.spec.passage is Passage.GAP
            after = phase._replace(**{name: "held"}, opened=phase.opened or gap)
            if getattr(phase, name) == "down" and needed[name]:
                yield kind, None, after
            elif getattr(phase, name) == "there":
                yield kind, _mask(cell), after
    else:
        yield 0, _free(world, phase) & ~_mask(world.passage), phase._replace(**{phase.holding: "down"})
        if phase.holding != "key" or not phase.opened:
            yield 0, _mask(start[phase.holding]), phase._replace(**{phase.holding: "there"})
        if phase.holding in tile:
            yield 0, _mask(tile[phase.holding]), phase._replace(**{phase.holding: "placed"})
    if phase.key == "boxed":
        yield 3, _mask(world.key_cell), phase._replace(key="there")
    if not phase.opened and world._unlocks(phase.key == "held"):
        yield 3, _mask(world.passage), phase._replace(key=_later(phase.key), opened=True)


def _later(key: str) -> str:
    """The key once the passage is open: where it lies no longer matters."""
    return "down" if key == "there" else key
