"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from threading import Thread
from typing import TypeVar

T = TypeVar("T")
PATIENCE = 1.0  # seconds for a registry whose server, disk or writer keeps one waiting


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


def _soon(asked: Callable[[], list[T]]) -> list[T]:
    """The answer.

    Raises:
        IndexError: If there is none, or not soon.
    """
    told: list[list[T]] = []

    @_quiet
    def ask() -> list[T]:
        told.append(asked())
        return told[0]

    thread = Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    return told[0]


@_quiet
def policy_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    policies = _soon(lambda: Registry.open(registry or "registry", create=False).policies())
    best = [(task, "its best policy") for task in dict.fromkeys(policy.task for policy in policies)]
    return best + [(policy.id, f"{policy.task}, {policy.method}") for policy in policies]


@_quiet
def run_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    runs = _soon(lambda: Registry.open(registry or "registry", create=False).runs())
    return [("latest", "the newest transfer")] + [(run.id, f"{run.method} on {run.task}") for run in runs]


@_quiet
def stopped_names(registry: str | None) -> list[tuple[str, str]]:
    from paddlectl.registry.store import Registry

    runs = _soon(lambda: Registry.open(registry or "registry", create=False).runs())
    return [(run.id, f"{run.method} on {run.task}") for run in runs if run.status != "finished"]


@_quiet
def scenario_files(incomplete: str) -> list[str]:
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    found = [path for path in folder.iterdir() if path.is_dir() or path.suffix in (".yaml", ".yml")]
    shown = sorted(f"{path}/" if path.is_dir() else str(path) for path in found)
    return [name for name in shown if not name.startswith(".")]
