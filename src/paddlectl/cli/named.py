"""Policies by the names that a user types, and what can be done where there is none."""

from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, NamedTuple

from paddlectl.errors import NotFoundError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.records import PolicyRecord, RunRecord
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


class Labels(NamedTuple):
    """What new runs are called, as a job has it."""

    name: str | None = None
    tags: tuple[str, ...] = ()


UNLABELLED = Labels()


def labels_of(
    name: str | None, tags: "Sequence[str] | None", tasks: "Sequence[str]", location: str
) -> Labels:
    """What `--name` and `--tag` say of new runs, of a task each.

    Raises:
        UsageError: If several would have one name, or another run or a task has it, or something can't be a
            name or a tag, or a run is called as one of the tasks.
    """
    from paddlectl.registry.index.labels import row_of
    from paddlectl.registry.store import Registry

    row_of(name, tags or ())
    if name is not None:
        if len(tasks) > 1:
            raise UsageError(f"--name is of one run, and {len(tasks)} are asked for", "use --tag")
        require_no_task(name, tasks)
    with suppress(NotFoundError), Registry.open(location, create=False) as opened:
        opened.require_free(name, tasks)
    return Labels(name, tuple(tags or ()))


def require_no_task(name: str, tasks: "Sequence[str]" = ()) -> None:
    """Refuses a name for a run that is a task's, one of these among them.

    Raises:
        UsageError: If it is.
    """
    from paddlectl.tasks.suite import known

    if known(name) or name in tasks:
        raise UsageError(f"{name} is a task", "choose another name for the run")


def held(registry: "Registry", name: str) -> "RunRecord | PolicyRecord":
    """The run of an id, of a name or for `latest`; else the policy of an id, or the best one of a task.

    Raises:
        NotFoundError: If there is none.
        UsageError: If the name is of several tasks, each defined in a file.
        InvalidFileError: If the file isn't a task.
    """
    from paddlectl.registry.names import LATEST, is_id, nearest, number_of, shown
    from paddlectl.tasks.naming import is_file

    if number_of(name, "run") is not None or name == LATEST:
        return registry.run(name)
    try:
        return registry.run_called(name) or policy_named(registry, name)
    except NotFoundError:
        if name.lower().startswith("run"):
            return registry.run(name)  # tells what may have been meant
        near = "" if is_id(name) or is_file(name) else nearest(name, registry.run_names(name), 0.85)
        if not near:
            raise
        raise NotFoundError(f"no run or policy {shown(name)}", f"{near}run: paddlectl runs") from None


def learned(registry: "Registry", name: str) -> "PolicyRecord":
    """As `held`, a run's policy in its place.

    Raises:
        NotFoundError: Also if the run has none.
    """
    from paddlectl.registry.records import RunRecord

    found = held(registry, name)
    if not isinstance(found, RunRecord):
        return found
    if found.policy is None:
        raise NotFoundError(f"{found.id} has no policy: it is {found.status}", registry.way_on(found))
    return registry.policy(found.policy)


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
