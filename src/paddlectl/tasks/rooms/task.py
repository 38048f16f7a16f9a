"""Several rooms as a task of the domain of MiniGrid's own environments (`tasks.stock`)."""

from dataclasses import replace
from functools import partial

from paddlectl.tasks.base import Environment, Split, Task
from paddlectl.tasks.gymnasium import GymnasiumTask
from paddlectl.tasks.rooms.plan import Plan
from paddlectl.tasks.stock.tasks import told_in

_ENVIRONMENT = "paddlectl.tasks.registration:paddle/File-v0"


def task_of(plan: Plan) -> Task:
    """The task, whose environments draw layouts of their own split."""
    return replace(_over(plan, "training")(plan.name), make=partial(_made, plan))


def _made(
    plan: Plan, num_envs: int, seed: int, action_repeat: int = 1, split: Split = "training"
) -> Environment:
    return _over(plan, split)(plan.name).make(num_envs, seed, action_repeat, split)


def _over(plan: Plan, split: Split) -> GymnasiumTask:
    return told_in(
        plan.facts,
        plan.subgoals,
        env=_ENVIRONMENT,
        summary=plan.summary,
        horizon=plan.horizon,
        milestones=plan.milestones,
        options={"task": plan, "split": split, "milestone_reward": 0.0},
    )
