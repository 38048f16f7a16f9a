"""Who was followed in which scene, and by which terms: what a method that reuses leaves for `explain`."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from paddlectl.agents.base import ReuseRow, Tables
from paddlectl.logic.atoms import Literal
from paddlectl.tasks.base import Bools, Floats, Ints, Task

PERIODS = 10
"""Equal parts of a run, for each of which it is told who was followed."""


class ReuseRecorder:
    """Counts within a period of the run, by scene.

    Args:
        task: That is learned.
        candidates: Who may be followed, K: ids of policies, and `target` for the learner itself.
        frames: The budget.
    """

    def __init__(self, task: Task, candidates: Sequence[str], frames: int) -> None:
        self._atoms = task.vocabulary.atoms
        self._powers = 1 << np.arange(len(self._atoms), dtype=np.int64)
        self._candidates = tuple(candidates)
        self._period = max(1, frames // PERIODS)
        self._told = 0
        self._sums: dict[int, dict[str, Floats]] = {}

    def add(self, valuation: Bools, followed: Ints, weights: Floats, terms: Mapping[str, Floats]) -> None:
        """Takes in one choice of each of n states.

        Args:
            valuation: E(s) of each state. [n, P]
            followed: Index of the candidate that was followed. [n]
            weights: By which it was. [n, K]
            terms: What the weights are made of, by name. [n, K] each
        """
        chosen = followed[:, None] == np.arange(len(self._candidates))
        columns = {"": weights, **terms}
        codes, of = np.unique(valuation @ self._powers, return_inverse=True)
        for place, code in enumerate(codes):
            here = of == place
            sums = self._sums.setdefault(int(code), {})
            sums["chosen"] = sums.get("chosen", 0) + chosen[here].sum(0)
            for name, values in columns.items():
                key = f"term {name}"
                sums[key] = sums.get(key, 0.0) + values[here].sum(0, dtype=np.float64)

    def rows(self, frames: int) -> Iterator[ReuseRow]:
        """The period so far: means of the terms and of the weight, and how often each was followed."""
        for code, sums in sorted(self._sums.items()):
            met = int(sums["chosen"].sum())
            means = {name[5:]: total / met for name, total in sums.items() if name.startswith("term ")}
            for number, candidate in enumerate(self._candidates):
                of_it = {name: float(mean[number]) for name, mean in means.items()}
                weight = of_it.pop("")
                chosen = int(sums["chosen"][number])
                yield ReuseRow(frames, self._scene(code), candidate, of_it, weight, chosen, None)

    def end_of_period(self, frames: int, *, at_once: bool = False) -> Tables:
        """The rows of the period if it is over, or `at_once`; then the next begins."""
        if not self._sums or not (at_once or frames - self._told >= self._period):
            return {}
        rows = [row._asdict() for row in self.rows(frames)]
        self._told = frames
        self._sums.clear()
        return {"reuse": rows}

    def _scene(self, code: int) -> tuple[str, ...]:
        """The literals that hold there, sorted as in a program."""
        literals = (Literal(atom, bool(code >> p & 1)) for p, atom in enumerate(self._atoms))
        return tuple(map(str, sorted(literals)))
