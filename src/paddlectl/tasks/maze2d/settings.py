"""How the maze is learned: the presets `default` and `paper`."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from paddlectl.tasks.maze2d.layouts import COLUMNS, RADIUS, ROWS

GOAL_REWARD = 10.0


class Preset(NamedTuple):
    """A way to learn the maze.

    Attributes:
        repeat: Steps that one action lasts.
        settings: What differs from `HybridSettings`.
    """

    repeat: int
    settings: Mapping[str, Any]


_DECISIONS = {
    "max_steps": 500,
    "patience": 0.7,
    "reward_unit": 100.0,
    "reached_reward": GOAL_REWARD,
    "delay_cost": 0.0,
    "failed_reward": 0.0,
}
_HIGH_LEVEL = {
    "lanes": 32,
    "block": 8,
    "decisions": _DECISIONS,
    "clauses": {"step_discount": 0.999},
}
_DEVIATIONS = {
    "learning_rate": 1e-3,
    "final_rate": 0.2,
    "optimiser": "adam",
    "discount": 0.92,
    "update_every": 16,
    "tracking": 0.05,
    "hidden": (256, 256),
    "normalised": True,
    "exploration": 0.2,
    "random_actions": 0.9,
    "errands": 0.5,
    "capacity": 400_000,
    "goal_size": 2,
    "radius": RADIUS,
    "goal_reward": GOAL_REWARD,
    "grid": (COLUMNS, ROWS),
    "hindsight": 0.6,
    "other_goals": 0.4,
    "lower_bound": True,
    "saturation_cost": 1.0,
}
_OF_TASK: Mapping[str, Preset] = {
    "CoffeeMaze": Preset(20, {"frames": 4_000_000}),
    "MailMaze": Preset(20, {"frames": 2_000_000}),
    "CoffeeMailMaze": Preset(
        5,
        {
            "frames": 500_000,
            "lanes": 1,
            "block": 256,
            "decisions": {**_DECISIONS, "reward_unit": 55.0},
            "low_level": {
                **_DEVIATIONS,
                "learning_rate": 3e-4,
                "inherited_rate": 0.0,
                "discount": 0.98,
                "span": 100,
                "errand_steps": 40.0,
            },
        },
    ),
}


def _default(task: str) -> Preset:
    """Whatever made it learn sooner.

    An action that lasts 20 steps (0.2 s) takes the ball about a cell on, so that a way through the maze is a
    dozen actions long and each of them makes a difference. Once it is known, the same ways are gone a tenth
    faster with an action every 5 steps, and the target has little time to lose. The discount is the same for
    the same time.

    The target plays in one lane: of many that start at once, all would make the same mistakes. It keeps the
    ways that it inherits: hindsight has taught its source to go from most places to most others, and the few
    updates that a transfer has time for unlearn some of them rather than add to them. Rewards are
    counted such that a good order of play is worth more than ψ promises of an untried guide, and a bad one
    less.
    """
    own = _OF_TASK[task]
    return Preset(own.repeat, {**_HIGH_LEVEL, "low_level": _DEVIATIONS, **own.settings})


def _paper(task: str) -> Preset:
    """Table 1 to the letter, with no promise of when it has learned."""
    return Preset(1, {**_HIGH_LEVEL, "frames": _OF_TASK[task].settings["frames"]})


PRESETS: Mapping[str, Callable[[str], Preset]] = {"default": _default, "paper": _paper}

GUIDANCE: Mapping[str, Any] = {"fading": 0.3, "audition_rate": 0.05}
"""A decision that fails takes a third of an episode here, so that guides are soon judged by what came of
them, and the target is heard less often.
"""
