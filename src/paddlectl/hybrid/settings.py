"""The numbers of the hybrid model: the usual ones, those that fit a domain better, and its presets."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from typing import Any

from paddlectl.agents.settings import changed, restored
from paddlectl.hybrid.credit import CreditSettings
from paddlectl.hybrid.rollout import DecisionSettings
from paddlectl.learners.base import LearnerSettings
from paddlectl.learners.clauses import ClauseSettings
from paddlectl.learners.ppo import PPOSettings
from paddlectl.learners.td3 import TD3Settings
from paddlectl.ranges import Environments, Frames, NotNegative, Steps
from paddlectl.tasks.base import FRAMES, Task
from paddlectl.tasks.maze2d.layouts import COLUMNS, RADIUS, ROWS


@dataclass(frozen=True)
class HybridSettings:
    """Every number of the hybrid model.

    Attributes:
        frames: Of a source's training. PPO's learning rate falls to its end, so there is no stopping early.
        num_envs: Environments side by side.
        rollout_steps: Steps of every environment between two updates. Twice as many updates of half the
            samples cost the same and learn faster.
        action_repeat: Steps of the task that one action of the low level lasts.
        sharpness: Power of the subgoal probabilities when a learned program is played.
    """

    frames: Frames = FRAMES
    num_envs: Environments = 64
    rollout_steps: Steps = 32
    action_repeat: Steps = 1
    sharpness: NotNegative = 3.0
    credit: CreditSettings = field(default_factory=CreditSettings)
    clauses: ClauseSettings = field(default_factory=ClauseSettings)
    low_level: LearnerSettings = field(default_factory=PPOSettings)
    decisions: DecisionSettings = field(default_factory=DecisionSettings)


LOW_LEVELS: Mapping[str, type[LearnerSettings]] = {"ppo": PPOSettings, "td3": TD3Settings}

TABLE_1 = TD3Settings()
"""TD3 as Table 1 and its paper have it."""

GOAL_REWARD = 10.0

MAZE_TD3 = TD3Settings(
    learning_rate=1e-3, final_rate=0.2, optimiser="adam", discount=0.92, update_every=16, tau=0.05,
    hidden=(256, 256), normalised=True, exploration=0.2, random_actions=0.9, goal_exploration=0.5,
    cloning=True, goal_size=2, radius=RADIUS, goal_reward=GOAL_REWARD, grid=(COLUMNS, ROWS), hindsight=0.6,
    other_goals=0.4, lower_bound=True, saturation_cost=1.0,
)  # fmt: skip
"""TD3 as the maze is learned with it."""

DEVIATIONS: Mapping[str, tuple[Any, Any]] = {
    each.name: (getattr(TABLE_1, each.name), getattr(MAZE_TD3, each.name))
    for each in fields(TD3Settings)
    if getattr(TABLE_1, each.name) != getattr(MAZE_TD3, each.name)
}
"""A number of TD3's -> what Table 1 and the TD3 paper have, and what the maze is learned with."""

USUAL: Mapping[str, HybridSettings] = {
    "minigrid": HybridSettings(decisions=DecisionSettings(max_steps=25, patience=0.6, shaping=0.05)),
    "minigrid-stock": HybridSettings(decisions=DecisionSettings(max_steps=40, patience=0.6, shaping=0.05)),
    "maze2d": HybridSettings(
        num_envs=32,
        rollout_steps=8,
        action_repeat=20,
        clauses=ClauseSettings(step_discount=0.999),
        low_level=MAZE_TD3,
        decisions=DecisionSettings(
            max_steps=500,
            patience=0.7,
            reward_unit=100.0,
            reached_reward=GOAL_REWARD,
            delay_cost=0.0,
            failed_reward=0.0,
        ),
    ),
}
"""By domain, whatever made its tasks learn sooner, but for `frames`, which is the task's; of a domain that
isn't here, the defaults.

In MiniGrid a low level that is told whether it comes nearer reaches a subgoal in 25 steps or hardly at all.

In the maze an action that lasts 20 steps (0.2 s) takes the ball about a cell on, so that a way through it is
a dozen actions long and each of them makes a difference.
"""

PRESETS: Mapping[str, Mapping[str, HybridSettings]] = {
    "paper": {"maze2d": replace(USUAL["maze2d"], action_repeat=1, low_level=TABLE_1)},
}
"""Others that a source can be learned with, by name and domain: `paper` is Table 1's TD3, with no promise of
when it has learned.
"""


def settings_for(task: Task, *changes: Mapping[str, Any]) -> HybridSettings:
    """The usual ones of the task with `changes`, such as `{"credit": {"planned": False}}`."""
    usual = replace(USUAL.get(task.domain, _default(task)), frames=task.frames)
    return reduce(changed, changes, usual)


def presets(task: Task) -> Mapping[str, HybridSettings]:
    """Those of the task's domain, by name."""
    return {
        name: replace(by_domain[task.domain], frames=task.frames)
        for name, by_domain in PRESETS.items()
        if task.domain in by_domain
    }


def settings_from(task: Task, stored: Any, missing: HybridSettings | None = None) -> HybridSettings:
    """The settings that `dataclasses.asdict` made `stored` of, also by way of JSON, which has no tuples.

    A name that isn't there came later: it has its value in `missing`, or the default, whatever the numbers of
    the domain are today.

    Raises:
        ValueError: If there is a name that this version doesn't know, or a value of another kind.
    """
    settings: HybridSettings = restored(missing or _default(task), stored, "settings")
    return settings


def _default(task: Task) -> HybridSettings:
    return HybridSettings(low_level=LOW_LEVELS[task.learner]())
