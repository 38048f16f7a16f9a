"""Statistics by hand, against rliable's own numbers, and how often their intervals cover a known truth."""

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest

from covered import STUDIES, coverage
from paddlectl import statistics
from paddlectl.statistics import COVERAGE, interval, separable

GOLDEN = json.loads(Path(__file__).with_name("rliable.json").read_text())["cases"]
KINDS = ("interquartile_mean", "mean", "median", "optimality_gap", "probability_of_improvement")
NEVER = math.inf


def strata(scores):
    """Of a matrix [seeds, strata]."""
    return list(np.array(scores, float).T)


def samples(case, kind):
    """What the statistic takes of a golden case."""
    given = (case["scores"], case["other"]) if kind == "probability_of_improvement" else (case["scores"],)
    return [strata(scores) for scores in given]


def generator():
    return np.random.default_rng(0)


def test_by_hand() -> None:
    sample = [np.array([1.0, 2, 3, 10]), np.array([0.0, 4])]
    assert statistics.interquartile_mean(sample) == 2.5  # of 0 1 2 3 4 10 the inner four
    assert statistics.mean(sample) == 3.0  # of 4 and 2
    assert statistics.median([*sample, np.array([9.0])]) == 4.0
    assert statistics.seed_median(sample) == 2.5
    assert statistics.optimality_gap([np.array([0.5, 3.0])]) == 0.25  # what is above 1 counts as 1
    assert statistics.performance_profile(sample, np.array([0.0, 3.0])).tolist() == [5 / 6, 1 / 3]


def test_the_probability_of_improvement_counts_a_tie_half() -> None:
    above = statistics.probability_of_improvement
    assert above([np.array([2.0, 3])], [np.array([1.0, 2])]) == 3.5 / 4
    two = [np.array([2.0, 3]), np.array([1.0])], [np.array([1.0, 2]), np.array([2.0, 5, 0])]
    assert above(*two) == pytest.approx((3.5 / 4 + 1 / 3) / 2)
    assert above([np.array([NEVER, 1])], [np.array([NEVER, NEVER])]) == 0.25


def test_what_was_never_reached_is_worse_than_any_number() -> None:
    sample = [np.array([5.0, NEVER, 3, 4, 6, NEVER])]
    assert statistics.seed_median(sample) == 5.5
    assert statistics.interquartile_mean(sample) == NEVER
    low, high = interval(statistics.seed_median, sample, generator=generator())
    assert low == 3.0 and high == NEVER


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", GOLDEN, ids=range(len(GOLDEN)))
def test_rliable_says_the_same(case, kind) -> None:
    statistic, told, given = getattr(statistics, kind), case["estimates"][kind], samples(case, kind)
    assert statistic(*given) == pytest.approx(told["value"], rel=0, abs=1e-12)
    low, high = interval(statistic, *given, generator=generator(), expanded=False)
    assert (low, high) == pytest.approx((told["low"], told["high"]), rel=0, abs=0.01)


@pytest.mark.parametrize("case", GOLDEN, ids=range(len(GOLDEN)))
def test_rliable_draws_the_same_profile(case) -> None:
    sample, told = strata(case["scores"]), case["profile"]

    def profile(drawn):
        return statistics.performance_profile(drawn, np.array(told["thresholds"]))

    assert profile(sample) == pytest.approx(np.array(told["value"]), rel=0, abs=1e-12)
    ends = interval(profile, sample, generator=generator(), expanded=False)
    step = 1 / np.size(case["scores"])  # a share of runs moves by whole runs
    for end, name in zip(ends, ("low", "high"), strict=True):
        assert end == pytest.approx(np.array(told[name]), rel=0, abs=step + 1e-9)


def test_fifty_thousand_resamples_of_six_seeds_in_eight_scenarios_take_less_than_a_second() -> None:
    sample = list(np.random.default_rng(1).uniform(size=(8, 6)))
    start = time.process_time()
    interval(statistics.interquartile_mean, sample, generator=generator())
    assert time.process_time() - start < 1


def test_strata_may_differ_in_their_seeds() -> None:
    sample = [np.array([1.0, 1, 1]), np.array([3.0, 3])]
    assert interval(statistics.mean, sample, generator=generator()) == (2.0, 2.0)


def test_an_expanded_interval_is_the_wider_the_fewer_seeds_there_are() -> None:
    for seeds in (4, 6, 10):
        sample = [np.linspace(0, 1, seeds)]
        plain = interval(statistics.mean, sample, generator=generator(), expanded=False)
        low, high = interval(statistics.mean, sample, generator=generator())
        assert low < plain[0] and high > plain[1]


def test_strata_of_the_same_runs_are_no_news() -> None:
    """The mean of a stratum that stands there four times is no surer than of one."""
    scores = np.random.default_rng(2).normal(size=8)
    alone = interval(statistics.mean, [scores], generator=generator())
    again = interval(statistics.mean, [scores] * 4, generator=generator(), together=[0, 0, 0, 0])
    apart = interval(statistics.mean, [scores] * 4, generator=generator())
    assert again == pytest.approx(alone, abs=0.02)
    assert apart[1] - apart[0] < 0.7 * (alone[1] - alone[0])


def test_three_seeds_tell_no_two_methods_apart() -> None:
    def seeds(*counts):
        return [np.zeros(count) for count in counts]

    assert not separable(seeds(3), seeds(3)) and separable(seeds(4), seeds(4))
    assert not separable(seeds(1), seeds(9)) and separable(seeds(2), seeds(9))
    assert separable(seeds(3, 3), seeds(3, 3)) and not separable(seeds(3, 3), seeds(3, 3), [0, 0])


SURE = [name for name in STUDIES if name not in ("interquartile mean", "mean over uneven scenarios")]


@pytest.mark.parametrize("name", SURE)
def test_an_interval_covers_the_truth_as_often_as_it_says(name: str) -> None:
    assert 0.92 <= coverage(name, 10, 2000) <= 0.97


@pytest.mark.parametrize(
    ("name", "seeds"),
    [("interquartile mean", 10), ("mean over uneven scenarios", 6), ("mean", 6), ("mean", 4)],
)
def test_what_is_printed_of_few_seeds_is_true(name: str, seeds: int) -> None:
    low, high = COVERAGE[seeds]
    assert low - 0.01 <= coverage(name, seeds, 1000) <= high + 0.01
