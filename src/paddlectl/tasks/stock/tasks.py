"""MiniGrid's own environments as tasks, as they are: their layouts, their rewards, their horizons.

Facts and observations are read off the full grid, where MiniGrid's own agents see 7 x 7 cells in front of
them; what a closed box holds isn't read. An agent turns and goes forward, so all is seen in its own frame:
forward and to the right. In order:

- 49: the 7 x 7 cells around the agent, row by row from the left in front; 1 where it can't walk
- 8: the target: present, forward / 10, right / 10, their signs, forward = 0, right = 0, the cell in front
- 8: the next door on the way to it, open or not, likewise
- 4: the cell in front is free, a door, an object, none of these
- 3: in hand is nothing, the key, something else

The target is what the subgoal acts on. Without one its numbers are 0, and the door is the next on the way to
what solves the task.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from paddlectl.plugins import attribute
from paddlectl.tasks.base import Floats, Task
from paddlectl.tasks.gymnasium import GymnasiumTask, Subgoal
from paddlectl.tasks.stock.families import FAMILIES
from paddlectl.tasks.stock.ways import NOWHERE, REACH, Facts, View

DOMAIN = "minigrid-stock"
_SIDE = 2 * REACH + 1
_FORWARD = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by MiniGrid's direction: right, down, left, up


def _watched(env: Any) -> Any:
    return attribute("paddlectl.tasks.stock.watched:Watched")(env)


def _view(env: Any) -> View:
    view: View = env.view()
    return view


PREDICATES: dict[str, Callable[[View], bool]] = {
    "has_key(agent)": lambda view: view.facts.key_held,
    "has_key(env)": lambda view: view.facts.key_seen,
    "has_blockage(agent)": lambda view: view.facts.other_held,
    "is_open(door)": lambda view: view.facts.opened,
    "is_blocked(door)": lambda view: view.facts.blocked,
    "is_open(way)": lambda view: view.facts.clear,
}
EXCLUSIONS = (
    ("has_key(agent)", "has_blockage(agent)"),
    ("has_key(agent)", "has_key(env)"),
    ("has_key(env)", "is_open(door)"),
)


def _around(view: View) -> Floats:
    """The obstacles around the agent, seen in its own frame. [49]"""
    y, x = divmod(view.agent, view.map.width)
    window = view.map.obstacles[y : y + _SIDE, x : x + _SIDE]
    return np.rot90(window, view.facing + 1).ravel()  # its forward becomes up


def _relative(view: View, cell: int) -> list[float]:
    """A cell in the agent's own frame. [8]"""
    if cell == NOWHERE:
        return [0.0] * 8
    (y, x), (to_y, to_x) = divmod(view.agent, view.map.width), divmod(cell, view.map.width)
    (ahead_x, ahead_y), dx, dy = _FORWARD[view.facing], to_x - x, to_y - y
    forward, right = dx * ahead_x + dy * ahead_y, dy * ahead_x - dx * ahead_y
    signs = (forward > 0) - (forward < 0), (right > 0) - (right < 0)
    front = forward == 1 and right == 0
    return [1.0, forward / 10, right / 10, *signs, forward == 0, right == 0, front]


def _near(view: View) -> list[float]:
    """The cell in front, and what is in hand. [7]"""
    ahead_x, ahead_y = _FORWARD[view.facing]
    cell, facts = view.map.cells[view.agent + ahead_y * view.map.width + ahead_x], view.facts
    free = cell is None or cell.can_overlap()
    door = not free and cell.type == "door"
    thing = not free and cell.can_pickup()
    return [
        *(free, door, thing, not (free or door or thing)),
        *(view.map.held is None, facts.key_held, facts.other_held),
    ]


