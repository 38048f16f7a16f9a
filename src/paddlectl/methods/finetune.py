"""GALOIS fine-tuning (Cao et al., 2022): the hybrid model starts as one source, and learns on.

1. For each source: the target starts with the source's clause weights where head and body match, all others
   as usual, N(0, 0.1); and with its low level.
2. The start that solves most of the target, before anything is learned, is taken.
3. `hdm` goes on from it.

A clause of the source matches one of the target with the same head whose body contains its own: a target
knows facts that its sources don't.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from paddlectl.agents.evaluation import evaluate
from paddlectl.hybrid.agent import HybridAgent
from paddlectl.hybrid.policy import HybridPolicy, ProgramSelector
from paddlectl.hybrid.settings import HybridSettings, settings_for, settings_from
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.methods.base import Method, Setup, require_sources
from paddlectl.ranges import Share
from paddlectl.tasks.base import Task

TRIALS = 64
"""Episodes, on training layouts, by which the source is chosen. Their frames aren't counted."""


@dataclass(frozen=True)
class Start:
    """How much of its source the target starts with.

    Attributes:
        inheritance: Its low level is a copy of the source's, its preferences weakened to this share, so that
            it explores again (TD3 has none to weaken).
    """

    inheritance: Share = 1.0


START = Start(inheritance=0.4)
"""By `benchmarks/tuning/finetune.yaml`: with all of its source's preferences it explores too little."""


class FinetuneAgent(HybridAgent):
    """`hdm`, and how its start was chosen."""

    def __init__(self, learner: HybridPolicy, seed: int, starts: Mapping[str, float], chosen: str) -> None:
        layouts, choices = np.random.SeedSequence(seed).spawn(2)
        selector = ProgramSelector(learner, np.random.default_rng(choices))
        actions = np.random.default_rng(layouts.spawn(1)[0])
        super().__init__(learner, selector, [learner.low_level], actions)
        self._start = {
            "source_that_it_goes_on_from": chosen,
            "success_of_each_start_before_learning": dict(starts),
        }

    def documents(self) -> Mapping[str, Any]:
        """Which source it started from, and how well each would have done."""
        return {"start": self._start}


def make(setup: Setup) -> FinetuneAgent:
    """The target as the best of its sources would start it.

    Raises:
        UsageError: Without sources.
    """
    require_sources("finetune", setup)
    starts = {source.id: start_from(source.policy, setup) for source in setup.sources}
    solved = {
        name: evaluate(start, setup.task, TRIALS, setup.seed, "training").success_rate
        for name, start in starts.items()
    }
    chosen = max(solved, key=lambda name: solved[name])
    return FinetuneAgent(starts[chosen], setup.seed, solved, chosen)


def start_from(source: Any, setup: Setup) -> HybridPolicy:
    """The target before it learns, with what it takes from a source."""
    target = HybridPolicy(setup.task, setup.seed, setup.settings)
    take_clauses(target.clauses, source.clauses)
    theirs, own = source.low_level.state(), target.low_level.state()
    if {name: tensor.shape for name, tensor in theirs.items()} == {n: t.shape for n, t in own.items()}:
        target.low_level.warm_start(theirs, (setup.rules or Start()).inheritance)
    return target


@torch.no_grad()
def take_clauses(target: ClauseLearner, source: ClauseLearner) -> None:
    """Copies the weights of the source's clauses that match."""
    columns = [(target.heads.index(head), h) for h, head in enumerate(source.heads) if head in target.heads]
    for row, body in enumerate(target.bodies):
        for theirs, known in enumerate(source.bodies):
            if known <= body:
                for own, column in columns:
                    target.weights[row, own] = source.weights[theirs, column]


LEARNS_ON: Mapping[str, Mapping[str, Any]] = {"maze2d": {"low_level": {"cloning": False}}}
"""By domain, what differs from the numbers of `hdm`: nobody guides, so there is no one to imitate."""


def _settings(task: Task, _: Any, *changes: Any) -> HybridSettings:
    return settings_for(task, LEARNS_ON.get(task.domain, {}), *changes)


FINETUNE = Method(
    name="finetune",
    settings_for=_settings,
    settings_from=settings_from,
    rules_for=lambda _: START,
    make=make,
    policy=HybridPolicy,
)
