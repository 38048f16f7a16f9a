"""How well a policy plays: a function of the policy and a seed, and of nothing else."""

from dataclasses import dataclass

import numpy as np

from paddlectl.agents.base import Policy
from paddlectl.agents.interaction import Interaction
from paddlectl.logic.clauses import Program
from paddlectl.tasks.base import Split, Task

MOST_ENVS = 1000
"""Most episodes that an evaluation plays side by side. Chance is drawn for all of them together, so another
number would give more episodes than this other figures."""


@dataclass(frozen=True)
class Evaluation:
    """A policy on unseen layouts.

    Attributes:
        episodes: How many were played.
        success_rate: Share solved.
        mean_score: Mean final reward, 0 on failure.
        mean_length: Mean steps, failures at the horizon.
        program: The clauses executed in the scenes visited, with their probabilities; None without clauses.
        crispness: Smallest best-clause probability over the scenes on the policy's path; None likewise.
    """

    episodes: int
    success_rate: float
    mean_score: float
    mean_length: float
    program: Program | None
    crispness: float | None


def evaluate(policy: Policy, task: Task, episodes: int, seed: int, split: Split = "evaluation") -> Evaluation:
    """Plays the first `episodes` layouts of `seed` and of that split, each once; nothing is learned.

    An environment whose episode ends takes the next layout, so that memory is that of `MOST_ENVS` episodes at
    most. All chance comes from `seed`: whoever evaluates the same policy gets the same figures.
    """
    environment = task.make(min(episodes, MOST_ENVS), seed, policy.action_repeat, split)
    player = policy.player(task, environment.num_envs, np.random.SeedSequence(seed))
    interaction = Interaction(environment, player)
    passed = np.zeros(policy.scene_count, np.intp)
    ended = solved = length = 0
    score = 0.0
    while ended < episodes:
        played = [episode for episode in interaction.run(1) if episode.order < episodes]
        ended += len(played)
        solved += sum(episode.score > 0 for episode in played)
        length += sum(episode.length for episode in played)
        score += sum(episode.score for episode in played)
        for episode in played:
            passed[list(episode.scenes)] += 1
    program, crispness = policy.played_program(passed, episodes)
    return Evaluation(episodes, solved / episodes, score / episodes, length / episodes, program, crispness)
