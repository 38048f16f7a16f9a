"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from paddlectl.registry.records import Label

T = TypeVar("T")


def _quiet(offers: Callable[..., list[T]]) -> Callable[..., list[T]]:
    @wraps(offers)
    def guarded(*arguments: str | None) -> list[T]:
        try:
            return offers(*arguments)
        except Exception:
            return []  # a completion that fails must not write into the user's prompt

    return guarded


@_quiet
def task_names() -> list[str]:
    from paddlectl.tasks.suite import names

    return list(names())


@_quiet
def policy_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    opened = Registry.open(registry or "registry", create=False)
    labels = opened.labels("policy")
    best = [(task, "its best policy") for task in dict.fromkeys(label.task for label in labels)]
    return best + _told(labels)


@_quiet
def run_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    opened = Registry.open(registry or "registry", create=False)
    return [("latest", "the newest transfer"), *_told(opened.labels("run"))]


@_quiet
def stopped_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    opened = Registry.open(registry or "registry", create=False)
    return _told(opened.labels("run", unfinished=True))


def _told(labels: "Iterable[Label]") -> list[tuple[str, str]]:
    return [(label.id, f"{label.method} on {label.task}") for label in labels]


@_quiet
def scenario_files(incomplete: str) -> list[str]:
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    found = [path for path in folder.iterdir() if path.is_dir() or path.suffix in (".yaml", ".yml")]
    shown = sorted(f"{path}/" if path.is_dir() else str(path) for path in found)
    return [name for name in shown if not name.startswith(".")]
