"""What the low level sees, on states drawn by hand."""

import numpy as np
import pytest

from paddlectl.tasks.minigrid import symbols as s
from paddlectl.tasks.minigrid.engine import State
from paddlectl.tasks.minigrid.grid import Action, Held
from paddlectl.tasks.minigrid.observe import OBSERVATION_SIZE, Observer
from pictures import parse

TARGET, PASSAGE, TOUCH = slice(49, 57), slice(57, 64), slice(64, 67)
FACING, SUBGOAL = slice(67, 71), slice(71, 81)

BLOCKED = """
###############
#......#......#
#.k....#......#
#..>...#..g...#
#.....bL......#
#...x..#......#
#......#......#
###############
"""


def observe(state: State, subgoal) -> np.ndarray:
    subgoals = np.array([s.SUBGOALS.index(subgoal)])
    seen = Observer(1)(state.grid, state.rows, state.agent, state.facing, state.held, state.where, subgoals)
    assert seen.shape == (1, OBSERVATION_SIZE)
    assert seen.dtype == np.float32
    return seen[0]


def window(seen: np.ndarray) -> str:
    return "\n".join("".join("#" if cell else "." for cell in row) for row in seen[:49].reshape(7, 7))


def test_window_around_the_agent():
    assert window(observe(parse(BLOCKED), s.GT_BOX)) == "\n".join(
        [
            "#######",
            "#......",
            "#.#....",
            "#......",
            "#.....#",
            "#...#..",
            "#......",
        ]
    )


def test_the_window_is_mirrored_toward_the_target():
    straight = window(observe(parse(BLOCKED), s.GT_BOX)).split()
    assert window(observe(parse(BLOCKED), s.GT_KEY)).split() == [line[::-1] for line in straight[::-1]]


