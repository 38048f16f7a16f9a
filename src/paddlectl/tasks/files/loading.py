"""Reads tasks from files, and as a registry keeps them."""

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from paddlectl.errors import IntegrityError, InvalidFileError
from paddlectl.tasks.base import Defined, Definition
from paddlectl.tasks.files import rooms, two_rooms
from paddlectl.tasks.files.common import TaskFile
from paddlectl.yaml_files import Kind, check_values, load_file

_KIND: Kind[Any] = replace(two_rooms.KIND, others={"rooms": rooms.KIND})
_STORED: Kind[Any] = replace(two_rooms.STORED, others={"rooms": rooms.STORED})


def load_task(path: Path) -> Defined:
    """Reads and checks a task file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task, or one that can't be solved; the message starts with
            file:line:column.
    """
    return Defined(_definition(load_file(path, _KIND), path), str(path))


def make_environment(task: str | Definition, **kwargs: Any) -> Any:
    """The Gymnasium environment of a task file, a `tasks.environment.TaskEnv`.

    Args:
        task: The file's path, or what it says.
        **kwargs: Of the environment.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task, or one that can't be solved.
    """
    definition = load_task(Path(task)).spec if isinstance(task, str) else task
    module, _, name = definition.ENVIRONMENT.partition(":")
    return getattr(import_module(module), name)(definition, **kwargs)


def stored_task(name: str, definition: Mapping[str, Any]) -> Defined:
    """The task of a run or policy, as it was when that was learned.

    Raises:
        IntegrityError: If what is stored isn't a task of that name.
    """
    try:
        found = _definition(check_values(definition, _STORED), Path(name))
    except InvalidFileError as error:
        raise IntegrityError(
            f"the definition of {name} isn't what this version keeps: {error.message}",
            "use the version of paddlectl that learned it",
        ) from error
    if found.name != name:
        raise IntegrityError(f"the definition of {name} is of {found.name}", "run: paddlectl registry check")
    return Defined(found)


def _definition(found: TaskFile, path: Path) -> Definition:
    if isinstance(found, rooms.RoomsFile):
        return rooms.plan_of(found, path)
    assert isinstance(found, two_rooms.TwoRoomsFile)
    return two_rooms.spec_of(found, path)
