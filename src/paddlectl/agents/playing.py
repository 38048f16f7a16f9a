"""A policy in a Gymnasium environment, which is stepped by somebody else."""

from typing import Any

import numpy as np

from paddlectl.agents.base import Player, Policy
from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import Step, Task
from paddlectl.tasks.environment import TaskEnv

_FALSE = np.zeros(1, np.bool_)


class Playing:
    """Chooses the actions of one environment, which it only looks at.

    Whatever the policy keeps from step to step, as a decision that goes on, lasts as long as the episode and
    as every step is asked for; else it begins anew.

    Args:
        policy: Who chooses.
        task: The environment's.
        env: It.
        seed: Of all chance; each episode has a part of it.
    """

    def __init__(self, policy: Policy, task: Task, env: TaskEnv, seed: int) -> None:
        self._policy, self._task, self._seed = policy, task, seed
        self._engine = task.make(1, 0, policy.action_repeat, env.split)
        self._episodes = 0
        self._episode = 0  # by the environment's count
        self._player: Player = policy.player(task, 1, np.random.SeedSequence(seed))
        self._action: Any = None
        self._t = -1
        self._earned = 0.0

    @property
    def subgoal(self) -> Atom | None:
        """What the latest action goes for; None of a policy without subgoals."""
        present = self._player.subgoals()
        return None if present is None else self._task.domain_subgoals[int(present[0])]

    def act(self, env: TaskEnv) -> Any:
        """The action for the environment's present state, as its `step` takes it."""
        engine, before = self._engine, self._t
        env.mirror_in(engine)
        self._t = int(engine.t[0])
        begins = env.episode != self._episode or self._t - before not in (0, 1)
        if begins:
            self._episode = env.episode
            self._player = self._policy.player(
                self._task, 1, np.random.SeedSequence((self._seed, self._episodes))
            )
            self._episodes += 1
        elif self._t == before or self._t % engine.action_repeat:
            return self._action
        else:
            reward = np.array([env.earned - self._earned], np.float32)
            self._player.observe(engine, Step(reward, np.zeros(1, np.float32), _FALSE, _FALSE))
        self._earned = env.earned
        chosen = self._player.act(engine)[0]
        self._action = chosen.copy() if engine.actions.continuous else int(chosen)
        return self._action
