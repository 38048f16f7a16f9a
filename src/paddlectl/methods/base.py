"""What a method is: how to make an agent that learns a task, and how to revive what it learned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any, NamedTuple

from paddlectl.agents.base import Agent, Policy
from paddlectl.agents.settings import changed, restored
from paddlectl.errors import UsageError
from paddlectl.logic.clauses import Program
from paddlectl.methods.catalogue import PLUGINS, entry_of, teacher_of
from paddlectl.plugins import attribute, require_kind
from paddlectl.tasks.base import Task


@dataclass(frozen=True)
class Source:
    """A policy that may be reused.

    Attributes:
        id: As the registry has it.
        task: What it has learned.
        program: What it executed when it was evaluated; None without clauses.
        digest: SHA-256 of its tensors.
        revive: Loads it, anew each time.
    """

    id: str
    task: Task
    program: Program | None
    digest: str
    revive: Callable[[], Policy]

    @cached_property
    def policy(self) -> Policy:
        """Loaded when it is first asked for."""
        return self.revive()


class Setup(NamedTuple):
    """All that an agent is made of.

    Attributes:
        task: To learn.
        settings: Of the method.
        seed: Of all its chance.
        frames: The budget.
        sources: To reuse; empty for a method without.
        scenario: What the user asked for; None for a source.
        rules: How sources are reused, beside the settings.
    """

    task: Task
    settings: Any
    seed: int
    frames: int
    sources: Sequence[Source] = ()
    scenario: Any = None
    rules: Any = None


def require_sources(name: str, setup: Setup, count: int | None = None) -> None:
    """Refuses a setup without the sources that a method needs.

    Args:
        name: Of the method.
        setup: What it is to be made of.
        count: How many it needs; None is one or more.

    Raises:
        UsageError: If they aren't there; with the command that learns the task without any.
    """
    given, task = len(setup.sources), setup.task.name
    if not given or given != (count or given):
        needed = f"{count} sources" if count and count > 1 else "a source"
        teacher = teacher_of(name, setup.task)
        way = f"learn it alone: paddlectl train {task} --method {teacher}"
        raise UsageError(
            f"{name} needs {needed} for {task}, and has {given or 'none'}",
            way if setup.task.definition is None else f"train its task file alone, by --method {teacher}",
        )


@dataclass(frozen=True, kw_only=True)
class Method:
    """What a method of the catalogue does.

    Attributes:
        name: As typed, and as kept with runs and policies.
        settings_for: Its numbers for a task and a scenario (None for a source), with changes such as
            `{"credit": {"planned": False}}`.
        settings_from: Those that were stored; what is missing is as in the last argument, or usual.
        make: Its agent.
        policy: One that has learned nothing, to take tensors.
        rules_for: How it reuses sources on a task; None if its settings tell all.
        presets: Other settings than the usual for a task, by the names that its `Entry` has for the domain.
    """

    name: str
    settings_for: Callable[..., Any]
    settings_from: Callable[..., Any]
    make: Callable[[Setup], Agent]
    policy: Callable[[Task, int, Any], Policy]
    rules_for: Callable[[Task], Any] = lambda _: None
    presets: Callable[[Task], Mapping[str, Any]] = lambda _: {}

    @classmethod
    def of_settings(
        cls,
        name: str,
        usual: Any,
        make: Callable[[Setup], Agent],
        policy: Callable[[Task, int, Any], Policy],
    ) -> "Method":
        """One whose usual settings fit every task: a frozen dataclass, in which there may be others."""
        return cls.of_usual(name, lambda _: usual, make, policy)

    @classmethod
    def of_usual(
        cls,
        name: str,
        usual: Callable[[Task], Any],
        make: Callable[[Setup], Agent],
        policy: Callable[[Task, int, Any], Policy],
        presets: Callable[[Task], Mapping[str, Any]] = lambda _: {},
    ) -> "Method":
        """One whose usual settings depend on the task, and on no scenario."""
        return cls(
            name=name,
            settings_for=lambda task, _, *changes: reduce(changed, changes, usual(task)),
            settings_from=lambda task, stored, missing=None: restored(
                missing or usual(task), stored, "settings"
            ),
            make=make,
            policy=policy,
            presets=presets,
        )


def method_of(name: str) -> Method:
    """The method of that name.

    Raises:
        UsageError: If there is none; with the nearest name.
        PaddlectlError: If it is a plug-in's that can't be used.
    """
    where = entry_of(name).where
    if name not in PLUGINS:
        method: Method = attribute(where)
        return method
    with PLUGINS.using(name):
        method = attribute(where)
        require_kind(method, Method)
        if method.name != name:
            raise ValueError(f"its method is called {method.name!r}")
    return method
