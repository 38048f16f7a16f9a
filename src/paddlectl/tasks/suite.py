"""All tasks by name. Nothing but names is here, so looking for one imports no environment.

Those of other distributions are the entry points of the group `paddlectl.tasks`: `Name = module:function`,
of a function that is given the name and makes the task. A file of the user's own has such functions by name
in `TASKS`.
"""

import json
import re
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from paddlectl.errors import InvalidFileError, NotFoundError, PaddlectlError
from paddlectl.plugins import Plugins, attribute, load_file, require_kind
from paddlectl.registry.fields import BUDGET, TASK
from paddlectl.registry.names import is_id
from paddlectl.tasks.base import Defined, DefinedTask, Definition, Task
from paddlectl.tasks.maze2d import layouts as maze2d
from paddlectl.tasks.minigrid import layouts as minigrid
from paddlectl.tasks.stock import families as stock

HORIZONS = range(1, 10**6 + 1)
"""Steps of an episode; of some environments the actions of those that go on are kept."""

TRIED = 30
"""Steps by which a task of a file is tried."""

AnyTask = str | Defined
"""A task by its name, or as a task file defines it (`tasks.naming.given`)."""

# name -> "module:attribute" of a function that makes the task of that name
TASKS: dict[str, str] = {
    **{name: "paddlectl.tasks.minigrid.engine:make_task" for name in minigrid.SPECS},
    **{name: "paddlectl.tasks.maze2d.engine:make_task" for name in maze2d.SPECS},
    **{name: "paddlectl.tasks.stock.tasks:make_task" for name in stock.FAMILIES},
}
PLUGINS = Plugins("task", TASKS, lambda name: re.fullmatch(TASK, name) and not is_id(name))


def add_file(file: Path) -> tuple[str, ...]:
    """Runs a Python file and takes in its tasks, for this process; gives their names.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it can't be used.
    """
    if not file.is_file():
        raise NotFoundError(f"no file {file}", "name a Python file")
    found = load_file(file, "TASKS")
    if not found:
        raise InvalidFileError(f"{file}: its TASKS is empty", 'write TASKS = {"MyTask": GymnasiumTask(…)}')
    if wrong := [name for name, each in found.items() if not callable(each)]:
        kind = type(found[wrong[0]]).__name__
        raise InvalidFileError(
            f"{file}: {wrong[0]} of its TASKS is no task but {kind}", "give a GymnasiumTask or a function"
        )
    PLUGINS.add(file, found)
    return tuple(found)


def names() -> tuple[str, ...]:
    """The names of all tasks: those built in by domain, then those of plug-ins."""
    return (*TASKS, *PLUGINS.names())


def known(name: AnyTask) -> bool:
    """Whether there is a task of that name; one that is defined is there."""
    return isinstance(name, Defined) or name in TASKS or name in PLUGINS


def load(name: AnyTask) -> Task:
    """The task of that name, or as it is defined.

    Raises:
        NotFoundError: If there is none; it tells the nearest names.
        PaddlectlError: If it is a plug-in's that can't be used.
    """
    if isinstance(name, Defined):
        return _defined(name.spec)
    if name in TASKS:
        task: Task = attribute(TASKS[name])(name)
        return task
    if name not in PLUGINS:
        raise NotFoundError(f"no task {name}", _suggestion(name))
    with PLUGINS.using(name) as make:
        task = make(name)
        require_kind(task, Task)
        if task.name != name:
            raise ValueError(f"its task is called {task.name!r}")
        if not re.fullmatch(TASK, task.domain):
            raise ValueError(f"domain can't be {task.domain!r}")
        _require_steps("horizon", task.horizon, HORIZONS)
        _require_steps("frames", task.frames, BUDGET)
    return task


def _require_steps(name: str, value: object, usual: range) -> None:
    if not isinstance(value, int) or value not in usual:
        raise ValueError(f"{name} must be a whole number in {usual[0]}..{usual[-1]:,}, not {value!r}")


def _defined(spec: Definition) -> Task:
    task: Task = attribute(spec.MADE_BY)(spec)
    return DefinedTask(**vars(task), told=json.dumps(spec.document()))


def require_playable(task: Task) -> None:
    """Plays a task of a file that was taken in a little, by chance; of another task it does nothing.

    Raises:
        PaddlectlError: If it can't be made, or something of it fails within `TRIED` steps.
    """
    if PLUGINS.from_file(task.name):
        with PLUGINS.using(task.name):
            environment, rng = task.make(1, 0), np.random.default_rng(0)
            for _ in range(TRIED):
                environment.valuation()
                environment.flat_state()
                for subgoal in map(task.domain_subgoals.index, task.subgoals):
                    asked = np.array([subgoal])
                    environment.reached(asked)
                    if environment.available(asked).all():
                        environment.observe(asked)
                step = environment.step(environment.actions.sample(rng, 1))
                environment.reset(step.terminated | step.truncated)


def usable(tell: Callable[[PaddlectlError], None] = lambda _: None) -> Iterator[Task]:
    """All tasks.

    Args:
        tell: Told of each of a plug-in that can't be used, which is left out.
    """
    for name in names():
        try:
            yield load(name)
        except PaddlectlError as error:
            tell(error)


def _suggestion(name: str) -> str:
    if "/" in name:
        return "a task file ends in .yaml"
    by_lower = {known.lower(): known for known in names()}
    near = [by_lower[match] for match in get_close_matches(name.lower(), by_lower, n=3)]
    return f"did you mean {' or '.join(near)}?" if near else "run: paddlectl tasks"
