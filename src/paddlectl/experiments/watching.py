"""An episode of a policy, picture by picture."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl.agents.base import Policy
from paddlectl.agents.playing import Playing
from paddlectl.errors import UsageError
from paddlectl.tasks.base import Task
from paddlectl.tasks.environment import can_be_drawn, drawn
from paddlectl.tasks.suite import AnyTask, load


class Seen(NamedTuple):
    """A moment of an episode.

    Attributes:
        picture: [height, width, 3] uint8
        t: Steps so far.
        subgoal: What the policy then goes for; empty at the end, and of one without subgoals.
        score: The final reward; 0 before the end, and of an episode that isn't solved.
        ended: Whether it is the last.
    """

    picture: NDArray[np.uint8]
    t: int
    subgoal: str
    score: float
    ended: bool


def watched(policy: Policy, asked: AnyTask, seed: int) -> Iterator[Seen]:
    """Plays one unseen layout; the picture before each action, and that of the end.

    Args:
        policy: Who plays; it explores nothing.
        asked: The task that is played.
        seed: Of the layout, and of what the policy leaves to chance.

    Raises:
        UsageError: If the task's environment can't be drawn.
    """
    if can_be_drawn(asked):
        yield from _mirrored(policy, asked, seed)
    else:
        yield from _played(policy, load(asked), seed)


def _mirrored(policy: Policy, asked: AnyTask, seed: int) -> Iterator[Seen]:
    """In the task's own Gymnasium environment."""
    env: Any = drawn(asked)
    try:
        env.reset(seed=seed)
        playing = Playing(policy, load(asked), env, seed)
        ended, t = False, 0
        while not ended:
            action = playing.act(env)
            yield Seen(env.render(), t, str(playing.subgoal or ""), 0.0, False)
            _, _, terminated, truncated, told = env.step(action)
            ended, t = terminated or truncated, t + 1
        yield Seen(env.render(), t, "", float(told["score"]), True)
    finally:
        env.close()


def _played(policy: Policy, task: Task, seed: int) -> Iterator[Seen]:
    """In the one lane of a batch that can draw itself."""
    engine: Any = task.make(1, seed, policy.action_repeat, "evaluation")
    if not hasattr(engine, "picture"):
        raise UsageError(f"{task.name} can't be drawn", "its environment has no picture")
    player = policy.player(task, 1, np.random.SeedSequence(seed))
    ended = False
    while not ended:
        action = player.act(engine)
        wanted = player.subgoals()
        subgoal = "" if wanted is None else str(task.domain_subgoals[int(wanted[0])])
        yield Seen(engine.picture(0), int(engine.t[0]), subgoal, 0.0, False)
        step = engine.step(action)
        player.observe(engine, step)
        ended = bool(step.terminated[0] or step.truncated[0])
    yield Seen(engine.picture(0), int(engine.t[0]), "", float(step.score[0]), True)
