"""CompoNet (Malagón, Ceberio & Lozano, 2024) over PPO: a new policy is composed of frozen ones and its own.

1. Every source is frozen; together they give Φ, their probabilities for the state.
2. An output head attends to Φ: a tentative vector. An input head attends to Φ and to that vector: what the
   internal policy sees beside the state.
3. The logits are the tentative vector and what the internal policy adds (`learners.componet`).
4. PPO trains the heads and the internal policy; its critic is apart.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import torch

from paddlectl.agents.flat import FlatPolicy, FlatSettings, ReusingAgent
from paddlectl.agents.settings import changed, restored
from paddlectl.errors import UsageError
from paddlectl.learners.componet import CompoNet, Composition
from paddlectl.learners.networks import HIDDEN, mlp
from paddlectl.learners.ppo import PPO, PPOSettings
from paddlectl.methods import flat
from paddlectl.methods.base import Method, Setup, require_sources
from paddlectl.ranges import Hidden, Range
from paddlectl.tasks.base import Environment, Floats, Task

TOLD_EVERY = 8
"""Steps of a block between two whose attention is told: the record costs a forward pass."""


@dataclass(frozen=True)
class CompoNetSettings(PPOSettings):
    """PPO's numbers, and the module's.

    Attributes:
        modules: Frozen sources. A scenario has so many, and the policy is revived with so many.
        width: Of the attention's queries and keys.
        source_hidden: Units of each layer of the sources, which must be alike.
    """

    modules: Annotated[int, Range(0, 100)] = 0
    width: Annotated[int, Range(1, 10**4)] = 400
    source_hidden: Hidden = HIDDEN

    def learner(self, observation_size: int, actions: int, seed: int) -> PPO:
        """PPO of a module; what its sources know is yet to be put in."""
        return PPO(observation_size, actions, seed, self, partial(_module, self))


def _module(settings: CompoNetSettings, size: int, actions: int) -> CompoNet:
    sources = [mlp(size, actions, hidden=settings.source_hidden) for _ in range(settings.modules)]
    return CompoNet(sources, size, actions, settings.width, settings.hidden)


USUAL = replace(flat.USUAL["ppo"], learner=CompoNetSettings(**asdict(flat.PPO_ALONE)))


class CompoNetAgent(ReusingAgent):
    """PPO of a module that has its sources in it.

    The record: by its attention the output head follows a source; the weight is the share of the logits
    that comes from there, and the target's is the internal policy's.
    """

    def __init__(
        self, policy: FlatPolicy, rng: np.random.Generator, sources: Mapping[str, FlatPolicy], frames: int
    ) -> None:
        super().__init__(policy, rng, sources, frames)
        self._module = _network(policy)
        for module, source in zip(self._module.sources, sources.values(), strict=True):
            module.load_state_dict(_network(source).state_dict())

    def _learn(self, environment: Environment) -> Mapping[str, float]:
        """Tells what the block's actions were made of; then PPO's update."""
        self._tell()
        return super()._learn(environment)

    @torch.no_grad()
    def _tell(self) -> None:
        states = torch.from_numpy(self._buffer.observations[::TOLD_EVERY]).flatten(0, 1)
        composition = self._module.compose(states)
        attention = np.pad(composition.attention.numpy(), ((0, 0), (1, 0)))
        self._recorder.add(
            self._valuations[::TOLD_EVERY].reshape(len(states), -1),
            attention.argmax(-1),
            shares(composition),
            {"attention": attention},
        )


def shares(composition: Composition) -> Floats:
    """Shares of the logits that come from the internal policy and from each source; they sum to 1. [n, 1 + K]

    By norm, with the mean over the actions taken off: it changes no probability.
    """
    attention, *parts = composition
    tentative, internal = ((part - part.mean(-1, keepdim=True)).norm(dim=-1, keepdim=True) for part in parts)
    own = internal / (internal + tentative).clamp_min(1e-12)
    given: Floats = torch.cat([own, (1.0 - own) * attention], -1).numpy()
    return given


def _network(policy: FlatPolicy) -> Any:
    learner: Any = policy.learner
    return learner.actor


def make(setup: Setup) -> CompoNetAgent:
    """A module that has learned nothing, over the scenario's sources.

    Raises:
        UsageError: If there isn't a policy of each of them, or one has other layers than the settings say.
    """
    own = setup.settings.learner
    require_sources("componet", setup, own.modules)
    for source in setup.sources:
        policy: Any = source.policy
        hidden = policy.settings.learner.hidden
        if hidden != own.source_hidden:
            raise UsageError(
                f"{source.id} has layers of {list(hidden)} units, not {list(own.source_hidden)}",
                f"set learner.source_hidden={list(hidden)} if all sources are such",
            )
    policy = FlatPolicy(setup.task, setup.seed, setup.settings)
    rng = np.random.default_rng(np.random.SeedSequence(setup.seed).spawn(2)[1])
    sources: dict[str, Any] = {source.id: source.policy for source in setup.sources}
    return CompoNetAgent(policy, rng, sources, setup.frames)


def _settings(_: Task, scenario: Any, *changes: Mapping[str, Any]) -> FlatSettings:
    """The usual ones, for as many modules as the scenario has sources."""
    counted = {"learner": {"modules": scenario.source_count}} if scenario else {}
    settings = USUAL
    for change in (*changes, counted):
        settings = changed(settings, change)
    return settings


def _settings_from(_: Task, stored: Any, missing: FlatSettings | None = None) -> FlatSettings:
    settings: FlatSettings = restored(missing or USUAL, stored, "settings")
    return settings


COMPONET = Method(
    name="componet",
    settings_for=_settings,
    settings_from=_settings_from,
    make=make,
    policy=FlatPolicy,
)
