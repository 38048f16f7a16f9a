"""Corridors with a coin at one end and a way out at the other: an environment of its own, in NumPy alone."""

from functools import partial

import numpy as np

from paddlectl.logic.atoms import Predicate
from paddlectl.tasks.base import Actions, Environment, Step, Task, Vocabulary
from paddlectl.tasks.split import belongs

HORIZON = 40
LONGEST = 12
HAS_COIN, COIN_LEFT = Predicate("has_coin", 1)("agent"), Predicate("is_left", 1)("coin")
SUBGOALS = (Predicate("gt_coin", 0)(), Predicate("gt_exit", 0)())


class Corridor(Environment):
    """B corridors of 5 to 12 cells. Action 0 goes left, action 1 goes right."""

    observation_size = 4
    flat_size = 6
    actions = Actions(2)

    def __init__(self, coin_needed, num_envs, seed, action_repeat=1, split="training"):
        self.num_envs, self.action_repeat = num_envs, action_repeat
        self._coin_needed, self._split, self._rng = coin_needed, split, np.random.default_rng(seed)
        self.place, self.length, self.t = np.zeros((3, num_envs), np.intp)
        self.coin_left, self.coin, self.finished = np.zeros((3, num_envs), np.bool_)
        self.reset()

    def reset(self, lanes=None):
        waiting = np.arange(self.num_envs) if lanes is None else np.flatnonzero(lanes)
        self.coin[waiting] = self.finished[waiting] = False
        self.t[waiting] = 0
        while len(waiting):
            length = self._rng.integers(5, LONGEST + 1, len(waiting))
            place, left = self._rng.integers(1, length - 1), self._rng.integers(2, size=len(waiting))
            fits = belongs(np.column_stack([length, place, left]), self._split)
            drawn = waiting[fits]
            self.length[drawn], self.place[drawn], self.coin_left[drawn] = (
                length[fits],
                place[fits],
                left[fits],
            )
            waiting = waiting[~fits]

    def step(self, actions):
        actions = self.actions.checked(actions, (self.num_envs,))
        step = self._step(actions)
        for _ in range(self.action_repeat - 1):
            step = step.then(self._step(actions))
        return step

    def _step(self, actions):
        running = ~self.finished
        self.place += np.where(running, 2 * actions - 1, 0)
        np.clip(self.place, 0, self.length - 1, out=self.place)
        self.t += running
        self.coin |= self._at(np.zeros(self.num_envs, np.intp))
        solved = (
            running & self._at(np.ones(self.num_envs, np.intp)) & (self.coin | ~np.bool_(self._coin_needed))
        )
        cut = running & (self.t >= HORIZON) & ~solved
        self.finished |= solved | cut
        score = (solved * (1 - 0.9 * self.t / HORIZON)).astype(np.float32)
        return Step(score, score, solved, cut)

    def _goal(self, subgoals):
        """The cell of each lane's subgoal: the coin's end, or the other."""
        return np.where((subgoals == 0) == self.coin_left, 0, self.length - 1)

    def _at(self, subgoals):
        return self.place == self._goal(subgoals)

    def valuation(self):
        return np.column_stack([self.coin, self.coin_left])

    def observe(self, subgoals):
        offset = (self._goal(subgoals) - self.place) / LONGEST
        return np.column_stack([offset, self.coin, subgoals == 0, subgoals == 1]).astype(np.float32)

    def flat_state(self):
        far = self.length - 1 - self.place
        columns = [self.place / LONGEST, far / LONGEST, self.coin, self.coin_left, ~self.coin_left]
        return np.column_stack([*columns, self.t / HORIZON]).astype(np.float32)

    def in_world(self, subgoals, actions):
        return actions

    def reached(self, subgoals):
        return np.where(subgoals == 0, self.coin, self._at(subgoals))

    def available(self, subgoals):
        return ~self.reached(subgoals)


def make_task(name):
    coin_needed = name == "CoinCorridor"
    return Task(
        name=name,
        domain="corridor",
        summary=f"{'Fetch the coin, then g' if coin_needed else 'G'}o to the way out.",
        horizon=HORIZON,
        vocabulary=Vocabulary((HAS_COIN, COIN_LEFT)),
        subgoals=SUBGOALS,
        domain_subgoals=SUBGOALS,
        make=partial(Corridor, coin_needed),
    )
