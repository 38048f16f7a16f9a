"""PADDLE (Algorithm 2) over lanes: the guides collect, the target learns."""

from collections.abc import Iterator, Sequence

import numpy as np

from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.rollout import Rollout
from paddlectl.hybrid.training import Round
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.transfer.guides import GuideChooser, Source


def learn(
    target: HybridPolicy, sources: Sequence[Source], chooser: GuideChooser, seed: int, frames: int
) -> Iterator[Round]:
    """Algorithm 2: collects with the guides and trains the target, until `frames` are used up."""
    settings = target.settings
    layouts = np.random.SeedSequence(seed).spawn(1)[0]
    environment = target.task.make(settings.lanes, int(layouts.generate_state(1)[0]))
    credit = target.credit()
    rollout = Rollout(
        environment,
        target.task.horizon,
        target.clauses,
        chooser,
        [target.low_level, *(source.actor for source in sources)],
        settings.decisions,
        [chooser, credit],
    )
    buffer = RolloutBuffer.empty(settings.block, settings.lanes, environment.observation_size)
    chooser.refresh()
    while rollout.frames < frames:
        episodes = rollout.collect(buffer)
        target.low_level.anneal(rollout.frames / frames)
        target.low_level.update(buffer)
        credit.update(episodes)
        chooser.refresh()
        yield Round(rollout.frames, episodes)
