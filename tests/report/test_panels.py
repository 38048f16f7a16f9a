"""What a figure shows, as numbers."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from paddlectl.report.panels import FIELDS, band, csv_text, panels_of
from samples import RESULT


def seeds(*levels, **more):
    """A result a seed, each of one score throughout."""
    return [
        replace(RESULT, seed=seed, by_frames=(level,) * 100, by_episodes=(level,) * 4, **more)
        for seed, level in enumerate(levels)
    ]


def test_a_band_is_the_interquartile_mean_and_an_interval_around_it():
    curves = np.array([[0.0, 5.0], [1.0, 5.0], [2.0, 5.0], [3.0, 5.0], [4.0, 5.0], [100.0, 5.0]])
    mid, low, high = band(curves, np.random.default_rng(0))
    assert mid.tolist() == [2.5, 5.0], "the lowest and the highest of six are left out"
    assert 0.0 <= low[0] < 2.5 < high[0] <= 100.0 and (low[1], high[1]) == (5.0, 5.0)
    alone = band(curves[:1], np.random.default_rng(0))
    assert all(values.tolist() == [0.0, 5.0] for values in alone)


def test_a_panel_a_scenario_and_a_line_a_method_and_variant():
    results = [
        *seeds(0.1, 0.3),
        *seeds(0.2, 0.2, method="hdm"),
        *seeds(0.4, variant="no inheritance"),
        *seeds(0.6, 0.6, 0.6, scenario="BoxDoor"),
    ]
    first, second = panels_of(results, "frames")
    assert (first.title, first.note, first.seeds) == ("A", "BoxDoor", "n = 1–2")
    assert (second.title, second.note, second.seeds) == ("BoxDoor", "", "n = 3")
    assert [one.label for one in first.series] == ["paddle", "hdm", "paddle, no inheritance"]
    assert [one.n for one in first.series] == [2, 2, 1]
    assert first.series[0].mid == (0.2,) * 100 and first.series[0].x == tuple(range(0, 1000, 10))


def test_of_a_cell_that_is_told_twice_the_latter_counts():
    (panel,) = panels_of([*seeds(0.1, 0.3), *seeds(0.5)], "frames")
    assert (panel.series[0].n, panel.series[0].mid[0]) == (2, 0.4)


def test_a_line_goes_as_far_as_every_seed_of_it():
    rising = tuple(number / 100 for number in range(100))
    long = replace(RESULT, seed=1, frames=2000, by_frames=rising, by_episodes=(1.0,) * 7)
    (panel,) = panels_of([RESULT, long], "frames")
    line = panel.series[0]
    assert line.x[-1] == 990.0
    assert line.mid[-1] == pytest.approx((0.5 + 0.495) / 2), "after as many frames, not as large a share"
    (panel,) = panels_of([RESULT, long], "episodes")
    assert panel.series[0].x == (50.0, 100.0, 150.0, 200.0) and panel.series[0].mid == (0.75,) * 4


def test_a_method_without_an_episode_has_a_line_without_points():
    none = replace(RESULT, method="hdm", by_episodes=())
    (panel,) = panels_of([RESULT, none], "episodes")
    assert [len(one.x) for one in panel.series] == [4, 0]


def test_the_order_of_other_methods_changes_no_interval():
    ours, theirs = seeds(0.1, 0.5, 0.9), seeds(0.2, 0.4, method="hdm")
    alone = panels_of(ours, "frames")[0].series[0]
    assert panels_of([*theirs, *ours], "frames")[0].series[1] == alone


def test_the_table_has_what_is_plotted_and_no_interval_of_one_seed():
    results = [*seeds(0.1, 0.5, 0.9), *seeds(0.4, variant='of "one", alone')]
    panels = panels_of(results, "episodes")
    rows = list(csv.DictReader(io.StringIO(csv_text(panels))))
    assert tuple(rows[0]) == FIELDS
    line = panels[0].series[0]
    plotted = zip(line.x, line.mid, line.low, line.high, strict=True)
    assert [tuple(float(row[field]) for field in FIELDS[3:7]) for row in rows[:4]] == [*plotted]
    assert {(row["panel"], row["label"], row["n"]) for row in rows[:4]} == {("A", "paddle", "3")}
    assert rows[4] == dict(
        zip(FIELDS, ("A", "BoxDoor", 'paddle, of "one", alone', "50", "0.4", "", "", "1"), strict=True)
    )
