"""The rules of the MiniGrid tasks, one step at a time."""

import numpy as np
import pytest

from paddlectl.tasks.minigrid.engine import Engine, State
from paddlectl.tasks.minigrid.grid import Action, Held
from paddlectl.tasks.minigrid.layouts import HORIZON, SPECS, draw_layouts
from pictures import draw, parse

LEFT, RIGHT, UP, DOWN, PICK_UP, DROP, TOGGLE = list(Action)[:7]
NOTHING, KEY, BLOCKAGE, BALL = Held


def picture(row: str) -> str:
    """A state whose objects all stand in the row of the passage."""
    wall, floor = "#" * 15, "#......#......#"
    return "\n".join([wall, floor, floor, row, floor, floor, floor, wall])


def after(task: str, row: str, held: Held, *actions: Action) -> tuple[str, Held]:
    """The row of the passage and the hand after some actions."""
    engine = Engine(SPECS[task], 1, 0)
    engine.state = parse(picture(row), held)
    for action in actions:
        engine.step(np.array([action]))
    return draw(engine.state).split()[3], Held(engine.state.held[0])


DOOR, GAP, OPEN = "BoxDoor", "GapBall", "OpenGoal"
BLOCKED, GOALS = "BlockedBoxUnlockPickup", "BlockedBoxPlaceGoal"


@pytest.mark.parametrize(
    ("task", "row", "held", "actions", "expected", "hand"),
    [
        # walking
        (DOOR, "#.>....L......#", NOTHING, [RIGHT], "#..>...L......#", NOTHING),
        (DOOR, "#.>....L......#", NOTHING, [LEFT], "#<.....L......#", NOTHING),
        (DOOR, "#>.....L......#", NOTHING, [LEFT], "#<.....L......#", NOTHING),
        (DOOR, "#>k....L......#", NOTHING, [RIGHT], "#>k....L......#", NOTHING),
        (DOOR, "#>x....L......#", NOTHING, [RIGHT], "#>x....L......#", NOTHING),
        (BLOCKED, "#>b....L......#", NOTHING, [RIGHT], "#>b....L......#", NOTHING),
        (BLOCKED, "#......L.>g...#", NOTHING, [RIGHT], "#......L.>g...#", NOTHING),
        (DOOR, "#.....>L......#", NOTHING, [RIGHT], "#.....>L......#", NOTHING),
        (OPEN, "#.....>C......#", NOTHING, [RIGHT], "#.....>C......#", NOTHING),
        (GAP, "#.....>|......#", NOTHING, [RIGHT], "#.....>|......#", NOTHING),
        (BLOCKED, "#.....>/......#", NOTHING, [RIGHT, RIGHT], "#....../>.....#", NOTHING),
        (GOALS, "#>y....L......#", NOTHING, [RIGHT], "#>y....L......#", NOTHING),
        (GOALS, "#>Y....L......#", NOTHING, [RIGHT], "#>Y....L......#", NOTHING),
        (GOALS, "#......L>r....#", NOTHING, [RIGHT], "#......L>r....#", NOTHING),
        (OPEN, "#....../>G....#", NOTHING, [RIGHT], "#....../.>....#", NOTHING),
        # picking up
        (DOOR, "#>k....L......#", NOTHING, [PICK_UP], "#>.....L......#", KEY),
        (DOOR, "#>.k...L......#", NOTHING, [PICK_UP], "#>.k...L......#", NOTHING),
        (DOOR, "#>x....L......#", NOTHING, [PICK_UP], "#>x....L......#", NOTHING),
        (BLOCKED, "#>b....L......#", NOTHING, [PICK_UP], "#>.....L......#", BLOCKAGE),
        (BLOCKED, "#......L>g....#", NOTHING, [PICK_UP], "#......L>.....#", BALL),
        (BLOCKED, "#>b....L......#", KEY, [PICK_UP], "#>b....L......#", KEY),
        (GOALS, "#>Y....L......#", NOTHING, [PICK_UP], "#>Y....L......#", NOTHING),
        (GOALS, "#......L>R....#", NOTHING, [PICK_UP], "#......L>R....#", NOTHING),
        (GOALS, "#>y....L......#", NOTHING, [PICK_UP], "#>y....L......#", NOTHING),
        # the gap opens when the key is first picked up, and stays open
        (GAP, "#>k....|......#", NOTHING, [PICK_UP], "#>...../......#", KEY),
        (GAP, "#>k....|......#", NOTHING, [PICK_UP, DROP], "#>k..../......#", NOTHING),
        (GAP, "#.....>|......#", KEY, [TOGGLE], "#.....>|......#", KEY),
        # putting down
        (DOOR, "#>.....L......#", KEY, [DROP], "#>k....L......#", NOTHING),
        (BLOCKED, "#>.....L......#", BLOCKAGE, [DROP], "#>b....L......#", NOTHING),
        (BLOCKED, "#....../>.....#", BALL, [DROP], "#....../>g....#", NOTHING),
        (DOOR, "#>.....L......#", NOTHING, [DROP], "#>.....L......#", NOTHING),
        (DOOR, "#.....>/......#", KEY, [DROP], "#.....>/......#", KEY),
        (DOOR, "#<.....L......#", KEY, [DROP], "#<.....L......#", KEY),
        (BLOCKED, "#>b....L......#", KEY, [DROP], "#>b....L......#", KEY),
        (OPEN, "#....../>G....#", KEY, [DROP], "#....../>G....#", KEY),
        (GOALS, "#>y....L......#", BLOCKAGE, [DROP], "#>Y....L......#", NOTHING),
        (GOALS, "#>y....L......#", KEY, [DROP], "#>y....L......#", KEY),
        (GOALS, "#>y....L......#", BALL, [DROP], "#>y....L......#", BALL),
        (GOALS, "#....../>r....#", BALL, [DROP], "#....../>R....#", NOTHING),
        (GOALS, "#....../>r....#", BLOCKAGE, [DROP], "#....../>r....#", BLOCKAGE),
        (GOALS, "#>Y....L......#", KEY, [DROP], "#>Y....L......#", KEY),
        # boxes and doors
        (DOOR, "#>x....L......#", NOTHING, [TOGGLE], "#>k....L......#", NOTHING),
        (BLOCKED, "#>x....L......#", BLOCKAGE, [TOGGLE], "#>k....L......#", BLOCKAGE),
        (DOOR, "#>x....L......#", NOTHING, [TOGGLE, TOGGLE, PICK_UP], "#>.....L......#", KEY),
        (BLOCKED, "#.....>L......#", KEY, [TOGGLE], "#.....>/......#", KEY),
        (BLOCKED, "#.....>L......#", NOTHING, [TOGGLE], "#.....>L......#", NOTHING),
        (BLOCKED, "#.....>L......#", BLOCKAGE, [TOGGLE], "#.....>L......#", BLOCKAGE),
        (BLOCKED, "#....>.L......#", KEY, [TOGGLE], "#....>.L......#", KEY),
        (BLOCKED, "#.....>L......#", KEY, [TOGGLE, TOGGLE], "#.....>/......#", KEY),
        (OPEN, "#.....>C......#", NOTHING, [TOGGLE], "#.....>/......#", NOTHING),
        (OPEN, "#.....>C......#", KEY, [TOGGLE], "#.....>/......#", KEY),
    ],
)
def test_one_rule(task, row, held, actions, expected, hand):
    assert after(task, row, held, *actions) == (expected, hand)


