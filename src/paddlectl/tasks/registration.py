"""The tasks' names in Gymnasium, `paddle/BoxDoor-v0`."""

from collections.abc import Iterable

import gymnasium


def environment_id(task: str) -> str:
    """Gymnasium's name of a task, `paddle/BoxDoor-v0`."""
    return f"paddle/{task}-v0"


def register(tasks: Iterable[str], entry_point: str) -> None:
    """Registers those of the tasks that Gymnasium doesn't know yet.

    Args:
        tasks: Their names.
        entry_point: `module:class` of their environment, which is made with its task's name.
    """
    for task in tasks:
        if environment_id(task) not in gymnasium.registry:
            gymnasium.register(id=environment_id(task), entry_point=entry_point, kwargs={"task": task})
