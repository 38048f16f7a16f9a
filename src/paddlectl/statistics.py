"""Statistics of scores over seeds, each with an interval by the stratified bootstrap.

A sample is one method's scores: a sequence of strata, one a scenario, each an array [..., seeds]; strata may
differ in their seeds. Every statistic gives an array [...], so it takes all resamples in one call. On equal
seeds the statistics are those of rliable (Agarwal et al. 2021).
"""

from collections.abc import Callable, Sequence
from math import comb, prod, sqrt
from statistics import NormalDist
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Scores: TypeAlias = NDArray[np.float64]
Sample: TypeAlias = Sequence[Scores]
Statistic: TypeAlias = Callable[..., Any]

LEVEL = 0.95
RESAMPLES = 50_000
COVERAGE = {10: (0.93, 0.98), 6: (0.91, 0.98), 4: (0.86, 0.98)}
"""Seeds -> in which share of simulated studies an expanded interval covers the truth, at worst and at best.

The mean of one scenario is at the lower end, of four that differ in spread also below it; its interquartile
mean and the probability of improvement are at the upper end.
"""


def interquartile_mean(sample: Sample) -> Scores:
    """The mean of all scores without the lowest and the highest quarter."""
    scores = np.concatenate(sample, axis=-1)
    count = scores.shape[-1]
    cut = count // 4
    inner = np.partition(scores, (cut, count - cut - 1), axis=-1)[..., cut : count - cut]
    return np.asarray(inner.mean(-1))


def mean(sample: Sample) -> Scores:
    """The mean over strata of the mean over seeds."""
    return np.asarray(_means(sample).mean(-1))


def median(sample: Sample) -> Scores:
    """The median over strata of the mean over seeds."""
    return np.asarray(np.median(_means(sample), axis=-1))


def seed_median(sample: Sample) -> Scores:
    """The median of all scores."""
    return np.asarray(np.median(np.concatenate(sample, axis=-1), axis=-1))


def optimality_gap(sample: Sample, target: float = 1.0) -> Scores:
    """How far below the target the scores are in the mean; those above it count as the target."""
    return np.asarray(target - np.minimum(np.concatenate(sample, axis=-1), target).mean(-1))


def probability_of_improvement(sample: Sample, other: Sample) -> Scores:
    """That a score of the sample is above one of the other, in the mean over strata; ties count half."""
    return np.asarray(np.mean([_above(x, y) for x, y in zip(sample, other, strict=True)], axis=0))


def performance_profile(sample: Sample, thresholds: Scores) -> Scores:
    """The share of all scores above each threshold.

    Returns:
        [..., thresholds].
    """
    scores = np.concatenate(sample, axis=-1)
    return np.stack([(scores > threshold).mean(-1) for threshold in thresholds], axis=-1)


def _means(sample: Sample) -> Scores:
    return np.stack([scores.mean(-1) for scores in sample], axis=-1)


def _above(scores: Scores, others: Scores) -> Scores:
    ours, theirs = scores[..., :, None], others[..., None, :]
    wins, losses = (np.count_nonzero(a > b, axis=(-2, -1)) for a, b in ((ours, theirs), (theirs, ours)))
    return np.asarray((1 + (wins - losses) / (ours.shape[-2] * theirs.shape[-1])) / 2)


def interval(
    statistic: Statistic,
    *samples: Sample,
    generator: np.random.Generator,
    together: Sequence[int] | None = None,
    resamples: int = RESAMPLES,
    expanded: bool = True,
) -> tuple[Any, Any]:
    """Both ends of a statistic's 95 % interval by the percentile bootstrap over seeds.

    The plain percentile interval is rliable's. It is too short where seeds are few: at ten it covers the mean
    in 90 % of simulated studies, at six in 85 %. The expanded one (Hesterberg 2015) is of percentiles further
    out, by what Student's t has over the normal, and the seeds' variance over that of resamples: COVERAGE.

    Args:
        statistic: Takes as many samples as are given.
        samples: Each with arrays [seeds], two seeds or more in each stratum.
        generator: Draws the resamples.
        together: A number for each stratum; those of one number share runs, and their seeds are drawn as one.
        resamples: How many.
        expanded: Whether not to take the plain one.
    """
    drawn = [_redrawn(sample, together, resamples, generator) for sample in samples]
    tail = _expanded_tail(samples, together) if expanded else (1 - LEVEL) / 2
    # None is interpolated, for between two infinite ones there is nothing.
    low, high = np.quantile(statistic(*drawn), (tail, 1 - tail), axis=0, method="inverted_cdf")
    return low, high


def separable(sample: Sample, other: Sample, together: Sequence[int] | None = None) -> bool:
    """Whether the seeds suffice to tell two methods apart: four of each do in a single stratum.

    Three don't: all scores of one are above all of the other in a tenth of the studies of equal methods.
    """
    sizes = zip(_seeds(sample, together), _seeds(other, together), strict=True)
    return prod(comb(ours + theirs, ours) for ours, theirs in sizes) * (1 - LEVEL) > 2


def _redrawn(
    sample: Sample, together: Sequence[int] | None, resamples: int, generator: np.random.Generator
) -> list[Scores]:
    """Of each stratum as many scores as there are, with replacement. [resamples, seeds]"""
    drawn: dict[tuple[int, int], NDArray[np.intp]] = {}
    keys = list(zip(together or range(len(sample)), map(len, sample), strict=True))
    for key in dict.fromkeys(keys):
        drawn[key] = generator.integers(key[1], size=(key[1], resamples))
    # Seeds come first in memory, so that sums over them are quick.
    return [scores[drawn[key]].T for key, scores in zip(keys, sample, strict=True)]


def _seeds(sample: Sample, together: Sequence[int] | None) -> list[int]:
    """How many seeds there are in each stratum, those that are drawn together being one."""
    return list(dict(zip(together or range(len(sample)), map(len, sample), strict=True)).values())


def _expanded_tail(samples: Sequence[Sample], together: Sequence[int] | None) -> float:
    counts = [seeds for sample in samples for seeds in _seeds(sample, together)]
    fewest = min(counts)
    return NormalDist().cdf(-sqrt(fewest / (fewest - 1)) * _student(sum(counts) - len(counts)))


def _student(freedom: int) -> float:
    """The 97.5 % quantile of Student's t by its Cornish-Fisher expansion, 0.1 % off at five degrees."""
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    terms = (
        z,
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return sum(term / float(freedom) ** power for power, term in enumerate(terms))
