"""What a method is: how to make an agent that learns a task, and how to revive what it learned."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

from paddlectl.agents.base import Agent, Policy
from paddlectl.logic.clauses import Program
from paddlectl.methods.catalogue import entry_of
from paddlectl.tasks.base import Task


class Source(NamedTuple):
    """A policy that may be reused.

    Attributes:
        id: As the registry has it.
        policy: Revived.
        program: What it executed when it was evaluated; None without clauses.
    """

    id: str
    policy: Policy
    program: Program | None


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


@dataclass(frozen=True)
class Method:
    """What a method of the catalogue does.

    Attributes:
        name: As typed, and as kept with runs and policies.
        settings_for: Its numbers for a task and a scenario (None for a source), with changes such as
            `{"credit": {"planned": False}}`.
        settings_from: Those that were stored; what is missing is as in the last argument, or usual.
        rules_for: How it reuses sources on a task; None without sources.
        make: Its agent.
        policy: One that has learned nothing, to take tensors.
    """

    name: str
    settings_for: Callable[..., Any]
    settings_from: Callable[..., Any]
    rules_for: Callable[[Task], Any]
    make: Callable[[Setup], Agent]
    policy: Callable[[Task, int, Any], Policy]


def method_of(name: str) -> Method:
    """The method of that name.

    Raises:
        UsageError: If there is none; with the nearest name.
    """
    module, _, attribute = entry_of(name).where.partition(":")
    method: Method = getattr(import_module(module), attribute)
    return method
