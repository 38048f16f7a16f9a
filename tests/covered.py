"""How often intervals hold a truth that is known, in studies that are made up."""

import numpy as np

from paddlectl import statistics
from paddlectl.statistics import interval


def normal(generator, seeds, stratum):
    return generator.normal(0.0, 0.1, seeds)


def skewed(generator, seeds, stratum):
    return generator.beta(8, 2, seeds)


def uneven(generator, seeds, stratum):
    return generator.normal(0.0, 0.3 if stratum == 0 else 0.05, seeds)


INNER = 0.8173  # the interquartile mean of beta(8, 2)
# statistic, how scores come about, strata, the truth
STUDIES = {
    "mean": (statistics.mean, normal, 1, 0.0),
    "mean of skewed scores": (statistics.mean, skewed, 1, 0.8),
    "mean over uneven scenarios": (statistics.mean, uneven, 4, 0.0),
    "interquartile mean": (statistics.interquartile_mean, skewed, 1, INNER),
    "interquartile mean over scenarios": (statistics.interquartile_mean, skewed, 2, INNER),
    "improvement": (statistics.probability_of_improvement, normal, 1, 0.5),
}


def coverage(name: str, seeds: int, trials: int, *, expanded: bool = True) -> float:
    """The share of made-up studies in which the interval holds the truth."""
    statistic, scores, count, truth = STUDIES[name]
    generator, hits = np.random.default_rng(seeds), 0
    for _ in range(trials):
        given = [
            [scores(generator, seeds, k) for k in range(count)] for _ in range(2 if "impr" in name else 1)
        ]
        low, high = interval(statistic, *given, generator=generator, resamples=1000, expanded=expanded)
        hits += low - 1e-9 <= truth <= high + 1e-9
    return hits / trials
