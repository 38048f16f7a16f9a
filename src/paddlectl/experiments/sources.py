"""Which policies a scenario reuses: those named, of tasks the best or each seed's, or the most similar."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import NamedTuple

from paddlectl import whole
from paddlectl.errors import NotFoundError, UsageError
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.similar import Similar, most_similar
from paddlectl.methods.catalogue import teacher_of, teachers_of
from paddlectl.registry.names import is_id
from paddlectl.registry.records import Content, PolicyRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.tasks.base import Task
from paddlectl.tasks.naming import content, kept, typed
from paddlectl.tasks.suite import AnyTask, known, load, usable

ANY = 0
"""The seed to learn with where any will do."""


class Sources(NamedTuple):
    """The sources of a scenario's transfers.

    Attributes:
        ids: Seed of the transfer -> ids of its sources, in the scenario's order; empty if any is missing.
        missing: What would learn the policies that the registry lacks.
        paired: Whether their seeds matter.
        why: Seed of the transfer -> why its sources were chosen; empty if they are named.
    """

    ids: Mapping[int, tuple[str, ...]]
    missing: Sequence[TrainJob]
    paired: bool
    why: Mapping[int, Sequence[Similar]] = MappingProxyType({})

    def required(self) -> Mapping[int, tuple[str, ...]]:
        """The ids.

        Raises:
            NotFoundError: If a policy is missing; with the command that learns all of them.
        """
        if self.missing:
            told = [
                f"{', '.join(map(str, tasks))}{self._with(seeds)}" for seeds, tasks in self._groups().items()
            ]
            raise NotFoundError(
                f"no policy for {' and '.join(told)} by {self.missing[0].method}", f"run: {self.command()}"
            )
        return self.ids

    def command(self) -> str:
        """What a user types to learn all that is missing."""
        method = self.missing[0].method
        by = "" if method == TrainJob.method else f" --method {method}"
        return ", then ".join(
            f"paddlectl train {' '.join(map(typed, tasks))}{self._option(seeds)}{by}"
            for seeds, tasks in self._groups().items()
        )

    def _groups(self) -> dict[tuple[int, ...], list[AnyTask]]:
        """The seeds that tasks lack -> those tasks."""
        lacking: dict[AnyTask, list[int]] = {}
        for job in self.missing:
            lacking.setdefault(job.task, []).append(job.seed)
        groups: dict[tuple[int, ...], list[AnyTask]] = {}
        for task, seeds in lacking.items():
            groups.setdefault(tuple(seeds), []).append(task)
        return groups

    def _with(self, seeds: tuple[int, ...]) -> str:
        return f" with seed{'s' * (len(seeds) > 1)} {whole.ranges(seeds)}" if self.paired else ""

    def _option(self, seeds: tuple[int, ...]) -> str:
        return f" --seed{'s' * (len(seeds) > 1)} {whole.ranges(seeds)}" if self.paired else ""


def resolve(registry: Registry, scenario: Scenario, method: str, seeds: Sequence[int]) -> Sources:
    """The policies that a scenario's transfers by a method reuse, each learned by a method that teaches it.

    What a transfer has learned is among them. A paired seed reuses the newest policy of each task that was
    learned with that seed, by usual numbers, from nothing.

    Raises:
        NotFoundError: If there is no policy of an id that the scenario names, or there are too few to choose.
        UsageError: If that policy can't be reused, or is the best one of a task beside it; or if there is no
            such method, or it can't learn the target.
    """
    target = load(scenario.target)
    teaches, teachers = teacher_of(method, target), teachers_of(method, target)
    if teaches is None:
        return Sources(dict.fromkeys(seeds, ()), (), scenario.paired)
    if scenario.chosen:
        return _chosen(registry, scenario, target, teachers, seeds)
    if scenario.paired:
        known = {task: _by_seed(registry, content(task), teaches) for task in scenario.source_names}
        return _sources(scenario, teaches, seeds, known)
    ids: dict[AnyTask, str] = {}
    for name in scenario.source_names:
        if isinstance(name, str) and is_id(name):
            ids[name] = _named(registry, name, scenario, method, teachers).id
        elif best := _best(registry, content(name), teachers):
            ids[name] = best.id
    _require_distinct(ids)
    known = {
        name: dict.fromkeys((*seeds, ANY), ids[name]) if name in ids else {} for name in scenario.source_names
    }
    return _sources(scenario, teaches, seeds, known)


def unlearned(scenario: Scenario, teaches: str, seeds: Sequence[int]) -> Sources:
    """The same where there is no registry yet: all tasks are missing."""
    tasks = [name for name in scenario.source_names if not is_id(str(name))]
    tasks += _others(load(scenario.target))[: scenario.chosen]
    return _sources(scenario, teaches, seeds, {task: {} for task in tasks})


def _sources(
    scenario: Scenario, teaches: str, seeds: Sequence[int], known: Mapping[AnyTask, Mapping[int, str]]
) -> Sources:
    """From the ids that are known of each name, by seed."""
    missing = [
        TrainJob(name, seed, method=teaches)
        for seed in (seeds if scenario.paired else (ANY,))
        for name in known
        if seed not in known[name]
    ]
    ids = {} if missing else {seed: tuple(by_seed[seed] for by_seed in known.values()) for seed in seeds}
    return Sources(ids, missing, scenario.paired)


def _best(registry: Registry, task: Content, teachers: tuple[str, ...]) -> PolicyRecord | None:
    with suppress(NotFoundError):
        return registry.policy(task, teachers)
    return None


def _by_seed(registry: Registry, task: Content, teaches: str) -> dict[int, str]:
    """Seed -> the newest policy of a task that was learned with it by the usual numbers of its time."""
    newest: dict[int, str] = {}
    for policy, seed, settings in registry.learned(task, teaches):
        if not settings.get("unusual"):
            newest.setdefault(seed, policy)
    return newest


def _chosen(
    registry: Registry, scenario: Scenario, target: Task, teachers: tuple[str, ...], seeds: Sequence[int]
) -> Sources:
    """The most similar policies of other tasks, as many as the scenario asks for.

    Raises:
        NotFoundError: If there are fewer; with the commands that learn more.
    """
    best, teaches = _solved_beside(registry, target, teachers), teachers[0]
    if scenario.paired:
        by_task = {task: _by_seed(registry, content, teaches) for task, (content, _) in best.items()}
        there = {seed: {t: ids[seed] for t, ids in by_task.items() if seed in ids} for seed in seeds}
    else:
        there = {ANY: {task: policy for task, (_, policy) in best.items()}}
    weights = scenario.similarity
    found = {
        seed: most_similar(
            registry, target, map(registry.policy, ids.values()), weights.body_weight, weights.head_weight
        )
        for seed, ids in there.items()
    }
    if few := {seed: len(its) for seed, its in found.items() if len(its) < scenario.chosen}:
        of = f" with seed{'s' * (len(few) > 1)} {whole.ranges(few)}" if scenario.paired else ""
        raise NotFoundError(
            f"auto: {scenario.chosen} policies by {teaches}{of} are to be chosen of {min(few.values())}",
            _way_to_more(registry, scenario, target, teaches, {seed: there[seed] for seed in few}),
        )
    why = {seed: found[seed if scenario.paired else ANY][: scenario.chosen] for seed in seeds}
    ids = {seed: tuple(each.policy for each in its) for seed, its in why.items()}
    return Sources(ids, (), scenario.paired, why)


def _solved_beside(
    registry: Registry, target: Task, teachers: tuple[str, ...]
) -> dict[str, tuple[Content, str]]:
    """The other tasks of a target's domain that have policies, and the id of the best one.

    By their names; those that files defined come last, by their identity.
    """
    solved = {
        each.identity: (each, policy) for each, policy in registry.best_of_each(target.domain, teachers)
    }
    known = {task: solved.pop(Content(task).identity, None) for task in _others(target)}
    own = Content(target.name, target.definition).identity
    defined = {key: its for key, its in solved.items() if its[0].definition is not None and key != own}
    return {task: its for task, its in known.items() if its} | defined


def _way_to_more(
    registry: Registry,
    scenario: Scenario,
    target: Task,
    teaches: str,
    lacking: Mapping[int, Mapping[str, str]],
) -> str:
    """The commands that learn what there is too little of, for seeds that have these policies by task."""
    others = _others(target)
    if len(others) < scenario.chosen:
        return f"write auto: {len(others)} at most: {target.domain} has no more tasks beside {target.name}"
    by_clauses = teacher_of("paddle", target)
    compared = set(registry.solved(target.domain, teachers_of("paddle", target)))
    programs: dict[str, TrainJob] = {}
    jobs: list[TrainJob] = []
    for seed, there in lacking.items():
        nearest_first = sorted(others, key=there.__contains__, reverse=True)
        wanted = sorted(nearest_first, key=compared.__contains__, reverse=True)[: scenario.chosen]
        jobs += [TrainJob(task, seed, method=teaches) for task in wanted if task not in there]
        if teaches != by_clauses:
            programs |= {task: TrainJob(task, ANY) for task in wanted if task not in compared}
    commands = [Sources({}, [*programs.values()], False), Sources({}, jobs, scenario.paired)]
    return f"run: {', then '.join(each.command() for each in commands if each.missing)}"


def _others(target: Task) -> list[str]:
    """The other tasks of a target's domain."""
    return [task.name for task in usable() if task.domain == target.domain and task.name != target.name]


