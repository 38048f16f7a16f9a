"""DoorBall, in which taking the key pays instead of opening the door: one more task of MiniGrid."""

from dataclasses import replace

from paddlectl.tasks.minigrid.engine import task_of
from paddlectl.tasks.minigrid.layouts import SPECS
from paddlectl.tasks.minigrid.symbols import GT_KEY


def make_task(name):
    summary = "DoorBall, in which the key pays and the door doesn't."
    return task_of(replace(SPECS["DoorBall"], name=name, summary=summary, milestones=(GT_KEY,)))
