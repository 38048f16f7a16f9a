"""One that solves tasks of MiniGrid's kind by their facts: always by the first subgoal that is open."""

import numpy as np

from paddlectl.logic.atoms import Literal
from paddlectl.logic.templates import scenes
from paddlectl.tasks.base import Task
from paddlectl.tasks.stock.tasks import SUBGOALS
from paddlectl.tasks.stock.ways import View

LEFT, RIGHT, FORWARD, PICK_UP, DROP, TOGGLE = range(6)
ORDER = (
    *("put_blockage()", "gt_blockage()", "gt_passage()", "gt_box()", "gt_key()", "gt_door()"),
    *("gt_goal()", "put_key()", "gt_target()"),
)
USE = {"gt_box()": TOGGLE, "gt_door()": TOGGLE, "gt_passage()": TOGGLE, "gt_goal()": FORWARD}
TARGETS = {
    "gt_box()": "box",
    "gt_door()": "door",
    "gt_passage()": "passage",
    "gt_goal()": "target",
    "gt_key()": "key",
    "gt_target()": "target",
    "gt_blockage()": "blockage",
}


def turned_to(view: View, cell: int) -> int:
    """A turn towards a neighbouring cell; FORWARD if it is in front."""
    wanted = [1, view.map.width, -1, -view.map.width].index(cell - view.agent)
    return (FORWARD, RIGHT, RIGHT, LEFT)[(wanted - view.facing) % 4]


def planned(view: View, subgoal: str, rng: np.random.Generator) -> int:
    """The next action of one that knows the way."""
    if subgoal not in TARGETS:  # put down what is in hand, where it is in nobody's way
        front = view.agent + [1, view.map.width, -1, -view.map.width][view.facing]
        ends = (view.facts.key, view.facts.box, view.facts.target)
        ways = [cell for end in ends for cell in view.map.route(view.agent, end)]
        if view.map.cells[front] is None and front not in ways:
            return DROP
        return int(rng.choice([LEFT, RIGHT, FORWARD]))
    target = getattr(view.facts, TARGETS[subgoal])
    way = view.map.route(view.agent, target)
    action = turned_to(view, way[0])
    if action == FORWARD and way[0] == target:
        return USE.get(subgoal, PICK_UP)
    return action


def follow_plan(task: Task, lanes: int, seed: int) -> int:
    """How many of as many episodes it solves.

    On the way no scene is met that is excluded, nor a subgoal available that holds.
    """
    allowed = set(scenes(task.vocabulary.atoms, task.vocabulary.exclusions))
    rng, met = np.random.default_rng(0), set()
    batch = task.make(lanes, seed)
    order = [subgoal for subgoal in ORDER if subgoal in map(str, task.subgoals)]
    indices = {subgoal: [*SUBGOALS].index(subgoal) for subgoal in order}
    solved, over = np.zeros(lanes, np.bool_), np.zeros(lanes, np.bool_)
    while not over.all():
        open_to = {s: batch.available(np.full(lanes, indices[s])) for s in order}
        held = {s: batch.reached(np.full(lanes, indices[s])) for s in order}
        assert not any((open_to[s] & held[s]).any() for s in order)
        actions = np.zeros(lanes, np.intp)
        for lane in np.flatnonzero(~over):
            view = batch._state(lane)  # type: ignore[attr-defined]
            first = ["put_key()"] if view.facts.blocked and "put_key()" in order else []
            chosen = next((s for s in first + order if open_to[s][lane]), None)
            actions[lane] = int(rng.integers(3)) if chosen is None else planned(view, chosen, rng)
        met |= set(map(tuple, batch.valuation().tolist()))
        step = batch.step(actions)
        solved |= step.score > 0
        over |= step.terminated | step.truncated
    bodies = {frozenset(map(Literal, task.vocabulary.atoms, truth)) for truth in met}
    assert bodies <= allowed
    return int(solved.sum())
