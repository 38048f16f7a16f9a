"""QMP (Zhang et al., ICLR 2025): in each state the candidate of largest Q acts; learning is unchanged.

In each state s:

1. The target proposes an action a_0 as it explores, each source i an action a_i ~ π_i(s).
2. Of all of them the one of largest Q(s, a_i) is executed, by the target's own Q; of equals the first, so the
   target before its sources.
3. The target learns from what was executed, as ever: a DQN, or TD3 where actions are continuous.

The paper's target is stochastic. A DQN's greedy action has the largest Q of all, so a source could never act
where the target is greedy: what a DQN proposes is its ε-greedy action, and a source acts where the target
explores and Q takes the source's action for the better one. So ε is the largest share that sources can have,
and it falls until the budget is used up: the slower it falls, the more is learned
(`benchmarks/tuning/qmp.yaml`). TD3 proposes its action with the noise of exploration, a `td3` source its own
without.
"""

from collections.abc import Mapping
from typing import Any, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.agents.flat import FlatPolicy, FlatSettings, ReusingAgent
from paddlectl.agents.settings import changed
from paddlectl.learners.dqn import StepDQNSettings
from paddlectl.methods import flat
from paddlectl.methods.base import Method, Setup
from paddlectl.tasks.base import Environment, Floats, Ints, Task

USUAL: Mapping[str, FlatSettings] = {
    "discrete": FlatSettings(rollout_steps=16, learner=StepDQNSettings(exploration_share=1.0)),
    "continuous": changed(flat.USUAL["td3"], {"learner": {"capacity": 100_000}}),
}


class Critic(Protocol):
    """Knows what actions are worth."""

    def values_of(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Q. [n, D], [n, ...] -> [n]"""


def switch(values: Floats) -> Ints:
    """The Q-switch: the candidate of largest Q, of equals the first. [n, K] -> [n]"""
    chosen: Ints = values.argmax(-1)
    return chosen


class QMPAgent(ReusingAgent):
    """A learner whose experience is collected by the mixture of itself and its sources."""

    def act(self, environment: Environment) -> NDArray[Any]:
        """Of all that is proposed, what the Q-switch chooses. [B, ...]"""
        own = super().act(environment)
        buffer, t = self._buffer, self._t
        states = buffer.observations[t]
        proposed = np.stack(
            [own, *(source.teacher_actor().act(states, self._rng)[0] for source in self._sources)]
        )
        values = self._values(states, proposed)
        chosen = switch(values)
        self._recorder.add(self._valuations[t], chosen, values, {"Q": values})
        buffer.actions[t] = proposed[chosen, np.arange(len(chosen))]
        acted: NDArray[Any] = buffer.actions[t]
        return acted

    def _values(self, states: Floats, proposed: NDArray[Any]) -> Floats:
        """The target's Q of what each candidate proposes. [B, D], [K, B, ...] -> [B, K]"""
        critic, seen = cast(Critic, self._policy.learner), torch.from_numpy(states)
        return np.stack([critic.values_of(seen, torch.from_numpy(each)).numpy() for each in proposed], -1)


def make(setup: Setup) -> QMPAgent:
    """A learner that has learned nothing, and its sources; without any, the learner alone."""
    policy = FlatPolicy(setup.task, setup.seed, setup.settings)
    rng = np.random.default_rng(np.random.SeedSequence(setup.seed).spawn(2)[1])
    sources = {source.id: cast(FlatPolicy, source.policy) for source in setup.sources}
    return QMPAgent(policy, rng, sources, setup.frames)


def _usual(task: Task) -> FlatSettings:
    return USUAL["continuous" if task.make(1, 0).actions.continuous else "discrete"]


QMP = Method.of_usual("qmp", _usual, make, FlatPolicy)
