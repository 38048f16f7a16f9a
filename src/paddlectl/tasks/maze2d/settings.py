"""How the maze is learned: what fits it, and the presets `paper` and `guided`."""

from collections.abc import Mapping
from typing import Any

from paddlectl.tasks.base import GUIDED
from paddlectl.tasks.maze2d.layouts import COLUMNS, RADIUS, ROWS

GOAL_REWARD = 10.0

DEVIATIONS: Mapping[str, tuple[Any, Any]] = {
    "learning_rate": (2e-4, 1e-3),
    "final_rate": (1.0, 0.2),
    "optimiser": ("rmsprop", "adam"),
    "discount": (0.99, 0.92),
    "update_every": (2, 16),
    "tau": (0.005, 0.05),
    "hidden": ((400, 400, 400), (256, 256)),
    "normalised": (False, True),
    "exploration": (0.1, 0.2),
    "random_actions": (0.0, 0.9),
    "goal_exploration": (0.0, 0.5),
    "cloning": (False, True),
    "goal_size": (0, 2),
    "radius": (0.0, RADIUS),
    "goal_reward": (1.0, GOAL_REWARD),
    "grid": ((), (COLUMNS, ROWS)),
    "hindsight": (0.0, 0.6),
    "other_goals": (0.0, 0.4),
    "lower_bound": (False, True),
    "saturation_cost": (0.0, 1.0),
}
"""A number of TD3's -> what Table 1 and the TD3 paper have, and what the maze is learned with."""

_TABLE_1 = {name: values[0] for name, values in DEVIATIONS.items()}
_LOW_LEVEL = {name: values[1] for name, values in DEVIATIONS.items()}

USUAL: Mapping[str, Any] = {
    "num_envs": 32,
    "rollout_steps": 8,
    "action_repeat": 20,
    "decisions": {
        "max_steps": 500,
        "patience": 0.7,
        "reward_unit": 100.0,
        "reached_reward": GOAL_REWARD,
        "delay_cost": 0.0,
        "failed_reward": 0.0,
    },
    "clauses": {"step_discount": 0.999},
    "low_level": _LOW_LEVEL,
}
"""What differs from `HybridSettings` in every maze."""

SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "CoffeeMaze": {**USUAL, "frames": 4_000_000},
    "MailMaze": {**USUAL, "frames": 2_000_000},
    "CoffeeMailMaze": {**USUAL, "frames": 4_000_000},
}
"""What differs from `HybridSettings`, by task: whatever made it learn sooner.

An action that lasts 20 steps (0.2 s) takes the ball about a cell on, so that a way through the maze is a
dozen actions long and each of them makes a difference.
"""

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "paper": {"action_repeat": 1, "low_level": _TABLE_1},
    GUIDED: {
        "num_envs": 1,
        "rollout_steps": 256,
        "action_repeat": 5,
        "decisions": {"reward_unit": 60.0},
        "clauses": {"step_discount": 0.998},
        "credit": {"imitation_margin": 0.02},
    },
}
"""What differs from that: `paper` is Table 1's TD3, with no promise of when it has learned.

`guided` is how a target is learned from guides. The ways that they know are gone faster with an action every
5 steps. One lane plays: of many that start at once, all would make the same mistakes. Hindsight has taught
the source that it inherits from to go from most places to most others, and what it lacks it takes from the
other guides (`cloning`): in the few updates that a transfer has time for, TD3 would unlearn more than it
would add. A step costs 0.09 of a score near 40, hence its discount. Rewards are counted such that what the
first order of play that works is worth stays below ψ in most scenes, so that guides which weren't asked
there yet are asked once.
"""

GUIDANCE: Mapping[str, Any] = {"similarity_decay": 0.3, "forced_trial_rate": 0.05}
"""A decision that fails takes a third of an episode here, so that guides are soon judged by what came of
them, and the target is heard less often.
"""
