"""The figures of a learning curve, worked by hand."""

import pytest

from paddlectl.experiments.log import curve_figures
from paddlectl.hybrid.rollout import Decisions, Episode


def episode(order, finished, score):
    return Episode(order, 0, finished, score, 10, Decisions.empty(1))


def figures(rows, frames):
    return curve_figures([episode(*row) for row in rows], frames)


def test_a_short_curve_as_worked_by_hand():
    found = figures([(1, 10, 0.9), (0, 20, 0.0), (3, 50, 0.6), (2, 100, 0.3)], 100)
    # after frames 1-9 nothing: 9·0; 10-19: 10·0.9; 20-49: 30·0.45; 50-99: 50·0.5; 100: 0.45
    assert found == pytest.approx(
        {
            "jump_start": 1.8 / 100,  # of the first hundred started, those that didn't end count as 0
            "final_score": 0.45,
            "success_rate": 0.75,
            "area_under_curve": (9 + 13.5 + 25 + 0.45) / 100,
        }
    )


def test_the_jump_start_is_of_the_first_started_and_the_end_of_the_last_ended():
    # 100 that start first, fail and end last; 150 that start later and are solved at once
    slow = [(order, 200 + order, 0.0) for order in range(100)]
    quick = [(order, order - 50, 0.8) for order in range(100, 250)]
    found = figures(quick + slow, 1000)
    assert found["jump_start"] == 0.0
    assert (found["final_score"], found["success_rate"]) == (0.0, 0.0)
    half = figures(quick + [(order, 200 + order, 0.6) for order in range(50)], 1000)
    assert half["jump_start"] == pytest.approx(0.3)  # fifty of the first hundred never ended
    assert (half["final_score"], half["success_rate"]) == (pytest.approx(0.7), 1.0)


def test_the_area_is_over_the_latest_hundred():
    # 100 fail by frame 500, 100 are solved by frame 1000, ten every 50 frames: spans of 10 frames
    rows = [(n, 5 * (n + 1), 0.0 if n < 100 else 1.0) for n in range(200)]
    # of the last 50 spans the k-th has seen 2·k solved ones among its latest 100
    assert figures(rows, 1000)["area_under_curve"] == pytest.approx(sum(2 * k / 100 for k in range(51)) / 100)


def test_a_run_without_episodes_has_figures_of_zero():
    nothing = {"jump_start": 0.0, "final_score": 0.0, "success_rate": 0.0, "area_under_curve": 0.0}
    assert figures([], 4096) == nothing