def _sees(target: Callable[[Facts], int], view: View) -> Floats:
    """What is seen of a subgoal with that target. [72]"""
    cell = target(view.facts)
    place = view.agent, view.facing, cell
    if place not in view.map.seen:
        way = view.map.route(view.agent, view.facts.target if cell == NOWHERE else cell)
        door = view.map.doorway([each for each in way if each != cell])
        numbers = [*_relative(view, cell), *_relative(view, door), *_near(view)]
        view.map.seen[place] = np.append(_around(view), numbers).astype(np.float32)
    return view.map.seen[place]


def _distance(target: Callable[[Facts], int], view: View) -> float:
    return float(len(view.map.route(view.agent, target(view.facts))))


def _subgoal(
    target: Callable[[Facts], int], reached: Callable[[Facts], bool], available: Callable[[Facts], bool]
) -> Subgoal:
    return Subgoal(
        reached=lambda view: reached(view.facts),
        sees=partial(_sees, target),
        available=lambda view: available(view.facts),
        distance=partial(_distance, target),
    )


def _nothing(facts: Facts) -> int:
    return NOWHERE


def _free(facts: Facts) -> bool:
    """Nothing is in hand."""
    return not (facts.key_held or facts.other_held)


SUBGOALS = {
    "gt_blockage()": _subgoal(lambda f: f.blockage, lambda f: f.other_held, lambda f: f.blocked and _free(f)),
    "put_blockage()": _subgoal(
        _nothing, lambda f: not f.other_held and not f.blocked, lambda f: f.other_held
    ),
    "gt_box()": _subgoal(lambda f: f.box, lambda f: f.key_seen, lambda f: f.box != NOWHERE),
    "gt_key()": _subgoal(lambda f: f.key, lambda f: f.key_held, lambda f: f.key_seen and _free(f)),
    "gt_door()": _subgoal(lambda f: f.door, lambda f: f.opened or f.spent, lambda f: f.key_held),
    "put_key()": _subgoal(_nothing, lambda f: not f.key_held and not f.blocked, lambda f: f.key_held),
    "gt_passage()": _subgoal(lambda f: f.passage, lambda f: f.clear, lambda f: f.passage != NOWHERE),
    "gt_target()": _subgoal(
        lambda f: f.target, lambda f: f.target_held, lambda f: f.target != NOWHERE and f.opened and _free(f)
    ),
    "gt_goal()": _subgoal(lambda f: f.target, lambda f: f.at_goal, lambda f: f.opened),
}
"""All of the domain. One is available where nothing else has to be done before, as far as a fact tells it."""


def _flat(view: View) -> Floats:
    """The obstacles, all targets, the next door on the way, what is near, and the facts. [120]"""
    facts = view.facts
    targets = (facts.door, facts.key, facts.blockage, facts.passage, facts.box, facts.target)
    door = view.map.doorway(view.map.route(view.agent, facts.target))
    numbers = [number for cell in (*targets, door) for number in _relative(view, cell)]
    return np.append(_around(view), [*numbers, *_near(view), *facts[:8]]).astype(np.float32)


def _solved(view: View) -> bool:
    return view.facts.target_held or view.facts.at_goal


def told_in(atoms: Sequence[str], subgoals: Sequence[str], **more: Any) -> GymnasiumTask:
    """A task of the domain over an environment of MiniGrid's kind, in these facts and subgoals."""
    return GymnasiumTask(
        domain=DOMAIN,
        predicates={atom: PREDICATES[atom] for atom in atoms},
        exclusions=tuple(each for each in EXCLUSIONS if set(each) <= set(atoms)),
        subgoals={subgoal: SUBGOALS[subgoal] for subgoal in subgoals},
        domain_subgoals=tuple(SUBGOALS),
        success=_solved,
        flat=_flat,
        wrap=_watched,
        state=_view,
        **more,
    )


def make_task(name: str) -> Task:
    """The task of that id."""
    family, horizon = FAMILIES[name]
    summary = f"{family.summary} MiniGrid's own."
    env = f"minigrid:{name}"
    return told_in(family.atoms, family.subgoals, env=env, summary=summary, horizon=horizon)(name)
