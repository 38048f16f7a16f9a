"""The figures of a learning curve, worked by hand."""

import numpy as np
import pytest

from paddlectl.agents.base import Episode
from paddlectl.experiments.curves import WINDOW, Curve, LearningCurve, in_order, rates


def episode(order, started, finished, score):
    return Episode(order, started, finished, score, finished - started)


def figures(rows, frames):
    return LearningCurve([episode(*row) for row in rows], frames).figures()


# Of episodes that start one after another every second is solved, in a third of the time of the others.
# The sixth, from frame 80 on, hasn't ended with frame 100.
LUCKY_ARE_SHORT = [(0, 0, 60, 0.0), (1, 0, 20, 1.0), (2, 20, 40, 1.0), (3, 40, 100, 0.0), (4, 60, 80, 1.0)]


def test_short_episodes_are_the_lucky_ones_and_dont_flatter_the_area():
    """By ending, (0 + 20·1 + 20·1 + 20·2/3 + 20·3/4)/100 = 0.68; by steps, 60/180 = 0.33."""
    ended = sorted(LUCKY_ARE_SHORT, key=lambda row: row[2])
    found = figures(ended, 100)
    # started by frames 0-19: two, one of them solved; 20-39: 2 of 3; 40-59: 2 of 4; 60-99: 3 of 5
    assert found["area_under_curve"] == pytest.approx((20 / 2 + 20 * 2 / 3 + 20 / 2 + 40 * 3 / 5) / 100)
    assert found["final_success"] == found["final_score"] == pytest.approx(3 / 5)
    assert found["jump_start"] == pytest.approx(3 / 5)  # so many are known


def test_nothing_is_told_of_a_run_until_its_first_episode_has_ended():
    curve = Curve()
    told = []
    for row in sorted(LUCKY_ARE_SHORT, key=lambda row: row[2]):
        curve.add([episode(*row)])
        told.append(curve.rates()["latest_success"])
    # after frames 20 and 40 the first still runs; after 60 it is known with the second and third
    assert told == [None, None, pytest.approx(2 / 3), pytest.approx(2 / 3), pytest.approx(3 / 5)]


@pytest.mark.parametrize("count", [1, WINDOW, WINDOW + 1, 3 * WINDOW + 50])
def test_what_is_told_meanwhile_is_what_all_episodes_tell(count):
    rng = np.random.default_rng(count)
    scores = rng.random(count) * (rng.random(count) < 0.5)
    ended = [episode(order, 0, order + 1, float(scores[order])) for order in rng.permutation(count).tolist()]
    curve = Curve()
    for start in range(0, count, 7):
        curve.add(ended[start : start + 7])
        known = in_order(ended[: start + 7])
        assert (curve.known, curve.rates()) == (len(known), rates(known))
    assert curve.ended == curve.known == count


def test_the_jump_start_and_the_end_are_of_episodes_in_the_order_of_their_start():
    # 100 that start first, fail and end last; 150 that start later and are solved at once
    slow = [(order, 0, 400 + order, 0.0) for order in range(100)]
    quick = [(order, order, order + 1, 0.8) for order in range(100, 250)]
    found = figures(quick + slow, 1000)
    assert found["jump_start"] == 0.0
    assert (found["final_score"], found["final_success"]) == (pytest.approx(0.8), 1.0)
    half = figures(quick + [(order, 0, 400 + order, 0.6) for order in range(50)], 1000)
    assert half["jump_start"] == pytest.approx(0.3)  # fifty of the first hundred never ended
    assert half["final_score"] == pytest.approx(0.6), "what came after one that didn't end isn't counted"


def test_the_area_is_over_the_latest_hundred_that_had_started():
    # one starts every 5 frames; 100 fail, then 100 are solved
    rows = [(n, 5 * n, 5 * n + 5, 0.0 if n < 100 else 1.0) for n in range(200)]
    # by frame 500 + 10·k there are 2·k + 1 solved ones among the latest 100
    expected = sum(min(1.0, (2 * k + 1) / 100) for k in range(50)) / 100
    assert figures(rows, 1000)["area_under_curve"] == pytest.approx(expected)


def test_a_run_whose_first_episode_goes_on_has_no_figures():
    nothing = dict.fromkeys(("jump_start", "final_score", "final_success", "area_under_curve"))
    assert figures([], 4096) == nothing
    assert figures([(order, 0, 400 + order, 0.9) for order in range(1, 64)], 4096) == nothing


def test_when_a_share_of_a_hundred_that_started_one_after_another_was_solved():
    # one starts every 5 frames and takes 7; 100 fail, then all are solved: 50 of the latest 100 after 150
    rows = [(n, 5 * n, 5 * n + 7, 0.0 if n < 100 else 1.0) for n in range(200)]
    curve = LearningCurve([episode(*row) for row in rows], 1000)
    assert curve.frames_to(0.5) == 5 * 149 + 7
    assert curve.frames_to(1.0) == 5 * 199 + 7
    assert LearningCurve([episode(*row) for row in rows[:199]], 1000).frames_to(1.0) is None
    # the slowest of the hundred decides, not the one that started last
    rows[120] = (120, 600, 990, 1.0)
    assert LearningCurve([episode(*row) for row in rows], 1000).frames_to(0.5) == 990


def test_the_curve_by_episodes_is_of_the_latest_hundred_after_every_few():
    rows = [(n, n, n + 1, float(n >= 100)) for n in range(250)]
    curve = LearningCurve([episode(*row) for row in rows], 250)
    assert curve.by_episodes(50) == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert LearningCurve([], 250).by_episodes(50) == []
