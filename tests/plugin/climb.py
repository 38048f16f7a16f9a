"""Hill climbing on a linear policy: a method that has nothing in common with those that are built in."""

from dataclasses import asdict, dataclass

import numpy as np
import torch

from paddlectl.agents.base import Agent, Player, Policy
from paddlectl.methods.base import Method
from paddlectl.methods.catalogue import Entry


@dataclass(frozen=True)
class Settings:
    frames: int = 20_000
    num_envs: int = 8
    rollout_steps: int = 16
    action_repeat: int = 1
    noise: float = 0.5


class Linear(Policy):
    def __init__(self, task, seed, settings):
        environment = task.make(1, 0)
        self.task, self.settings, self.action_repeat = task, settings, settings.action_repeat
        self.weights = np.zeros((environment.flat_size, environment.actions.size), np.float32)

    def player(self, task, environments, seed):
        return LinearPlayer(self.weights, np.random.default_rng(seed))

    def settings_document(self):
        return asdict(self.settings)

    def state(self):
        return {"weights": torch.from_numpy(self.weights)}

    def load(self, state):
        self.weights = state["weights"].numpy()


class LinearPlayer(Player):
    def __init__(self, weights, rng):
        self.weights, self.rng = weights, rng

    def act(self, environment):
        logits = environment.flat_state() @ self.weights
        return (logits + self.rng.gumbel(size=logits.shape)).argmax(1)


class Attempt:
    """What is tried out, and what it has earned."""

    def __init__(self, weights):
        self.weights, self.earned = weights, 0.0


class ClimbingAgent(Agent):
    def __init__(self, policy, seed):
        self.rollout_steps = policy.settings.rollout_steps
        self._policy, self._rng, self._best = policy, np.random.default_rng(seed), -np.inf
        self._attempt = Attempt(policy.weights)

    def act(self, environment):
        return LinearPlayer(self._attempt.weights, self._rng).act(environment)

    def observe(self, environment, step):
        self._attempt.earned += float(step.reward.sum())

    def update(self, environment, progress):
        if self._attempt.earned >= self._best:
            self._best, self._policy.weights = self._attempt.earned, self._attempt.weights
        weights, noise = self._policy.weights, self._policy.settings.noise
        self._attempt = Attempt(weights + noise * self._rng.standard_normal(weights.shape, np.float32))
        return {"best": self._best}

    def policy(self):
        return self._policy


def make(setup):
    return ClimbingAgent(Linear(setup.task, setup.seed, setup.settings), setup.seed)


METHOD = Method.of_settings("climb", Settings(), make, Linear)
ENTRY = Entry("climb:METHOD", "hill climbing on a linear policy", (), frozenset({"discrete"}))
