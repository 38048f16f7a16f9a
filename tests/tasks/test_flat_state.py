"""The whole state as one vector, on states drawn by hand and over all tasks."""

from functools import cache

import numpy as np
import pytest

from paddlectl.tasks.maze2d import observe as maze
from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.flat import FLAT_SIZE, flat_state
from paddlectl.tasks.minigrid.grid import Held
from paddlectl.tasks.minigrid.layouts import HORIZON
from paddlectl.tasks.suite import load, names
from pictures import parse

BLOCKED = """
###############
#......#......#
#......#......#
#..>x..#..g...#
#.....bL......#
#......#......#
#......#......#
###############
"""
KEY, BOX, BLOCKAGE, BALL, GOAL = (slice(49 + 10 * i, 59 + 10 * i) for i in range(5))


def flat(picture, held=Held.NOTHING, paid=0, t=0):
    state = parse(picture, held)
    numbers = flat_state(
        state.grid, state.rows, state.agent, state.facing, state.held, state.where, state.facts,
        np.array([paid]), np.array([t]),
    )  # fmt: skip
    assert numbers.shape == (1, FLAT_SIZE)
    assert numbers.dtype == np.float32
    return numbers[0]


def test_a_state_worked_by_hand():
    paid = 1 << s.SUBGOALS.index(s.GT_KEY)
    seen = flat(BLOCKED, Held.KEY, paid, HORIZON // 4)
    # on the grid, dx, dy, their signs, dx = 0, dy = 0, near; in hand; in front
    assert seen[KEY].tolist() == [0, 0, 0, 0, 0, 0, 0, 0, 1, 0]
    assert seen[BOX].tolist() == pytest.approx([1, 1 / 14, 0, 1, 0, 0, 1, 1, 0, 1])
    assert seen[BLOCKAGE].tolist() == pytest.approx([1, 3 / 14, 1 / 7, 1, 1, 0, 0, 1, 0, 0])
    assert seen[BALL].tolist() == pytest.approx([1, 7 / 14, 0, 1, 0, 0, 1, 0, 0, 0])
    assert seen[GOAL].tolist() == [0] * 10
    passage = seen[119:]
    assert passage[:7].tolist() == pytest.approx([4 / 14, 1 / 7, 1, 1, 0, 1, 0])
    assert passage[7:9].tolist() == [0, 0]  # neither the passage nor an empty cell is in front
    assert passage[9:17].tolist() == [1, 0, 0, 0, 0, 1, 0, 0]  # facing right, the key in hand
    facts = {s.Fact.KEY_HELD, s.Fact.BLOCKED, s.Fact.BOX_CLOSED}
    assert passage[17:27].tolist() == [float(s.Fact(1 << bit) in facts) for bit in range(10)]
    assert passage[27:37].tolist() == [float(subgoal == s.GT_KEY) for subgoal in s.SUBGOALS]
    assert passage[37:].tolist() == [0.75]


def test_the_window_shows_where_the_agent_cannot_walk():
    rows = ["".join("#" if cell else "." for cell in row) for row in flat(BLOCKED)[:49].reshape(7, 7)]
    assert rows == ["#######", "#......", "#......", "#...#..", "#.....#", "#......", "#......"]


def test_a_state_of_the_maze():
    position, velocity = np.array([[1.0, -2.0]]), np.array([[2.5, 0.0]])
    seen = maze.flat_state(position, velocity, np.array([0b0110]), np.array([150]))
    left = 1 - 150 / load("MailMaze").horizon
    assert seen[0].tolist() == pytest.approx([1.0, -2.0, 1.0, 0.0, 0, 1, 1, 0, left])


@cache
def sizes(domain):
    return {load(name).make(1, 0).flat_size for name in names() if load(name).domain == domain}


@pytest.mark.parametrize("name", names())
def test_it_is_of_one_size_in_a_domain_and_tells_what_the_clauses_are_told(name):
    """Equal vectors have equal valuations, and reading them changes nothing."""
    task = load(name)
    environment = task.make(32, 3)
    rng = np.random.default_rng(3)
    seen = {}
    for _ in range(60):
        states, valuations = environment.flat_state(), environment.valuation()
        assert states.shape == (32, environment.flat_size)
        assert np.isfinite(states).all()
        assert (states == environment.flat_state()).all()
        for state, valuation in zip(states, valuations, strict=True):
            assert seen.setdefault(state.tobytes(), valuation.tobytes()) == valuation.tobytes()
        step = environment.step(environment.actions.sample(rng, 32))
        environment.reset(step.terminated | step.truncated)
    assert sizes(task.domain) == {environment.flat_size}


def test_milestones_show_once_they_are_paid():
    environment = load("BoxDoor").make(256, 5)
    rng = np.random.default_rng(5)
    paid = np.zeros(256, bool)
    column = 119 + 27 + s.SUBGOALS.index(s.GT_KEY)
    for _ in range(150):
        step = environment.step(environment.actions.sample(rng, 256))
        paid |= (step.reward > 0) & ~step.terminated
        running = ~(step.terminated | step.truncated)
        assert (environment.flat_state()[running, column] == paid[running]).all()
        environment.reset(~running)
        paid &= running
    assert paid.any()
