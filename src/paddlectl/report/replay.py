"""The moving picture of a bundle: one unseen episode of its policy."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from paddlectl.errors import PaddlectlError
from paddlectl.registry.bundles.bundles import LONGEST_REPLAY
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry
from paddlectl.report.frames import gif
from paddlectl.report.output import clean

SEED = 0
MOST, FEWEST = 60, 4
"""Pictures."""
PER_SECOND = 6


def replay_gif(registry: Registry, record: PolicyRecord) -> bytes:
    """An episode of a policy, with what it goes for, always the same; empty if there can't be one.

    Args:
        registry: Where it is.
        record: Which.
    """
    from paddlectl.experiments.policies import one_thread, revive, task_of
    from paddlectl.experiments.recordings import played_again, played_anew

    try:
        policy = revive(registry, record)
        with one_thread():
            told = played_anew(policy, policy.task, SEED)
        steps = [*range(0, told["length"], -(-told["length"] // MOST)), told["length"]]
        moments = played_again(task_of(record), told, {*steps})
        pictures = [moment.picture for moment in moments if moment.picture is not None]
    except PaddlectlError:
        return b""
    while len(steps) >= FEWEST:
        data = gif(pictures, [*_captions(told, steps)], PER_SECOND)
        if len(data) <= LONGEST_REPLAY:
            return data
        steps, pictures = [*steps[:-1:2], steps[-1]], [*pictures[:-1:2], pictures[-1]]
    return b""


def _captions(told: Mapping[str, Any], steps: Sequence[int]) -> Iterator[str]:
    """The step and what it goes for; at the end, what came of it."""
    goals = [
        clean(each["subgoal"])
        for each in told["subgoals"]
        for _ in range(each["actions"] * told["action_repeat"])
    ]
    for step in steps[:-1]:
        yield f"{step:>4}  {goals[step] if goals else ''}"
    solved = f"solved, score {told['score']:.2f}" if told["score"] > 0 else "not solved"
    yield f"{told['length']:>4}  {solved}"