def test_up_and_down_are_rows():
    engine = Engine(SPECS[DOOR], 2, 0)
    engine.state.agent[:] = 3 * 15 + 3
    engine.state.grid[:, [2 * 15 + 3, 4 * 15 + 3]] = 0
    engine.step(np.array([UP, DOWN]))
    assert engine.state.agent.tolist() == [2 * 15 + 3, 4 * 15 + 3]


def test_a_milestone_pays_once():
    engine = Engine(SPECS[GAP], 1, 0)
    engine.state = parse(picture("#>k....|......#"))
    rewards = [engine.step(np.array([action])).reward[0] for action in (PICK_UP, DROP, PICK_UP)]
    np.testing.assert_allclose(rewards, [0.1, 0, 0])


def test_success_pays_by_its_step_and_the_lane_then_rests():
    engine = Engine(SPECS[DOOR], 1, 0)
    engine.state = parse(picture("#....>.L......#"), KEY)
    first, second, third = (engine.step(np.array([action])) for action in (RIGHT, TOGGLE, LEFT))
    assert not first.terminated[0]
    assert second.terminated[0]
    assert second.score[0] == pytest.approx(1 - 0.9 * 2 / HORIZON)
    assert not third.terminated[0]
    assert third.reward[0] == 0
    assert draw(engine.state).split()[3] == "#.....>/......#"


def test_the_last_step_can_still_succeed():
    engine = Engine(SPECS[DOOR], 2, 0)
    layouts = draw_layouts(SPECS[DOOR], np.random.default_rng(0), 2)
    engine.set_layouts(layouts)
    for _ in range(HORIZON - 1):
        assert not engine.step(np.array([DROP, DROP])).truncated.any()
    winning = parse(picture("#.....>L......#"), KEY)
    engine.state.assign(np.array([0]), winning, slice(0, 1))
    step = engine.step(np.array([TOGGLE, TOGGLE]))
    assert step.terminated.tolist() == [True, False]
    assert step.truncated.tolist() == [False, True]
    assert step.score[0] == pytest.approx(0.1)


def test_without_milestones_only_success_pays():
    engine = Engine(SPECS[GAP], 1, 0, milestone_reward=0.0)
    engine.state = parse(picture("#>k....|......#"))
    assert engine.step(np.array([PICK_UP])).reward[0] == 0


def test_layouts_come_in_one_order_whatever_the_lanes():
    few, many = Engine(SPECS[BLOCKED], 3, 5), Engine(SPECS[BLOCKED], 9, 5)
    first = few.state.grid.copy()
    few.reset()
    second = few.state.grid.copy()
    few.reset(np.array([True, False, True]))
    np.testing.assert_array_equal(many.state.grid[:6], np.concatenate([first, second]))
    np.testing.assert_array_equal(few.state.grid[[0, 2]], many.state.grid[[6, 7]])
    np.testing.assert_array_equal(few.state.grid[1], second[1])


def test_the_pool_of_layouts_is_refilled():
    engine = Engine(SPECS[GOALS], 700, 0)
    seen = [engine.state.where.copy()]
    for _ in range(3):
        engine.reset()
        seen.append(engine.state.where.copy())
    assert len(np.unique(np.concatenate(seen), axis=0)) > 2700


@pytest.mark.parametrize("task", SPECS)
def test_facts_and_rows_follow_the_grid(task):
    engine, rng = Engine(SPECS[task], 256, 0), np.random.default_rng(0)
    for _ in range(400):
        step = engine.step(rng.integers(7, size=256))
        state = engine.state
        anew = State(state.grid, state.agent, state.facing, state.held, state.where)
        np.testing.assert_array_equal(state.facts, anew.facts)
        np.testing.assert_array_equal(state.rows, anew.rows)
        engine.reset(step.terminated | step.truncated)
