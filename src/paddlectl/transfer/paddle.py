"""PADDLE (Algorithm 2): the guides collect, the target learns."""

from collections.abc import Sequence

import numpy as np

from paddlectl.hybrid import training
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.hybrid.training import Learning
from paddlectl.transfer.candidates import Source
from paddlectl.transfer.guides import GuideChooser


def learn(
    target: HybridPolicy, sources: Sequence[Source], chooser: GuideChooser, seed: int, frames: int
) -> Learning:
    """Algorithm 2 over lanes, within `frames`.

    At each decision the scene is looked up in Ψ and the candidate of largest Λ leads (lines 5-14,
    `GuideChooser.choose`); its return is taken down (lines 16-19, `GuideChooser.decided`); after each
    block of steps the target learns from all of it (line 22). The sources stay as they are.
    """
    layouts = np.random.SeedSequence(seed).spawn(1)[0]
    actors = [target.low_level, *(source.low_level.guide() for source in sources)]
    return training.learn(target, chooser, actors, layouts, frames, [chooser])
