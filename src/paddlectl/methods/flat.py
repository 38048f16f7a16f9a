"""PPO (Schulman et al., 2017) and TD3 (Fujimoto et al., 2018) alone, on the task's whole state."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from paddlectl.agents.flat import FlatAgent, FlatPolicy, FlatSettings
from paddlectl.agents.settings import changed, restored
from paddlectl.learners.ppo import PPOSettings
from paddlectl.learners.td3 import TD3Settings
from paddlectl.methods.base import Method, Setup
from paddlectl.tasks.base import Task

USUAL = {
    "ppo": FlatSettings(learner=PPOSettings()),
    "td3": FlatSettings(
        frames=2_000_000,
        lanes=32,
        block=8,
        repeat=20,
        reward_unit=100.0,
        learner=TD3Settings(
            learning_rate=1e-3, final_rate=0.2, optimiser="adam", update_every=16, tracking=0.05,
            hidden=(256, 256), normalised=True, exploration=0.2, random_actions=0.9, saturation_cost=1.0,
        ),
    ),
}  # fmt: skip
"""TD3's are those that the hybrid model learns the maze with, but for what needs goals."""


def make(setup: Setup) -> FlatAgent:
    """The learner, and its exploration."""
    policy = FlatPolicy(setup.task, setup.seed, setup.settings)
    return FlatAgent(policy, np.random.default_rng(np.random.SeedSequence(setup.seed).spawn(2)[1]))


def _method(name: str) -> Method:
    def settings_for(_: Task, __: Any, *changes: Mapping[str, Any]) -> FlatSettings:
        settings = USUAL[name]
        for change in changes:
            settings = changed(settings, change)
        return settings

    def settings_from(_: Task, stored: Any, missing: FlatSettings | None = None) -> FlatSettings:
        settings: FlatSettings = restored(missing or USUAL[name], stored, "settings")
        return settings

    return Method(
        name=name,
        settings_for=settings_for,
        settings_from=settings_from,
        rules_for=lambda _: None,
        make=make,
        policy=FlatPolicy,
    )


FLAT_PPO = _method("ppo")
FLAT_TD3 = _method("td3")
