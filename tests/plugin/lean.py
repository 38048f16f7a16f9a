"""PPO that is drawn, in each state, to the source whose critic expects more than its own."""

import numpy as np
import torch

from paddlectl.agents.flat import FlatPolicy, FlatSettings, ReusingAgent
from paddlectl.methods.base import Method
from paddlectl.methods.catalogue import Entry

WEIGHT = 0.1


class LeaningAgent(ReusingAgent):
    def _learn(self, environment):
        learner = self._policy.learner
        observations = torch.from_numpy(self._buffer.observations).flatten(0, 1)
        with torch.no_grad():
            values = torch.cat([each.critic(observations) for each in (learner, *self._sources)], 1)
            chosen = values.argmax(1)
            wanted = torch.stack([each.log_probs(observations) for each in (learner, *self._sources)])
            wanted = wanted[chosen, torch.arange(len(chosen))].exp()

        def guidance(places, log_probs):
            return -WEIGHT * (wanted[places] * log_probs).sum(1)[chosen[places] > 0].sum() / len(places)

        learner.update(self._buffer, guidance)
        valuations = self._valuations.reshape(len(observations), -1)
        self._recorder.add(valuations, chosen.numpy(), values.numpy(), {"value": values.numpy()})
        return {"followed": float((chosen > 0).float().mean())}


def make(setup):
    policy = FlatPolicy(setup.task, setup.seed, setup.settings)
    sources = {source.id: source.policy for source in setup.sources}
    return LeaningAgent(policy, np.random.default_rng(setup.seed), sources, setup.frames)


METHOD = Method.of_settings("lean", FlatSettings(), make, FlatPolicy)
ENTRY = Entry("lean:METHOD", "PPO, drawn to sources that expect more", ("ppo",), frozenset({"discrete"}))
