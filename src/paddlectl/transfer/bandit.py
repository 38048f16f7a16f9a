"""Who leads an episode: the guides, or the target alone."""

import numpy as np


class AloneOrGuided:
    """Who leads an episode, by Thompson sampling (Thompson, 1933) of how many each way solves.

    Args:
        known: Share κ of the target's subgoals that some source knows.
        prior: Episodes' worth of belief that κ³ of the guided ones are solved, and half of those alone. It
            stays, whatever is seen.
        memory: A way weighs about so many of its latest episodes: guided, alone. [2]
        least: Share of the episodes that the target leads alone in any case, so that it is measured.
    """

    def __init__(self, known: float, prior: float, memory: tuple[float, float], least: float = 0.0) -> None:
        solved = np.array([known**3, 0.5])
        self._prior = prior * np.stack([solved, 1.0 - solved])  # solved and not, by way
        self._seen = np.zeros((2, 2))
        self._keep = 1.0 - 1.0 / np.array(memory)
        self._least = least

    def choose(self, rng: np.random.Generator) -> bool:
        """Whether the target leads the next episode alone."""
        guided, alone = np.asarray(rng.beta(*np.maximum(self._prior + self._seen, 1e-3)))
        return bool(alone > guided) or rng.random() < self._least

    def record(self, alone: bool, solved: bool) -> None:
        """Counts an episode."""
        way = int(alone)
        self._seen[:, way] *= self._keep[way]
        self._seen[int(not solved), way] += 1.0