@pytest.mark.parametrize(("kept", "change"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_mirrored_room_looks_the_same_and_is_walked_the_same(kept, change):
    """The near room as it is and in its mirrors; the passage stays where it is."""
    room = ["......", ".v....", "...b..", "......", "....k.", "......"]
    turned = [line[::kept] for line in room[::change]]
    agent = "v" if change > 0 else "^"
    rows = [f"#{a}{wall}......#" for a, wall in zip(turned, "L#####", strict=True)]
    picture = "\n".join(["#" * 15, *rows, "#" * 15]).replace("v", agent)
    state = parse(picture)
    subgoals = np.array([s.SUBGOALS.index(s.GT_KEY)])
    moves = Observer(1).in_world(state.agent, state.where, subgoals, np.array([Action.RIGHT]))
    assert moves[0] == (Action.RIGHT if kept > 0 else Action.LEFT)
    moves = Observer(1).in_world(state.agent, state.where, subgoals, np.array([Action.DOWN]))
    assert moves[0] == (Action.DOWN if change > 0 else Action.UP)
    assert Observer(1).in_world(state.agent, state.where, subgoals, np.array([Action.DROP]))[0] == Action.DROP
    seen = observe(state, s.GT_KEY)
    np.testing.assert_allclose(seen[TARGET][1:5], [3 / 14, 3 / 7, 1, 1], rtol=1e-6)
    assert seen[FACING].tolist() == [0, 1, 0, 0]
    assert window(seen).split()[4][5] == "#"  # the ball: right and below, in every mirror


def test_outside_the_grid_nothing_can_be_walked_on():
    picture = BLOCKED.replace("#..>...#", "#......#").replace("#......#......#", "#>.....#......#", 1)
    lines = window(observe(parse(picture), s.GT_BOX)).split()
    assert lines[:3] == ["#######"] * 3
    assert lines[3] == "###...."


def test_an_open_passage_and_a_goal_can_be_walked_on():
    picture = BLOCKED.replace("..>...#..g", "......#..G").replace("b", ">").replace("L", "/")
    assert window(observe(parse(picture), s.GT_DOOR)).split()[3] == "......."
    assert window(observe(parse(picture), s.GT_DOOR)).split()[2] == "....#.."
    closed = picture.replace("/", "L")
    assert window(observe(parse(closed), s.GT_DOOR)).split()[3] == "....#.."


@pytest.mark.parametrize(
    ("subgoal", "target"),
    [
        (s.GT_KEY, [1, 1 / 14, 1 / 7, 1, 1, 0, 0, 1]),
        (s.GT_BOX, [1, 1 / 14, 2 / 7, 1, 1, 0, 0, 1]),
        (s.GT_BLOCKAGE, [1, 3 / 14, 1 / 7, 1, 1, 0, 0, 1]),
        (s.GT_BALL, [1, 7 / 14, 0, 1, 0, 0, 1, 0]),
        (s.GT_DOOR, [1, 4 / 14, 1 / 7, 1, 1, 0, 0, 0]),
        (s.GT_GOAL, [0] * 8),
        (s.PUT_KEY, [0] * 8),
        (s.PUT_BLOCKAGE, [0] * 8),
        (s.PLACE_BLOCKAGE, [0] * 8),
    ],
)
def test_target_of_a_subgoal(subgoal, target):
    np.testing.assert_allclose(observe(parse(BLOCKED), subgoal)[TARGET], target, rtol=1e-6)


@pytest.mark.parametrize(
    ("subgoal", "steps"),
    [
        (s.GT_KEY, 1 + 1),
        (s.GT_BOX, 1 + 2),
        (s.GT_DOOR, 4 + 1),
        (s.GT_BALL, (4 + 1) + (3 + 1)),  # through the passage
        (s.PUT_KEY, 0),
        (s.GT_GOAL, 0),  # there is none
    ],
)
def test_steps_to_the_target(subgoal, steps):
    state, subgoals = parse(BLOCKED), np.array([s.SUBGOALS.index(subgoal)])
    assert Observer(1).distance(state.agent, state.where, subgoals).tolist() == [steps]


def test_tiles_are_targets_of_placing():
    picture = BLOCKED.replace("k", "y").replace("g", "r")
    state = parse(picture, Held.BLOCKAGE)
    np.testing.assert_allclose(observe(state, s.PLACE_BLOCKAGE)[TARGET][:3], [1, 1 / 14, 1 / 7], rtol=1e-6)
    np.testing.assert_allclose(observe(state, s.PLACE_BALL)[TARGET][:3], [1, 7 / 14, 0], rtol=1e-6)


def test_passage():
    np.testing.assert_allclose(
        observe(parse(BLOCKED), s.GT_BOX)[PASSAGE], [4 / 14, 1 / 7, 1, 1, 0, 1, 0], rtol=1e-6
    )
    np.testing.assert_allclose(
        observe(parse(BLOCKED), s.GT_KEY)[PASSAGE], [-4 / 14, -1 / 7, -1, -1, 0, 1, 0], rtol=1e-6
    )
    beyond = BLOCKED.replace("..>...#..g", "......#..g").replace("bL...", "./..<")
    np.testing.assert_allclose(
        observe(parse(beyond), s.GT_KEY)[PASSAGE], [3 / 14, 0, 1, 0, 1, 0, 1], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("old", "new", "held", "touch"),
    [
        ("..>...#", "..>...#", Held.NOTHING, [0, 1, 0]),
        ("..>...#", "..>...#", Held.KEY, [0, 1, 1]),
        (".k....#......#\n#..>", "......#......#\n#.k<", Held.NOTHING, [1, 0, 0]),
        ("..>...#", "<.....#", Held.BALL, [0, 0, 1]),
    ],
)
def test_what_is_in_front_and_in_hand(old, new, held, touch):
    assert old in BLOCKED
    seen = observe(parse(BLOCKED.replace(old, new), held), s.GT_KEY)
    assert seen[TOUCH].tolist() == touch


@pytest.mark.parametrize(("agent", "facing"), list(zip(">v<^", range(4), strict=True)))
def test_facing_and_subgoal_are_one_hot(agent, facing):
    below = BLOCKED.replace(".k....", "......").replace(".....bL", "..k..bL").replace(">", agent)
    for i, subgoal in enumerate(s.SUBGOALS):
        seen = observe(parse(below), subgoal)
        assert seen[FACING].tolist() == np.eye(4)[facing].tolist()
        assert seen[SUBGOAL].tolist() == np.eye(10)[i].tolist()


@pytest.mark.parametrize("other", ["b", "g", "y", "Y", "r"])
def test_another_object_shows_as_an_obstacle_only(other):
    """A key in the way looks to `gt_box` as any other thing there does."""
    picture = BLOCKED.replace("b", ".").replace("g", ".")
    expected = observe(parse(picture), s.GT_BOX)
    np.testing.assert_array_equal(observe(parse(picture.replace("k", other)), s.GT_BOX), expected)


def test_any_thing_in_hand_looks_the_same():
    np.testing.assert_array_equal(
        observe(parse(BLOCKED, Held.KEY), s.GT_BOX), observe(parse(BLOCKED, Held.BALL), s.GT_BOX)
    )


def test_a_far_object_that_is_no_target_isn_t_seen():
    with_ball, without = parse(BLOCKED), parse(BLOCKED.replace("g", "."))
    np.testing.assert_array_equal(observe(with_ball, s.GT_KEY), observe(without, s.GT_KEY))
