"""PPO (Schulman et al., 2017) and TD3 (Fujimoto et al., 2018) alone, on the task's whole state."""

import numpy as np

from paddlectl.agents.flat import FlatAgent, FlatPolicy, FlatSettings
from paddlectl.learners.ppo import PPOSettings
from paddlectl.learners.td3 import TD3Settings
from paddlectl.methods.base import Method, Setup

PPO_ALONE = PPOSettings(entropy_coef=0.05)
"""Those of the hybrid model's low level but for the entropy: a reward comes so late here that with 0.01 it
has settled on some actions before it was ever paid."""

USUAL = {
    "ppo": FlatSettings(frames=250_000, learner=PPO_ALONE),
    "td3": FlatSettings(
        frames=2_000_000,
        num_envs=32,
        rollout_steps=8,
        action_repeat=20,
        reward_unit=10.0,
        learner=TD3Settings(
            learning_rate=1e-3, final_rate=0.2, optimiser="adam", discount=0.98, batch=128, update_every=8,
            tau=0.05, hidden=(256, 256), normalised=True, exploration=0.2, random_actions=0.5,
            random_steps=5.0, novelty=0.1, saturation_cost=1.0,
        ),
    ),
}  # fmt: skip
"""TD3's networks and rates are those that the hybrid model learns the maze with. What that model finds by its
subgoals, TD3 alone has to come upon: by random actions that last and by novelty. Milestones count 1 each, so
that a critic tells them from its own errors.
"""


def make(setup: Setup) -> FlatAgent:
    """The learner, and its exploration."""
    policy = FlatPolicy(setup.task, setup.seed, setup.settings)
    return FlatAgent(policy, np.random.default_rng(np.random.SeedSequence(setup.seed).spawn(2)[1]))


FLAT_PPO = Method.of_settings("ppo", USUAL["ppo"], make, FlatPolicy)
FLAT_TD3 = Method.of_settings("td3", USUAL["td3"], make, FlatPolicy)
