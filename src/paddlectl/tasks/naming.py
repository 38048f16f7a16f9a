"""Tasks as users name them: by name, or by a file that defines one. Only a file loads what reads it."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from paddlectl.errors import NotFoundError
from paddlectl.registry.names import quoted
from paddlectl.registry.records import Content
from paddlectl.tasks.suite import AnyTask, known

SUFFIXES = (".yaml", ".yml")


def is_file(text: str) -> bool:
    """Whether it names a file, as no task's name does."""
    return text.endswith(SUFFIXES)


def given(text: str, folder: Path = Path()) -> AnyTask:
    """The task that a user names; a name stays as it is, whether there is such a task or not.

    Args:
        text: A name, or the path of a task file.
        folder: Where a relative path begins.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a task; the message starts with file:line:column.
    """
    if is_file(text):
        from paddlectl.tasks.files.loading import load_task

        return load_task(folder / text)
    with suppress(OSError):
        if not known(text) and (folder / f"{text}.yaml").is_file():
            raise NotFoundError(f"no task {text}", f"did you mean {text}.yaml?")
    return text


def content(task: AnyTask) -> Content:
    """By what a registry knows the task."""
    return Content(task) if isinstance(task, str) else Content(task.spec.name, task.spec.document())


def typed(task: AnyTask) -> str:
    """The task as a user types it in a shell."""
    return task if isinstance(task, str) else quoted(task.file or task.spec.name)


def kept(name: str, definition: Mapping[str, Any] | None) -> AnyTask:
    """The task of a run or policy: by its name, or as it was defined then.

    Raises:
        IntegrityError: If the definition isn't one of that name.
    """
    if definition is None:
        return name
    from paddlectl.tasks.files.loading import stored_task

    return stored_task(name, definition)
