"""Who may lead where: the sources, and every scene of theirs that Ψ names."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from paddlectl.hybrid.policy import domain_subgoals, sharpened
from paddlectl.learners.base import Learner
from paddlectl.learners.buffers import TARGET
from paddlectl.logic.atoms import Atom
from paddlectl.logic.clauses import Body, Program
from paddlectl.tasks.base import Floats, Ints, Task
from paddlectl.transfer.performance import Table
from paddlectl.transfer.similarity import SceneMapping


@dataclass(frozen=True)
class Source:
    """A frozen policy that may guide.

    Attributes:
        policy: Its id.
        task: What it has learned.
        subgoals: The subgoals of that task.
        program: Its program.
        low_level: Loads what reaches them.
        digest: SHA-256 of its tensors.
    """

    policy: str
    task: str
    subgoals: tuple[Atom, ...]
    program: Program
    low_level: Callable[[], Learner]
    digest: str


def most_similar_first(sources: Sequence[Source], mapping: SceneMapping) -> list[Source]:
    """The sources by ψ over all scenes of the target; of the same ψ, in their order."""
    similarity: dict[str, float] = defaultdict(float)
    for row in mapping.rows.values():
        for match in row:
            similarity[match.policy] += match.similarity
    return sorted(sources, key=lambda source: -similarity[source.policy])


class Candidates(NamedTuple):
    """Every (guide, source scene) that Ψ names; candidate 0 is the target itself.

    Attributes:
        guides: TARGET or the source's number, 1, 2, … [C]
        subgoals: Distribution over the domain's subgoals; the target's row is empty. [C, domain's H]
        similarity: ψ, the target's own included; -inf where the scene is no best match. [S, C]
        entropy: Of the subgoal distribution before it is sharpened, in nats. [C]
    """

    guides: Ints
    subgoals: Floats
    similarity: Table
    entropy: Table


def inherited_program(task: Task, candidates: Candidates, share: float) -> Floats:
    """What the sources' programs say of a task: p = share·ψ·q + (1 - share·ψ) / H in each scene.

    q is the mean over the source scenes of largest ψ, of their probabilities of the task's subgoals.

    Args:
        task: The target.
        candidates: Who may lead on it.
        share: Of q where ψ is 1.

    Returns:
        [S, H]
    """
    similarity, subgoals = candidates.similarity[:, 1:], candidates.subgoals[1:, domain_subgoals(task)]
    best = similarity == similarity.max(-1, keepdims=True, initial=0.0)
    told = best.astype(np.float64) @ subgoals
    known = told.sum(-1, keepdims=True)
    certainty = share * np.where(best, similarity, 0.0).max(-1, keepdims=True, initial=0.0) * (known > 0)
    program: Floats = certainty * told / np.maximum(known, 1e-9) + (1.0 - certainty) / len(task.subgoals)
    return program


def candidates_of(
    task: Task,
    bodies: Sequence[Body],
    sources: Sequence[Source],
    mapping: SceneMapping,
    sharpness: float,
    softness: float = 0.0,
) -> Candidates:
    """Numbers the matches of Ψ, in the order of the sources.

    Args:
        task: The target.
        bodies: Its scenes.
        sources: Who may guide.
        mapping: Ψ.
        sharpness: Power of the sources' subgoal probabilities when they lead.
        softness: Share of the uniform distribution over a source's subgoals that is mixed into them.
    """
    none = np.zeros(len(task.domain_subgoals))
    guides, rows, uniform, columns = [TARGET], [none], [none], []
    columns.append([mapping.self_similarity(body) for body in bodies])
    for number, source in enumerate(sources, start=1):
        matches = [{m.policy: m for m in mapping.rows[body]}.get(source.policy) for body in bodies]
        for scene in dict.fromkeys(scene.body for match in matches if match for scene in match.scenes):
            policy = source.program.policy(scene)
            guides.append(number)
            uniform.append(
                np.array([subgoal in source.subgoals for subgoal in task.domain_subgoals])
                / len(source.subgoals)
            )
            rows.append(np.array([policy.get(subgoal, 0.0) for subgoal in task.domain_subgoals]))
            columns.append(
                [m.similarity if m and scene in [s.body for s in m.scenes] else -np.inf for m in matches]
            )
    subgoals = np.array(rows)
    subgoals[1:] /= subgoals[1:].sum(-1, keepdims=True)
    leading = subgoals.astype(np.float32)
    leading[1:] = sharpened(leading[1:], sharpness)
    for table in (subgoals, leading):
        table[1:] = (1.0 - softness) * table[1:] + softness * np.array(uniform)[1:]
    entropy = -(subgoals * np.log(np.where(subgoals > 0, subgoals, 1.0))).sum(-1)
    return Candidates(np.array(guides), leading, np.array(columns).T, entropy)
