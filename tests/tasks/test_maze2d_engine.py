"""The maze's rules by hand, and what every one of its tasks promises."""

import numpy as np
import pytest

from paddlectl.tasks import suite
from paddlectl.tasks.maze2d import symbols as s
from paddlectl.tasks.maze2d.engine import Engine
from paddlectl.tasks.maze2d.layouts import (
    MAP,
    PLACES,
    SPECS,
    START,
    WAYS,
    centre,
    distances,
    draw_starts,
)
from walker import NEXT, Walker, cell_of

REST = np.zeros((1, 2), np.float32)
ERRANDS = {"CoffeeMaze": (0, 1, 4), "MailMaze": (2, 3, 4), "CoffeeMailMaze": (0, 2, 3, 1, 4)}
COFFEE, COFFEE_OFFICE, MAIL, MAIL_OFFICE, BALL = range(5)


def at(task: str, *places: int, action_repeat: int = 1) -> tuple[Engine, list[float]]:
    """An engine whose ball was set down at rest at these places in turn, and the rewards of each."""
    engine, rewards = Engine(SPECS[task], 1, 0, action_repeat), []
    for place in places:
        engine.masses.put(np.array([0]), PLACES[[place]])
        rewards.append(float(engine.step(REST).reward[0]))
    return engine, rewards


def test_places_lie_where_the_paper_puts_them():
    assert [cell_of(place) for place in PLACES] == [(6, 2), (7, 4), (4, 7), (7, 6), (7, 9)]
    assert centre(0, 0) == (-5.5, 4.0)
    assert all(len(row) == len(MAP[0]) for row in MAP)
    assert sum(row.count(" ") for row in MAP) == 47
    assert all(len(reachable) == 47 for reachable in NEXT)


@pytest.mark.parametrize(
    ("task", "places", "facts", "rewards"),
    [
        ("CoffeeMaze", [COFFEE], {s.Fact.COFFEE_HELD}, [10]),
        ("CoffeeMaze", [COFFEE, COFFEE_OFFICE], {s.Fact.COFFEE_DELIVERED}, [10, 10]),
        ("CoffeeMaze", [COFFEE_OFFICE, MAIL, MAIL_OFFICE, BALL], set(), [0, 0, 0, 0]),
        ("CoffeeMaze", [COFFEE, COFFEE_OFFICE, COFFEE], {s.Fact.COFFEE_DELIVERED}, [10, 10, 0]),
        ("MailMaze", [COFFEE, MAIL, MAIL_OFFICE], {s.Fact.MAIL_DELIVERED}, [0, 10, 10]),
        ("CoffeeMailMaze", [MAIL, COFFEE], {s.Fact.COFFEE_HELD, s.Fact.MAIL_HELD}, [10, 10]),
        (
            "CoffeeMailMaze",
            [COFFEE, MAIL, MAIL_OFFICE, BALL],
            {s.Fact.COFFEE_HELD, s.Fact.MAIL_DELIVERED},
            [10, 10, 10, 0],
        ),
    ],
)
def test_errands(task, places, facts, rewards):
    engine, paid = at(task, *places)
    assert engine.facts[0] == sum(facts)
    assert paid == rewards


def test_the_ball_ends_the_episode_once_all_is_delivered():
    engine, _ = at("CoffeeMailMaze", MAIL, COFFEE, COFFEE_OFFICE, MAIL_OFFICE)
    engine.masses.put(np.array([0]), PLACES[[BALL]])
    step = engine.step(REST)
    assert step.terminated[0]
    assert step.score[0] == pytest.approx(100 * (1 - 0.9 * 5 / 1000))
    assert step.reward[0] == step.score[0]


def test_an_action_is_cut_short_by_the_end_of_the_episode():
    engine, _ = at("CoffeeMaze", COFFEE, COFFEE_OFFICE, action_repeat=10)
    engine.masses.put(np.array([0]), PLACES[[BALL]])
    step = engine.step(REST)
    assert (engine.t[0], bool(step.terminated[0])) == (21, True)
    assert not any(value[0] for value in engine.step(REST))
    assert engine.t[0] == 21


