"""All tasks by name. Nothing but names is here, so looking for one imports no environment."""

from difflib import get_close_matches
from importlib import import_module

from paddlectl.errors import NotFoundError
from paddlectl.tasks.base import Task
from paddlectl.tasks.maze2d import layouts as maze2d
from paddlectl.tasks.minigrid import layouts as minigrid

# name -> "module:attribute" of a function that makes the task of that name
TASKS: dict[str, str] = {
    **{name: "paddlectl.tasks.minigrid.engine:make_task" for name in minigrid.SPECS},
    **{name: "paddlectl.tasks.maze2d.engine:make_task" for name in maze2d.SPECS},
}


def names() -> tuple[str, ...]:
    """The names of all tasks, by domain."""
    return tuple(TASKS)


def load(name: str) -> Task:
    """The task of that name.

    Raises:
        NotFoundError: If there is none; it tells the nearest names.
    """
    if name not in TASKS:
        raise NotFoundError(f"no task {name}", _suggestion(name))
    module, attribute = TASKS[name].split(":")
    task: Task = getattr(import_module(module), attribute)(name)
    return task


def _suggestion(name: str) -> str:
    by_lower = {known.lower(): known for known in TASKS}
    near = [by_lower[match] for match in get_close_matches(name.lower(), by_lower, n=3)]
    return f"did you mean {' or '.join(near)}?" if near else f"tasks: {', '.join(TASKS)}"
