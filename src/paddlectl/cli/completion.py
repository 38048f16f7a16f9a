"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from paddlectl.registry.records import Label
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
    labels = registry.labels("policy")
    best = [(task, "its best policy") for task in dict.fromkeys(label.task for label in labels)]
    return best + _told(labels)


def _runs(registry: "Registry") -> list[tuple[str, str]]:
    return _told(registry.labels("run"))


def _stopped(registry: "Registry") -> list[tuple[str, str]]:
    return _told(registry.labels("run", unfinished=True))


def _told(labels: "Iterable[Label]") -> list[tuple[str, str]]:
    return [(label.id, f"{label.method} on {label.task}") for label in labels]


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
