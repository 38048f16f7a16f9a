"""What no source can teach: the target explores the subgoals that only it knows."""

import numpy as np

from paddlectl.tasks.base import Bools, Ints
from paddlectl.transfer.guidance import GuidanceSettings


class NovelSubgoalExploration:
    """Picks a novel subgoal for the target to take, whoever would lead.

    A source leads where it is worth something, and so the target would hardly meet what might be worth more:
    to carry a ball to its tile where every source just puts it down. At most once an episode it tries the
    novel subgoal that it has tried least in the scene; one that it hardly ever reaches there is given up.

    Args:
        novel: Subgoals that no source's program has. [domain's H]
        scenes: S, how many.
        num_envs: B, how many.
        rules: Rate, trials and least share.
        rng: Of the draws.
    """

    def __init__(
        self, novel: Bools, scenes: int, num_envs: int, rules: GuidanceSettings, rng: np.random.Generator
    ) -> None:
        self._novel = novel
        self._rules = rules
        self._rng = rng
        self._tried = np.zeros((scenes, len(novel)), np.intp)
        self._hits = np.zeros((scenes, len(novel)), np.intp)
        self._done = np.zeros(num_envs, np.bool_)

    def subgoals(self, lanes: Ints, scenes: Ints) -> Ints:
        """The subgoal to explore in each lane, -1 for none. [n]"""
        young = self._tried < self._rules.trials
        promising = self._hits >= self._rules.novel_subgoal_success * self._tried
        worth: Bools = self._novel & (young | promising)
        due = self._rng.random(len(lanes)) < self._rules.novel_subgoal_rate
        due &= worth[scenes].any(-1) & ~self._done[lanes]
        self._done[lanes] |= due
        tries = np.where(worth, self._tried, np.inf)[scenes] + self._rng.random(
            (len(lanes), len(self._novel))
        )
        return np.where(due, tries.argmin(-1), -1)

    def record(self, scene: int, subgoal: int, reached: bool) -> None:
        """Counts a decision of the target."""
        self._tried[scene, subgoal] += 1
        self._hits[scene, subgoal] += reached

    def ended(self, lane: int) -> None:
        """The lane's next episode may explore again."""
        self._done[lane] = False
