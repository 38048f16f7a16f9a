"""The methods by name, and what can be known of them without loading torch, or even NumPy.

Those of other distributions are the entry points of the group `paddlectl.methods`: `name = module:ENTRY`, of
an `Entry`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from paddlectl.errors import PaddlectlError, UsageError
from paddlectl.plugins import Plugins, require_kind
from paddlectl.registry.fields import METHOD
from paddlectl.registry.names import nearest, shown

if TYPE_CHECKING:
    from paddlectl.tasks.base import Task


class Entry(NamedTuple):
    """A way to learn.

    Attributes:
        where: Its `methods.base.Method`, as module:attribute.
        summary: One line for a reader.
        teaches: The methods whose policies it reuses, those of the one that can act on the task; none if it
            reuses none.
        like: Of one that is built in, the method that its policies can stand in for as sources, if any.
        actions: Which actions it can choose, of `discrete` and `continuous`.
        presets: The names of its `Method.presets`, by domain.
    """

    where: str
    summary: str
    teaches: tuple[str, ...]
    actions: frozenset[str]
    presets: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    like: str | None = None


_ANY = frozenset({"discrete", "continuous"})

METHODS: Mapping[str, Entry] = {
    "paddle": Entry(
        "paddlectl.methods.paddle:PADDLE",
        "logic and performance similarity pick a source that acts; the hybrid model learns",
        ("hdm",),
        _ANY,
        {"maze2d": ("guided",)},
        like="hdm",
    ),
    "hdm": Entry(
        "paddlectl.methods.hdm:HDM",
        "the hybrid model from scratch: a logic program picks subgoals, PPO or TD3 reaches them",
        (),
        _ANY,
        {"maze2d": ("paper",)},
    ),
    "hdqn": Entry(
        "paddlectl.methods.hdqn:HDQN",
        "a DQN picks subgoals, the hybrid model's low level reaches them",
        (),
        _ANY,
        {"maze2d": ("paper",)},
    ),
    "finetune": Entry(
        "paddlectl.methods.finetune:FINETUNE",
        "the hybrid model goes on from one source: its clause weights, where they match, and its low level",
        ("hdm",),
        _ANY,
        like="hdm",
    ),
    "ppo": Entry(
        "paddlectl.methods.flat:FLAT_PPO",
        "proximal policy optimisation on the whole state, without subgoals",
        (),
        frozenset({"discrete"}),
    ),
    "td3": Entry(
        "paddlectl.methods.flat:FLAT_TD3",
        "twin delayed DDPG on the whole state, without subgoals",
        (),
        frozenset({"continuous"}),
    ),
    "cup": Entry(
        "paddlectl.methods.cup:CUP",
        "the critic picks the source of largest advantage in each state, and the target is drawn to it",
        ("ppo", "td3"),
        _ANY,
    ),
    "ptf": Entry(
        "paddlectl.methods.ptf:PTF",
        "options over flat sources decide which of them PPO or TD3 imitates, less and less",
        ("ppo", "td3"),
        _ANY,
    ),
    "qmp": Entry(
        "paddlectl.methods.qmp:QMP",
        "a DQN or TD3; of its own action and its sources' the one of largest Q is executed",
        ("ppo", "td3"),
        _ANY,
    ),
    "componet": Entry(
        "paddlectl.methods.componet:COMPONET",
        "a new policy over PPO attends to the outputs of frozen ones and adds its own",
        ("ppo",),
        frozenset({"discrete"}),
    ),
}

MADE_AS = {"random": "hdm"}
"""What stands as method with policies of no method -> the one that makes such policies."""

PLUGINS = Plugins("method", METHODS, lambda name: re.fullmatch(METHOD, name) and name not in MADE_AS)


def names() -> tuple[str, ...]:
    """The names of all methods, those of plug-ins last."""
    return (*METHODS, *PLUGINS.names())


def alone() -> tuple[str, ...]:
    """The names of those that reuse nothing."""
    return tuple(name for name, entry in usable().items() if not entry.teaches)


def known(name: str) -> bool:
    """Whether there is a method of that name."""
    return name in METHODS or name in PLUGINS


ALONE = tuple(name for name, entry in METHODS.items() if not entry.teaches)
"""Those built in that reuse nothing: a source can be trained by them."""


def entry_of(name: str, offered: Callable[[], Sequence[str]] = names) -> Entry:
    """What is known of the method of that name.

    Raises:
        UsageError: If there is none; with the nearest name of those that are offered.
        PaddlectlError: If it is a plug-in's that can't be used.
    """
    if name in METHODS:
        return METHODS[name]
    if name not in PLUGINS:
        near = nearest(name, offered())
        raise UsageError(f"unknown method {shown(name)}", f"{near}one of: {', '.join(offered())}")
    with PLUGINS.using(name) as found:
        entry: Entry = found
        require_kind(entry, Entry)
        require_kind(entry.teaches, tuple)
        if unknown := [teacher for teacher in entry.teaches if not known(teacher)]:
            raise ValueError(f"it reuses what {unknown[0]!r} learned, which is no method")
        if not entry.actions or not entry.actions <= _ANY:
            raise ValueError(f"actions can't be {entry.actions!r}")
        require_kind(entry.presets, Mapping)
        for presets in entry.presets.values():
            require_kind(presets, tuple)
    return entry


def usable() -> dict[str, Entry]:
    """All methods; without those of plug-ins that can't be used."""
    found = {}
    for name in names():
        with suppress(PaddlectlError):
            found[name] = entry_of(name)
    return found


def teacher_of(name: str, task: "Task") -> str | None:
    """The method whose policies that one reuses on a task; None if it reuses none.

    Raises:
        UsageError: If there is no such method, or it can't choose the task's actions.
    """
    require_actions(name, task)
    fitting = [teacher for teacher in entry_of(name).teaches if _actions(task) in entry_of(teacher).actions]
    return fitting[0] if fitting else None


def like(method: str) -> tuple[str, ...]:
    """The methods whose policies can be reused as those of this one: it, and those built in that say so.

    To ask those of plug-ins would import them all.
    """
    return (method, *(other for other, entry in METHODS.items() if entry.like == method))


def teachers_of(name: str, task: "Task") -> tuple[str, ...]:
    """All methods whose policies that one reuses on a task: its `teacher_of`, and those that are like it.

    Raises:
        UsageError: As `teacher_of`.
    """
    first = teacher_of(name, task)
    return like(first) if first else ()


def require_actions(name: str, task: "Task", offered: Callable[[], Sequence[str]] = names) -> None:
    """Refuses a task whose actions the method can't choose.

    Raises:
        UsageError: If it can't, or if there is no such method; with those of the offered that can.
    """
    known, kind = entry_of(name, offered).actions, _actions(task)
    if kind not in known:
        others = [other for other, entry in usable().items() if other in offered() and kind in entry.actions]
        raise UsageError(
            f"{name} chooses {', '.join(known)} actions; those of {task.name} are {kind}",
            f"take another method: {', '.join(others)}",
        )


def _actions(task: "Task") -> str:
    return "continuous" if task.make(1, 0).actions.continuous else "discrete"