def test_the_way_to_a_place_leads_around_the_walls():
    # from the start, (1, 1): down to row 5, where the coffee lies below to the right
    assert WAYS[1, 1, COFFEE] == 6
    assert WAYS[6, 2, COFFEE] == 0
    assert np.isinf(WAYS[0, 0]).all()
    start = np.array([centre(1, 1)])
    assert distances(start, np.array([COFFEE])) == pytest.approx([6.0])
    assert distances(start - (0.0, 0.25), np.array([COFFEE])) == pytest.approx([5.75])


def test_availability_by_hand():
    """Subgoals in order: coffee, its office, mail, its office, ball."""
    rows = {
        (): [1, 0, 1, 0, 1],
        (COFFEE,): [0, 1, 1, 0, 1],
        (MAIL, MAIL_OFFICE): [1, 0, 0, 0, 1],
        (BALL,): [1, 0, 1, 0, 0],
    }
    for places, expected in rows.items():
        engine, _ = at("CoffeeMailMaze", *places)
        assert [engine.available(np.array([subgoal]))[0] for subgoal in range(5)] == [
            bool(x) for x in expected
        ]
    engine, _ = at("MailMaze", MAIL)
    assert [engine.available(np.array([subgoal]))[0] for subgoal in range(5)] == [
        False,
        False,
        False,
        True,
        True,
    ]


def test_a_place_passed_by_within_an_action_is_reached():
    engine = Engine(SPECS["MailMaze"], 1, 0, action_repeat=40)
    engine.set_starts(PLACES[[MAIL]] + (0.0, 1.0))
    engine.step(np.array([[0.0, -1.0]], np.float32))
    assert engine.masses.position[0, 1] < PLACES[MAIL, 1] - 0.4
    assert engine.reached(np.array([MAIL]))[0]
    assert engine.facts[0] == s.Fact.MAIL_HELD


@pytest.mark.parametrize("task", SPECS)
def test_every_subgoal_can_be_reached_and_the_task_be_solved(task):
    """A walk through the task pays each errand once and then the final reward, within the horizon."""
    env = Engine(SPECS[task], 4, 0, action_repeat=10)
    subgoals = [suite.load(task).domain_subgoals.index(subgoal) for subgoal in SPECS[task].subgoals]
    walker, missing = Walker(*ERRANDS[task]), set(subgoals)
    total, scores, ended = np.zeros((3, 4))
    for _ in range(100):
        before = {subgoal: env.available(np.full(4, subgoal)) for subgoal in subgoals}
        step = env.step(walker.act(env))
        missing -= {
            subgoal for subgoal in subgoals if (before[subgoal] & env.reached(np.full(4, subgoal))).any()
        }
        total, scores, ended = total + step.reward, scores + step.score, ended + step.terminated
        assert not step.truncated.any()
    assert not missing
    np.testing.assert_array_equal(ended, 1)
    np.testing.assert_allclose(scores, 100 * (1 - 0.9 * env.t / 1000), rtol=1e-6)
    np.testing.assert_allclose(total - scores, 20 * (len(subgoals) // 2), rtol=1e-6)


def test_an_unsolved_episode_ends_at_the_horizon():
    env = Engine(SPECS["CoffeeMaze"], 2, 0, action_repeat=20)
    ends = [env.step(np.zeros((2, 2), np.float32)).truncated.copy() for _ in range(50)]
    assert not np.any(ends[:-1])
    assert ends[-1].all()
    assert (env.t == 1000).all()


def test_starts_are_spread_around_their_cell():
    starts = draw_starts(np.random.default_rng(0), 1000) - centre(*START)
    assert 0.2 < np.abs(starts).max() <= 0.25
    assert np.abs(starts.mean(0)).max() < 0.02
