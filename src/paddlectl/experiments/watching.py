"""An episode of a policy, picture by picture."""

from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from paddlectl.agents.base import Policy
from paddlectl.agents.playing import Playing
from paddlectl.tasks.environment import drawn
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
    task, env = load(asked), cast(Any, drawn(asked))
    try:
        env.reset(seed=seed)
        playing = Playing(policy, task, env, seed)
        ended, t = False, 0
        while not ended:
            action = playing.act(env)
            yield Seen(env.render(), t, str(playing.subgoal or ""), 0.0, False)
            _, reward, terminated, truncated, _ = env.step(action)
            ended, t = terminated or truncated, t + 1
        yield Seen(env.render(), t, "", float(reward) if terminated else 0.0, True)
    finally:
        env.close()
