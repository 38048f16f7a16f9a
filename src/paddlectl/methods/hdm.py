"""The hybrid decision model from scratch: a logic program picks subgoals, PPO or TD3 reaches them.

Cao et al. (2022), GALOIS, with the deviations that docs/method.md lists.
"""

from typing import Any

import numpy as np

from paddlectl.hybrid.agent import HybridAgent
from paddlectl.hybrid.policy import HybridPolicy, ProgramSelector
from paddlectl.hybrid.settings import HybridSettings, presets, settings_for, settings_from
from paddlectl.methods.base import Method, Setup
from paddlectl.tasks.base import Task


def make(setup: Setup) -> HybridAgent:
    """Its own program decides, its own low level acts."""
    learner = HybridPolicy(setup.task, setup.seed, setup.settings)
    layouts, choices = np.random.SeedSequence(setup.seed).spawn(2)
    selector = ProgramSelector(learner, np.random.default_rng(choices))
    return HybridAgent(learner, selector, [learner.low_level], np.random.default_rng(layouts.spawn(1)[0]))


def _settings(task: Task, _: Any, *changes: Any) -> HybridSettings:
    return settings_for(task, *changes)


HDM = Method(
    name="hdm",
    settings_for=_settings,
    settings_from=settings_from,
    make=make,
    policy=HybridPolicy,
    presets=presets,
)
