"""What a method is: how to make an agent that learns a task, and how to revive what it learned."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal, NamedTuple

from paddlectl.agents.base import Agent, Policy
from paddlectl.errors import UsageError
from paddlectl.logic.clauses import Program
from paddlectl.registry.names import nearest, shown
from paddlectl.tasks.base import Task

METHODS = {
    "paddle": "paddlectl.methods.paddle:PADDLE",
    "hdm": "paddlectl.methods.hdm:HDM",
    "random": "paddlectl.methods.hdm:RANDOM",
    "ppo": "paddlectl.methods.flat:FLAT_PPO",
    "td3": "paddlectl.methods.flat:FLAT_TD3",
}
"""Name -> module:attribute."""


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
    """A way to learn.

    Attributes:
        name: As typed, and as kept with runs and policies.
        summary: One line for a reader.
        sources: Whether it reuses policies.
        teaches: The method whose policies it reuses; None for one that reuses none.
        actions: Which actions it can choose, `discrete` or `continuous`.
        settings_for: Its numbers for a task and a scenario (None for a source), with changes such as
            `{"credit": {"planned": False}}`.
        settings_from: Those that were stored; what is missing is as in the last argument, or usual.
        rules_for: How it reuses sources on a task; None without sources.
        make: Its agent.
        policy: One that has learned nothing, to take tensors.
    """

    name: str
    summary: str
    sources: Literal["none", "many"]
    teaches: str | None
    actions: frozenset[str]
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
    if name not in METHODS:
        near = nearest(name, tuple(METHODS))
        raise UsageError(f"no method {shown(name)}", f"{near}one of: {', '.join(METHODS)}")
    module, _, attribute = METHODS[name].partition(":")
    method: Method = getattr(import_module(module), attribute)
    return method
