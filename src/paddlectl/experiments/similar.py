"""Which policies of a registry are most similar to a target: their ψ (Algorithm 1), over all its scenes.

A policy without clauses has no ψ. That of its task's best policy with clauses stands for it; a task that has
none can't be compared. Only so all are measured alike, and as `similarity` shows it.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

from paddlectl.errors import IntegrityError, InvalidFileError, NotFoundError
from paddlectl.logic.clauses import Program, Scene, scenes_of
from paddlectl.logic.syntax import parse_program
from paddlectl.logic.templates import all_clauses
from paddlectl.methods.catalogue import teachers_of
from paddlectl.registry.records import Content, PolicyRecord, StoredProgram
from paddlectl.registry.store import Registry
from paddlectl.tasks.base import Task
from paddlectl.transfer.library import library_of, mean_similarities
from paddlectl.transfer.similarity import SceneMapping, map_scenes


class Similar(NamedTuple):
    """Why a policy is reused.

    Attributes:
        policy: Its id.
        similarity: The mean ψ over the target's scenes.
        program: The policy whose clauses were compared: itself, if it has any.
    """

    policy: str
    task: str
    similarity: float
    program: str

    def __str__(self) -> str:
        """`policy-7 (GapBall, ψ 0.695)`."""
        of = "" if self.program == self.policy else f" by {self.program}"
        return f"{self.policy} ({self.task}, ψ {self.similarity:.3f}{of})"


def stored_program(policy: PolicyRecord) -> Program:
    """The policy's program, parsed; an empty one of a method without clauses.

    Raises:
        IntegrityError: If what is stored is no program.
    """
    try:
        return parse_program(policy.program or "")
    except InvalidFileError as error:
        way = f": paddlectl train {policy.task}" if policy.content.definition is None else " by its task file"
        raise IntegrityError(
            f"the program of {policy.id} is damaged: {error.message}", f"train it again{way}"
        ) from error


def scenes_of_task(target: Task) -> tuple[Scene, ...]:
    """Those of its complete clause set."""
    vocabulary = target.vocabulary
    return scenes_of(all_clauses(vocabulary.atoms, vocabulary.exclusions, target.subgoals))


def mapping_of(
    target: Task, policies: Iterable[PolicyRecord], body_weight: float, head_weight: float
) -> tuple[Sequence[Scene], SceneMapping]:
    """The scenes of the target's complete clause set, and their Ψ (Algorithm 1) in policies' programs."""
    scenes = scenes_of_task(target)
    programs = {policy.id: scenes_of(stored_program(policy).clauses) for policy in policies}
    return scenes, map_scenes(scenes, programs, body_weight, head_weight)


def most_similar(
    registry: Registry,
    target: Task,
    policies: Iterable[PolicyRecord],
    body_weight: float,
    head_weight: float,
) -> list[Similar]:
    """Policies by their similarity, the largest first; equals in the order given.

    Args:
        registry: Where they are.
        target: The task to learn.
        policies: To compare. Those whose task has no clauses are left out.
        body_weight: γ_body.
        head_weight: γ_head.
    """
    compared: dict[str, PolicyRecord] = {}
    tasks = {}
    for policy in policies:
        tasks[policy.id] = policy.task
        with suppress(NotFoundError):
            compared[policy.id] = policy if policy.program else with_clauses(registry, target, policy.content)
    _, mapping = mapping_of(target, compared.values(), body_weight, head_weight)
    found = [
        Similar(policy, tasks[policy], mapping.overall(program.id), program.id)
        for policy, program in compared.items()
    ]
    return sorted(found, key=lambda each: -each.similarity)


def nearest_of_all(
    registry: Registry, target: Task, count: int, body_weight: float, head_weight: float
) -> list[Similar]:
    """Of all policies that `paddle` can reuse on the target the most similar, one a task, the nearest first.

    The target itself is left out. Of equals the best comes first, by what `Registry.policy` goes by.

    Args:
        registry: Where they are.
        target: The task to learn.
        count: How many tasks at most.
        body_weight: γ_body.
        head_weight: γ_head.

    Raises:
        IntegrityError: If what is stored of one is no program.
    """
    own = Content(target.name, target.definition)
    read: list[StoredProgram] = []

    def others() -> Iterator[str]:
        for each in registry.programs(target.domain, teachers_of("paddle", target)):
            if each.task.name != own.name or each.task.identity != own.identity:
                read.append(each._replace(program=""))  # the text is most of it
                yield each.program

    try:
        library = library_of(others())
    except InvalidFileError:
        stored_program(registry.policy(read[-1].policy))
        raise
    means = mean_similarities(scenes_of_task(target), library, body_weight, head_weight)

    def merit(n: int) -> tuple[float, float, float, int]:
        return means[n], read[n].success_rate, read[n].mean_score, n

    found: dict[str, Similar] = {}
    for n in sorted(range(len(read)), key=merit, reverse=True):
        policy, task = read[n].policy, read[n].task
        found.setdefault(task.identity, Similar(policy, task.name, float(means[n]), policy))
        if len(found) == count:
            break
    return list(found.values())


def with_clauses(registry: Registry, target: Task, task: Content) -> PolicyRecord:
    """The best policy with clauses of a task: that which `paddle` reuses on the target.

    Raises:
        NotFoundError: If there is none.
    """
    return registry.policy(task, teachers_of("paddle", target), clauses=True)
