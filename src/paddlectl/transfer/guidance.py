"""The dual similarity Λ (Eq. 3), and the choice of the guiding policy (Algorithm 2, lines 7-12).

`guidance: paper` is ψ + Φ and its largest value; where the text leaves a choice, `PaperSettings` names it.
`guidance: default` differs by the rules named in `GuidanceSettings`; each can be switched off by itself.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from paddlectl.ranges import AtLeastOne, Finite, NotNegative, Share

Weights = NDArray[np.float64]


Rule = Literal["largest", "tie", "penalty", "floor", "alone"]
"""Why a candidate leads a decision.

- largest: its Λ is the largest.
- tie: several have the largest Λ; a source goes before the target, and of sources a random one.
- penalty: larger ones were lowered, for what they did before in this episode.
- floor: the target; no source's Λ is above the least that the target's may be.
- alone: the target; it leads this episode, whatever its Λ is.
"""

RULES: tuple[Rule, ...] = get_args(Rule)


@dataclass(frozen=True)
class PaperSettings:
    """How Eqs. 2 and 3 are read in `guidance: paper`, where the text leaves it open or can't be meant.

    Attributes:
        initial_performance: Φ before the first return, "a constant". With 1, as long as the first failures
            haven't reported, every guide that wasn't asked yet goes before those that were: 64 environments
            spend the whole jump-start on it.
        normalise: "Normalised to [0, 1]" as `clip`, or `none`. To clip hides negative returns, so that a
            source that always fails ties with a target that was never asked, and goes before it for ever.
            (Eq. 2's bonus still lifts the Φ of a soft one: by more than G takes off where H is above 1 nat.)
        failure_cost: Taken off G for a decision that misses its subgoal. Rewards here are never negative;
            without a cost a useless source is worth as much as an unknown target. The authors' code has
            such costs.
        values: What G is kept for: each `per_guide` as printed, or each `per_subgoal` as in the authors'
            code, where a guide is worth Σ p(subgoal)·V(subgoal) by its own program. So the target profits
            from what its guides found out, and can pass them.
        source_softness: Share of the uniform distribution that is mixed into the sources' programs. The
            paper's sources aren't crisp; a crisp one can't be passed by a target that still learns.
        imitation_margin: The target imitates a subgoal that a guide reached unless it knows one that is
            better by more than this. At a fork of two good ways it would else prefer the one that its
            guides don't go, whose value is measured too seldom for it ever to lead there.
        num_envs: Environments side by side; so many choose before the first return is known. An update is of
            as many steps as usual.
    """

    initial_performance: float = 0.0
    normalise: Literal["clip", "none"] = "none"
    failure_cost: float = 0.01
    values: Literal["per_guide", "per_subgoal"] = "per_subgoal"
    source_softness: float = 0.05
    imitation_margin: float = 0.05
    num_envs: int = 8


@dataclass(frozen=True)
class GuidanceSettings:
    """How Λ is made and read in `guidance: default`.

    Attributes:
        similarity_decay: ψ is a first guess: after n decisions of a candidate in a scene Λ = f·ψ + (1 - f)·Φ
            with f = similarity_decay^n. Under the paper's sum a well matched source that fails for ever keeps
            its ψ.
        target_floor: Λ of the target is its Φ, but at least this. Where no source gains anything more than
            this, the target explores, at once, and only there.
        target_margin: Added to the target's Λ, but not to what is planned by: it takes a scene over when it
            comes this near to the best source, for it can still improve.
        repeat_penalty: Taken off a candidate's Λ for each earlier decision of its guide for the same subgoal
            in this scene of this episode: the subgoal was missed, or the episode came back. A frozen
            source that is stuck stays stuck, and two that undo each other's work would do so for ever.
        episodes: Who leads an episode: where it is `guided`, the candidate of largest Λ in each scene; the
            target `alone`; or by a `bandit` one of both, whichever solves more (`AloneOrGuided`). Guides that
            know all subgoals of a task solve it at once; others bring it to where they are stuck.
        bandit_prior: Episodes' worth of belief in what a bandit expects before it has seen any.
        least_alone: Share of the episodes that the target leads alone however well it is guided: so it is
            measured, and can take its scenes over.
        source_memory: Latest decisions that a source's return is averaged over.
        target_memory: The same for the target, which changes.
        program_inheritance: The target's program starts, in each scene, as that of the source scenes which
            match best, with this share times ψ; the rest is spread evenly over its subgoals. 0 starts anew.
        inheritance: The target's low level starts as a copy of its most similar source's, its preferences
            weakened to this share so that it explores again (TD3 has none to weaken); 0 starts anew. So a
            subgoal that no source knows isn't learned from nothing: whoever finds a key soon finds a ball.
    """

    similarity_decay: Share = 0.7
    target_floor: Finite = 0.05
    target_margin: Finite = 0.02
    repeat_penalty: NotNegative = 0.3
    episodes: Literal["bandit", "guided", "alone"] = "bandit"
    bandit_prior: NotNegative = 10.0
    least_alone: Share = 0.05
    source_memory: AtLeastOne = 300.0
    target_memory: AtLeastOne = 50.0
    program_inheritance: Share = 0.7
    inheritance: Share = 0.7


def guidance_weight(similarity: Weights, performance: Weights) -> Weights:
    """Λ = ψ + Φ (Eq. 3). [S, C]"""
    return similarity + performance


def faded_weight(similarity: Weights, performance: Weights, count: Weights, decay: float) -> Weights:
    """Λ = f·ψ + (1 - f)·Φ with f = decay^count: ψ is the first guess, Φ what came of it. [S, C]"""
    first_guess = decay**count
    return first_guess * similarity + (1.0 - first_guess) * performance


def select_guide(weights: Weights, rng: np.random.Generator) -> NDArray[np.intp]:
    """The candidate of largest Λ in each row [n, C], the target in column 0. [n]

    Of a source and the target that tie, the source; of tied sources or scenes of one source, a random one.
    """
    sources = weights[:, 1:]
    best = sources.max(-1, keepdims=True, initial=-np.inf)
    tied = (sources == best) * rng.random(sources.shape)
    of_sources = tied.argmax(-1) + 1 if sources.shape[1] else np.zeros(len(weights), np.intp)
    return np.where(weights[:, 0] > best[:, 0], 0, of_sources)
