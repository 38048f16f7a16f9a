"""The tasks' names in Gymnasium, `paddle/BoxDoor-v0`; importing this module registers all of them.

Gymnasium imports it by itself for `gymnasium.make("paddlectl.tasks.registration:paddle/BoxDoor-v0")`. What
an environment needs is imported when one is made. That of a task file is
`gymnasium.make("paddlectl.tasks.registration:paddle/File-v0", task="mytasks/KeyGoal.yaml")`.
"""

from typing import Any

import gymnasium

from paddlectl.tasks.maze2d import layouts as maze2d
from paddlectl.tasks.minigrid import layouts as minigrid


def environment_id(task: str) -> str:
    """Gymnasium's name of a task, `paddle/BoxDoor-v0`."""
    return f"paddle/{task}-v0"


ENTRY_POINTS = {
    **dict.fromkeys(minigrid.SPECS, "paddlectl.tasks.minigrid.env:PaddleEnv"),
    **dict.fromkeys(maze2d.SPECS, "paddlectl.tasks.maze2d.env:PaddleMazeEnv"),
}
"""Of each task, the class of its environment, which is made with the task's name."""

_ALL_SEEN = {"tile_size": 24, "highlight": False}
LOOKS: dict[str, dict[str, Any]] = {
    "paddlectl.tasks.minigrid.env:PaddleEnv": _ALL_SEEN,
    "paddlectl.tasks.rooms.env:RoomsEnv": _ALL_SEEN,
}
"""How pictures are made, where that isn't the usual way: nothing of the room is hidden from a policy."""

FILE = environment_id("File")
"""Gymnasium's name of all tasks from files; `task` is the file's path, or what it says."""

gymnasium.register(id=FILE, entry_point="paddlectl.tasks.files.loading:make_environment")
for _task, _entry_point in ENTRY_POINTS.items():
    gymnasium.register(id=environment_id(_task), entry_point=_entry_point, kwargs={"task": _task})
