"""The encoder and the subgoals on states drawn by hand."""

import numpy as np
import pytest

from paddlectl.logic.templates import scenes
from paddlectl.tasks.minigrid import symbols
from paddlectl.tasks.minigrid.grid import Held
from paddlectl.tasks.minigrid.layouts import SPECS
from pictures import parse

NOTHING, KEY, BLOCKAGE, BALL = Held
UNLOCK, PLACE = "BlockedBoxUnlockPickup", "BlockedBoxPlaceGoal"


def rooms(row: str, above: str = "#......#......#") -> str:
    wall, floor = "#" * 15, "#......#......#"
    return "\n".join([wall, floor, above, row, floor, floor, floor, wall])


# task, the passage's row, the hand, what the agent stands on; the atoms, subgoals reached, subgoals available
# fmt: off
STATES = [
    ("BlockedDoor", "#>.k..bL......#", NOTHING, ".",
     "has_key(env) is_blocked(door)",
     "",
     "gt_blockage gt_key gt_door"),
    ("BlockedDoor", "#>.k...L......#", BLOCKAGE, ".",
     "has_key(env) has_blockage(agent)",
     "gt_blockage put_key",
     "put_blockage gt_key gt_door"),
    ("BlockedDoor", "#>.kb..L......#", NOTHING, ".",
     "has_key(env)",
     "put_blockage put_key",
     "gt_blockage gt_key gt_door"),
    ("BlockedDoor", "#>b...kL......#", NOTHING, ".",
     "has_key(env) is_blocked(door)",
     "",
     "gt_blockage gt_key gt_door"),
    ("BlockedDoor", "#>b..../......#", KEY, ".",
     "has_key(agent) is_open(door)",
     "put_blockage gt_key gt_door",
     "gt_blockage put_key"),
    ("BoxDoor", "#>.x...L......#", NOTHING, ".",
     "",
     "",
     "gt_box gt_door"),
    ("BoxDoor", "#>.k...L......#", NOTHING, ".",
     "has_key(env)",
     "gt_box put_key",
     "gt_key gt_door"),
    ("GapBall", "#>.x...|..g...#", NOTHING, ".",
     "",
     "",
     "gt_box gt_door gt_ball"),
    ("GapBall", "#>...../..g...#", KEY, ".",
     "has_key(agent) is_open(door)",
     "gt_box gt_key gt_door",
     "put_key gt_ball"),
    ("GapBall", "#>...../g.....#", KEY, ".",
     "has_key(agent) is_open(door) is_blocked(door)",
     "gt_box gt_key gt_door",
     "put_key gt_ball"),
    ("GapBall", "#....k./.>....#", BALL, ".",
     "has_key(env) has_ball(agent) is_open(door)",
     "gt_box gt_door put_key gt_ball",
     "gt_key"),
    # the agent itself doesn't block
    ("DoorBall", "#..k..>L..g...#", NOTHING, ".",
     "has_key(env)",
     "put_key",
     "gt_key gt_door gt_ball"),
    ("DoorBall", "#.....>/k.g...#", NOTHING, ".",
     "has_key(env) is_open(door) is_blocked(door)",
     "gt_door",
     "gt_key gt_ball"),
    ("OpenGoal", "#>.k...C..G...#", NOTHING, ".",
     "has_key(env)",
     "put_key",
     "gt_key gt_door gt_goal"),
    ("OpenGoal", "#..k.../..>...#", NOTHING, "G",
     "has_key(env) is_open(door)",
     "gt_door put_key gt_goal",
     "gt_key"),
    (UNLOCK, "#>.x..bL..g...#", NOTHING, ".",
     "is_blocked(door)",
     "",
     "gt_blockage gt_box gt_door gt_ball"),
    (UNLOCK, "#>....xL.bg...#", NOTHING, ".",
     "is_blocked(door)",
     "",
     "gt_blockage gt_box gt_door gt_ball"),
    (UNLOCK, "#..b..k/.>....#", BALL, ".",
     "has_key(env) has_ball(agent) is_open(door) is_blocked(door)",
     "gt_box gt_door gt_ball",
     "gt_blockage gt_key"),
    (PLACE, "#>y.x..L.rg...#", BLOCKAGE, ".",
     "has_blockage(agent)",
     "gt_blockage",
     "put_blockage gt_box gt_door gt_ball place_blockage"),
    (PLACE, "#>Y.x..L.rg...#", NOTHING, ".",
     "is_placed(blockage)",
     "put_blockage place_blockage",
     "gt_box gt_door gt_ball"),
    (PLACE, "#>Y....L.rg...#", KEY, ".",
     "has_key(agent) is_placed(blockage)",
     "put_blockage gt_box gt_key place_blockage",
     "gt_door put_key gt_ball"),
    (PLACE, "#.Y.k../>r....#", BALL, ".",
     "has_key(env) has_ball(agent) is_open(door) is_placed(blockage)",
     "put_blockage gt_box gt_door put_key gt_ball place_blockage",
     "gt_key place_ball"),
    (PLACE, "#.yb.../>R....#", KEY, ".",
     "has_key(agent) is_open(door)",
     "put_blockage gt_box gt_key gt_door place_ball",
     "gt_blockage put_key"),
]
# fmt: on


@pytest.mark.parametrize(("task", "row", "held", "on", "atoms", "reached", "available"), STATES)
def test_symbols_of_a_state(task, row, held, on, atoms, reached, available):
    spec = SPECS[task]
    facts = parse(rooms(row), held, on).facts[0]
    truth = symbols.valuation_table(spec.atoms)[facts]
    assert " ".join(str(a) for a, holds in zip(spec.atoms, truth, strict=True) if holds) == atoms
    assert _subgoals(symbols.reached_table(spec.things)[:, facts]) == reached
    assert _subgoals(symbols.available_table(spec.things)[:, facts]) == available


def _subgoals(truth: np.ndarray) -> str:
    return " ".join(h.predicate.name for h, holds in zip(symbols.SUBGOALS, truth, strict=True) if holds)


def test_every_atom_and_subgoal_of_the_tables_is_seen_both_ways():
    atoms = [set(state[4].split()) for state in STATES]
    subgoals = [set(state[5].split()) for state in STATES]
    for atom in symbols.ATOMS:
        assert {str(atom) in state for state in atoms} == {True, False}, atom
    for subgoal in symbols.SUBGOALS:
        assert {subgoal.predicate.name in state for state in subgoals} == {True, False}, subgoal


@pytest.mark.parametrize(
    ("task", "count"),
    # by hand: hand and key allow key in hand, key in sight, neither; a ball in hand allows the latter two
    [
        ("BoxDoor", 3 * 4),
        ("DoorBall", 5 * 4),
        ("BlockedBoxUnlockPickup", 7 * 4),
        ("BlockedBoxPlaceGoal", (7 + 5) * 4),
    ],
)
def test_number_of_consistent_scenes(task, count):
    atoms = SPECS[task].atoms
    assert len(scenes(atoms, symbols.exclusions(atoms))) == count
