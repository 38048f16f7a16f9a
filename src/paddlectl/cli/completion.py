"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import wraps
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from paddlectl.registry.records import Label
    from paddlectl.registry.store import Registry, Which

T = TypeVar("T")
MOST = 200
"""Ids that are offered at once, the newest: nobody reads more."""
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


def _soon(registry: str | None, which: "Which", incomplete: str) -> "list[Label]":
    return _answer(registry, lambda opened: opened.labels(which, incomplete, MOST))


def _answer(registry: str | None, asked: "Callable[[Registry], T]") -> T:
    """What the registry says.

    Raises:
        IndexError: If there is trouble, or no answer soon.
    """
    from paddlectl.registry.store import Registry

    found: list[T] = []

    def ask() -> None:
        with suppress(Exception):
            found.append(asked(Registry.open(registry or "registry", create=False)))

    thread = Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    return found[0]


@_quiet
def policy_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    return _tasks(registry) + _pairs(_soon(registry, "policies", incomplete))


@_quiet
def run_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Also such as go on."""
    return _pairs(_soon(registry, "runs", incomplete))


@_quiet
def stopped_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Those that can be resumed."""
    return _pairs(_soon(registry, "stopped", incomplete))


@_quiet
def source_names(registry: str | None, target: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Those that Ψ of the target can be shown from: of its domain, with clauses."""
    from paddlectl.methods.catalogue import entry_of, like
    from paddlectl.tasks.naming import given
    from paddlectl.tasks.suite import load, usable

    policies, domain = _soon(registry, "programs", incomplete), None
    if target:
        domain = load(given(target)).domain
        elsewhere = {task.name for task in usable() if task.domain != domain}
        policies = [policy for policy in policies if policy.task not in elsewhere]
    teachers = [other for name in entry_of("paddle").teaches for other in like(name)]
    return _tasks(registry, domain, tuple(teachers)) + _pairs(policies)


@_quiet
def transfer_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Those that can be explained."""
    if not _answer(registry, lambda opened: opened.labels("transfers", most=1)):
        return []
    return [("latest", "the newest transfer"), *_pairs(_soon(registry, "transfers", incomplete))]


@_quiet
def ended_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Those that can be exported, policies among them."""
    return policy_names(registry, incomplete) + _pairs(_soon(registry, "ended", incomplete))


@_quiet
def plotted_names(registry: str | None, incomplete: str = "") -> list[tuple[str, str]]:
    """Runs that have a whole curve."""
    return _pairs(_soon(registry, "ended", incomplete))


def _tasks(
    registry: str | None, domain: str | None = None, methods: tuple[str, ...] | None = None
) -> list[tuple[str, str]]:
    """Those that policies solve, of a domain or any, by these methods or whichever."""
    solved = _answer(registry, lambda opened: opened.solved(domain, methods))
    return [(task, "its best policy") for task in solved]


def _pairs(labels: "Iterable[Label]") -> list[tuple[str, str]]:
    """Each by its id, and by what its user calls it."""
    found = [(label, f"{label.method} on {label.task}") for label in labels]
    named = [(label.name, f"{label.id}: {what}") for label, what in found if label.name]
    return [*((label.id, what) for label, what in found), *named]


@_quiet
def compared_names(registry: str | None) -> list[str]:
    """Scenarios that have finished transfers."""
    return _answer(registry, lambda opened: opened.scenarios())


@_quiet
def figure_names() -> list[str]:
    from paddlectl.studies.grouped import FIGURES

    return list(FIGURES)


@_quiet
def result_files(incomplete: str) -> list[str]:
    """Studies and files of results."""
    return _files(incomplete, ".yaml", ".yml", ".json")


@_quiet
def shipped_scenarios() -> list[str]:
    from paddlectl import shipped

    return list(shipped.scenarios())


@_quiet
def shipped_studies() -> list[str]:
    from paddlectl import shipped

    return list(shipped.studies())


@_quiet
def scenario_files(incomplete: str) -> list[str]:
    """Scenarios and tasks."""
    return _files(incomplete, ".yaml", ".yml")


def _files(incomplete: str, *suffixes: str) -> list[str]:
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    found = [path for path in folder.expanduser().iterdir() if path.is_dir() or path.suffix in suffixes]
    shown = sorted(f"{folder / path.name}/" if path.is_dir() else str(folder / path.name) for path in found)
    return [name for name in shown if not name.startswith(".")]
