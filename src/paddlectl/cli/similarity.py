"""`paddlectl similarity`."""

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any

import typer

from paddlectl.cli.options import AsJson, RegistryPlace, TaskFiles, complete_sources, complete_tasks
from paddlectl.errors import NotFoundError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from paddlectl.registry.records import PolicyRecord
    from paddlectl.registry.store import Registry
    from paddlectl.tasks.base import Task

EXAMPLE = (
    "Example: paddlectl similarity --target BlockedBoxUnlockPickup --source BlockedDoor --source GapBall"
)

_OVERALL = "Over all scenes of the target"

BODY_WEIGHT = 0.8
MOST = 50  # policies of --top


def similarity(
    target: Annotated[
        str,
        typer.Option(
            metavar="TASK", autocompletion=complete_tasks, help="The task to learn.", show_default=False
        ),
    ],
    source: Annotated[
        list[str] | None,
        typer.Option(
            metavar="POLICY",
            autocompletion=complete_sources,
            help="A policy's id or a task's name; repeat for more. Without: every other task's best policy.",
            show_default=False,
        ),
    ] = None,
    top: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=MOST,
            metavar="K",
            help="Of all policies the most similar, one a task, K tasks at most.",
            show_default=False,
        ),
    ] = None,
    body_weight: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Share of the body in ψ (0.8).", show_default=False)
    ] = None,
    head_weight: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Share of the heads in ψ (0.2).", show_default=False)
    ] = None,
    task_files: TaskFiles = None,
    registry: RegistryPlace = "registry",
    as_json: AsJson = False,
) -> None:
    """Show Ψ: for each scene of the target the best scenes of each source, and their ψ."""
    from paddlectl.cli.named import task_named
    from paddlectl.experiments.similar import most_similar, nearest_of_all
    from paddlectl.registry.store import Registry
    from paddlectl.report.mapping import heat_map_parts, mapping_parts
    from paddlectl.report.output import print_json, print_text
    from paddlectl.report.tables import SIMILAR, table
    from paddlectl.tasks.suite import load

    body, head = weights(body_weight, head_weight)
    if top is not None and source:
        raise UsageError("--top and --source exclude each other", "leave one of them out")
    task = load(task_named(target))
    opened = Registry.open(registry, create=False)
    if top is None:
        policies = sources_for(opened, task, source or ())
        similar = most_similar(opened, task, policies, body, head)
    else:
        similar = nearest_of_all(opened, task, top, body, head)
        policies = [opened.policy(each.policy) for each in similar]
        _require_any(policies, opened, task)
    overall = [each._asdict() for each in similar]
    document = similarity_document(task, policies, body, head)
    if as_json:
        print_json({**document, "overall": overall})
    elif top is None:
        print_text([*mapping_parts(document), table(SIMILAR, overall, _OVERALL)])
    else:
        print_text([table(SIMILAR, overall, _OVERALL), *heat_map_parts(document)])


def weights(body: float | None, head: float | None) -> tuple[float, float]:
    """Both weights; one alone leaves the rest of 1 to the other.

    Raises:
        UsageError: If one is outside [0, 1], or the two don't add up to 1.
    """
    if body is None:
        body = BODY_WEIGHT if head is None else 1.0 - head
    if head is None:
        head = round(1.0 - body, 12)
    if not (0.0 <= body <= 1.0 and 0.0 <= head <= 1.0):
        raise UsageError(f"a weight lies in [0, 1]: body {body:g}, head {head:g}")
    if not math.isclose(body + head, 1.0, rel_tol=0.0, abs_tol=1e-9):
        raise UsageError(f"the weights must add up to 1: body {body:g}, head {head:g}")
    return body, head


def sources_for(registry: "Registry", target: "Task", names: "Sequence[str]") -> "list[PolicyRecord]":
    """The policies named, each once; without names those of every other task of the domain.

    Of a task it is the one that a transfer by `paddle` reuses, if there is one.

    Raises:
        NotFoundError: If a policy, or any policy of the domain, isn't there.
        UsageError: If a policy is of another domain, or has no clauses.
    """
    from paddlectl.methods.catalogue import teachers_of

    teachers = teachers_of("paddle", target)
    found = [_named(registry, name, teachers) for name in names]
    found = found or _best_of_domain(registry, target, teachers)
    _require_any(found, registry, target)
    for policy in found:
        if policy.domain != target.domain:
            raise UsageError(
                f"{policy.id} solves {policy.task} of {policy.domain}; {target.name} is of {target.domain}",
                "run: paddlectl policies",
            )
        if policy.program is None:
            raise UsageError(
                f"{policy.id} was learned by {policy.method}, which has no clauses to compare",
                _way_to_clauses(registry, policy, teachers),
            )
    return list({policy.id: policy for policy in found}.values())


def _require_any(found: "Sequence[PolicyRecord]", registry: "Registry", target: "Task") -> None:
    if not found:
        raise NotFoundError(
            f"no policy of another {target.domain} task in {registry.shown}",
            _way_to_another(target),
        )


def _named(registry: "Registry", name: str, teachers: tuple[str, ...]) -> "PolicyRecord":
    """The policy of an id; of a task the best of a method that teaches, else with clauses, else any."""
    from paddlectl.cli.named import policy_named

    policy = policy_named(registry, name)
    if name != policy.id:
        with suppress(NotFoundError):
            return registry.policy(policy.content, teachers, clauses=True)
        with suppress(NotFoundError):
            return registry.policy(policy.content, clauses=True)
    return policy


def _way_to_clauses(registry: "Registry", policy: "PolicyRecord", teachers: tuple[str, ...]) -> str:
    with suppress(NotFoundError):
        return f"name {registry.policy(policy.content, teachers).id} instead"
    if policy.content.definition is not None:
        return f"train the file of {policy.task} with --method hdm, and name that instead"
    return f"name {policy.task} instead, and run: paddlectl train {policy.task}"


def _way_to_another(target: "Task") -> str:
    """By the first other task of the domain: a source."""
    from paddlectl.tasks.suite import usable

    others = [task.name for task in usable() if task.domain == target.domain and task.name != target.name]
    return f"run: paddlectl train {others[0]}" if others else f"{target.name} is the only one of its domain"


def _best_of_domain(registry: "Registry", target: "Task", teachers: tuple[str, ...]) -> "list[PolicyRecord]":
    from paddlectl.registry.records import Content

    own = Content(target.name, target.definition).identity
    best = registry.best_of_each(target.domain, teachers)
    return [registry.policy(policy) for content, policy in best if content.identity != own]


def similarity_document(
    target: "Task", sources: "Sequence[PolicyRecord]", body_weight: float, head_weight: float
) -> dict[str, Any]:
    """Ψ of the target's complete clause set (Algorithm 1) against the sources' programs."""
    from paddlectl.experiments.similar import mapping_of
    from paddlectl.transfer.documents import mapping_document

    scenes, mapping = mapping_of(target, sources, body_weight, head_weight)
    solved = {policy.id: policy.task for policy in sources}
    return mapping_document(target.name, scenes, mapping, solved, body_weight, head_weight)
