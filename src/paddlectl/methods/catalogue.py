"""The methods by name, and what can be known of them without loading torch."""

from collections.abc import Mapping
from typing import NamedTuple

from paddlectl.errors import UsageError
from paddlectl.registry.names import nearest, shown


class Entry(NamedTuple):
    """A way to learn.

    Attributes:
        where: Its `methods.base.Method`, as module:attribute.
        summary: One line for a reader.
        teaches: The method whose policies it reuses; None if it reuses none.
        actions: Which actions it can choose, of `discrete` and `continuous`.
    """

    where: str
    summary: str
    teaches: str | None
    actions: frozenset[str]


_ANY = frozenset({"discrete", "continuous"})

METHODS: Mapping[str, Entry] = {
    "paddle": Entry(
        "paddlectl.methods.paddle:PADDLE",
        "logic and performance similarity pick a source that acts; the hybrid model learns",
        "hdm",
        _ANY,
    ),
    "hdm": Entry(
        "paddlectl.methods.hdm:HDM",
        "the hybrid model from scratch: a logic program picks subgoals, PPO or TD3 reaches them",
        None,
        _ANY,
    ),
    "hdqn": Entry(
        "paddlectl.methods.hdqn:HDQN",
        "a DQN picks subgoals, the hybrid model's low level reaches them",
        None,
        _ANY,
    ),
    "finetune": Entry(
        "paddlectl.methods.finetune:FINETUNE",
        "the hybrid model goes on from one source: its clause weights, where they match, and its low level",
        "hdm",
        _ANY,
    ),
    "ppo": Entry(
        "paddlectl.methods.flat:FLAT_PPO",
        "proximal policy optimisation on the whole state, without subgoals",
        None,
        frozenset({"discrete"}),
    ),
    "td3": Entry(
        "paddlectl.methods.flat:FLAT_TD3",
        "twin delayed DDPG on the whole state, without subgoals",
        None,
        frozenset({"continuous"}),
    ),
}


def entry_of(name: str) -> Entry:
    """What is known of the method of that name.

    Raises:
        UsageError: If there is none; with the nearest name.
    """
    if name not in METHODS:
        near = nearest(name, tuple(METHODS))
        raise UsageError(f"unknown method {shown(name)}", f"{near}one of: {', '.join(METHODS)}")
    return METHODS[name]