def _named(
    registry: Registry, name: str, scenario: Scenario, method: str, teachers: tuple[str, ...]
) -> PolicyRecord:
    """The policy of an id, if the method can reuse it on the target."""
    policy, target = registry.policy(name), load(scenario.target)
    if policy.content.definition is None and not known(policy.task):
        raise UsageError(f"{name} solves {policy.task}, which is no task here", "run: paddlectl policies")
    if policy.domain != target.domain:
        raise UsageError(
            f"{name} solves {policy.task} of {policy.domain}; {target.name} is of {target.domain}",
            "run: paddlectl policies",
        )
    if policy.method not in teachers:
        teaches = teachers[0]
        by = f"{name} was learned by {policy.method}; {method} reuses what {teaches} learned"
        best, task = _best(registry, policy.content, teachers), kept(*policy.content)
        for other in (task, *([best.id] if best else [])):
            if other in scenario.source_names:
                raise UsageError(by, f"leave out {name}, as {other} stands beside it")
        if best:
            raise UsageError(by, f"name {best.id} instead")
        if not isinstance(task, str):
            raise UsageError(by, f"name the file of {task} instead")
        learn = Sources({}, [TrainJob(task, ANY, method=teaches)], False).command()
        raise UsageError(by, f"name {task} instead, and run: {learn}")
    return policy


def _require_distinct(ids: Mapping[AnyTask, str]) -> None:
    for task, policy in ids.items():
        if task != policy and policy in ids:
            raise UsageError(
                f"{policy} is the best policy for {task}: it would be reused twice",
                f"name {policy} or {task} alone",
            )
