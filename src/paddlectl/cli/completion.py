"""What the shell is offered: tasks, policies, runs, files; silence if there is trouble."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.records import PolicyRecord, RunRecord
    from paddlectl.registry.store import Registry

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
    return _of_policies(_opened(registry).policies())


@_quiet
def source_names(registry: str | None, target: str | None) -> list[tuple[str, str]]:
    """Those that Ψ of the target can be shown from: of its domain."""
    from paddlectl.tasks.suite import load

    domain = load(target).domain if target else None
    policies = _opened(registry).policies()
    return _of_policies([policy for policy in policies if domain in (None, policy.domain)])


@_quiet
def transfer_names(registry: str | None) -> list[tuple[str, str]]:
    """Those that can be explained."""
    found = _of_runs([run for run in _opened(registry).runs() if run.kind == "transfer"])
    return [("latest", "the newest transfer"), *found] if found else []


@_quiet
def ended_names(registry: str | None) -> list[tuple[str, str]]:
    """Those that can be exported."""
    return _of_runs([run for run in _opened(registry).runs() if run.status != "running"])


@_quiet
def stopped_names(registry: str | None) -> list[tuple[str, str]]:
    """Those that can be resumed."""
    from paddlectl.registry.layout import is_held
    from paddlectl.registry.names import ELSEWHERE

    opened = _opened(registry)
    stopped = [
        run
        for run in opened.runs()
        if run.status != "finished"
        and run.method != "random"
        and not any(source.startswith(ELSEWHERE) for source in run.sources)
    ]
    return _of_runs([run for run in stopped if not is_held(opened.folder / "runs" / run.id)])


def _opened(registry: str | None) -> "Registry":
    from paddlectl.registry.store import Registry

    return Registry.open(registry or "registry", create=False)


def _of_policies(policies: "Sequence[PolicyRecord]") -> list[tuple[str, str]]:
    best = [(task, "its best policy") for task in dict.fromkeys(policy.task for policy in policies)]
    return best + [(policy.id, f"{policy.task}, {policy.method}") for policy in policies]


def _of_runs(runs: "Sequence[RunRecord]") -> list[tuple[str, str]]:
    return [(run.id, f"{run.method} on {run.task}") for run in runs]


@_quiet
def scenario_files(incomplete: str) -> list[str]:
    folder = Path(incomplete).parent if not incomplete.endswith("/") else Path(incomplete)
    found = [
        path for path in folder.expanduser().iterdir() if path.is_dir() or path.suffix in (".yaml", ".yml")
    ]
    shown = sorted(f"{folder / path.name}/" if path.is_dir() else str(folder / path.name) for path in found)
    return [name for name in shown if not name.startswith(".")]
