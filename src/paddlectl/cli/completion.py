"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from paddlectl.registry.store import Registry

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


def _soon(registry: str | None, offers: Callable[["Registry"], list[T]]) -> list[T]:
    """What the registry offers.

    Raises:
        IndexError: If there is trouble, or no answer soon.
    """
    from paddlectl.registry.store import Registry

    told: list[list[T]] = []

    def ask() -> None:
        with suppress(Exception):
            told.append(offers(Registry.open(registry or "registry", create=False)))

    thread = Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    return told[0]


def _policies(registry: "Registry") -> list[tuple[str, str]]:
    policies = registry.policies()
    best = [(task, "its best policy") for task in dict.fromkeys(policy.task for policy in policies)]
    return best + [(policy.id, f"{policy.task}, {policy.method}") for policy in policies]


def _runs(registry: "Registry") -> list[tuple[str, str]]:
    return [(run.id, f"{run.method} on {run.task}") for run in registry.runs()]


def _stopped(registry: "Registry") -> list[tuple[str, str]]:
    return [(run.id, f"{run.method} on {run.task}") for run in registry.runs() if run.status != "finished"]


@_quiet
def policy_names(registry: str | None) -> list[tuple[str, str]]:
    return _soon(registry, _policies)


@_quiet
def run_names(registry: str | None) -> list[tuple[str, str]]:
    return [("latest", "the newest transfer"), *_soon(registry, _runs)]


@_quiet
def held_names(registry: str | None) -> list[tuple[str, str]]:
    return _soon(registry, lambda opened: _policies(opened) + _runs(opened))


@_quiet
def stopped_names(registry: str | None) -> list[tuple[str, str]]:
    return _soon(registry, _stopped)


@_quiet
def scenario_files(incomplete: str) -> list[str]:
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    found = [path for path in folder.iterdir() if path.is_dir() or path.suffix in (".yaml", ".yml")]
    shown = sorted(f"{path}/" if path.is_dir() else str(path) for path in found)
    return [name for name in shown if not name.startswith(".")]
