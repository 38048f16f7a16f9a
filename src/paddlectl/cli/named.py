"""Policies by the names that a user types, and what can be done where there is none."""

from difflib import get_close_matches
from typing import TYPE_CHECKING

from paddlectl.errors import NotFoundError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.records import PolicyRecord
    from paddlectl.registry.store import Registry
    from paddlectl.tasks.suite import AnyTask


def task_named(text: str) -> "AnyTask":
    """The task of a name or of a file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task.
    """
    from paddlectl.cli.options import at_home
    from paddlectl.tasks.naming import given

    return given(at_home(text))


def policy_named(registry: "Registry", name: str) -> "PolicyRecord":
    """The policy of an id, or the best one of a task, which may be named by its file.

    Raises:
        NotFoundError: If there is none; what it says to train is a task.
        UsageError: If the name is of several tasks, each defined in a file.
        InvalidFileError: If the file isn't a task.
    """
    from paddlectl.registry.names import is_id
    from paddlectl.tasks.naming import content, is_file, typed
    from paddlectl.tasks.suite import known, names

    if is_file(name):
        task = task_named(name)
        try:
            return registry.policy(content(task))
        except NotFoundError as error:
            raise NotFoundError(error.message, f"run: paddlectl train {typed(task)}") from None
    try:
        return registry.policy(name)
    except NotFoundError as error:
        if is_id(name) or known(name):
            raise
        raise NotFoundError(error.message, _way_to(name, names(), registry.solved())) from None


def _way_to(name: str, tasks: "Sequence[str]", solved: "Sequence[str]") -> str:
    lowered = {task.lower(): task for task in (*tasks, *solved)}
    near = get_close_matches(name[:80].lower(), lowered, n=1)
    if not near:
        return "run: paddlectl tasks"
    task = lowered[near[0]]
    way = "run: paddlectl policies" if task in solved else f"run: paddlectl train {task}"
    return f"did you mean {task}? or {way}"
