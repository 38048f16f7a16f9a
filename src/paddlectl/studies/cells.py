"""The cells of a study, and the runs of a registry that are them.

A run is a cell's if all that decides what it does is the same: task, method, seed, frames, settings, rules
and sources, which were learned by runs that are found in the same way. So a study finds what other studies,
or a user by hand, have run already; and a cell is run again if a number of its method has changed since.
"""

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

from paddlectl.agents.settings import changed, restored, with_defaults
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import RandomJob, TrainJob, TransferJob
from paddlectl.experiments.policies import task_of
from paddlectl.experiments.runner import budget_of, rules_of, settings_of
from paddlectl.methods.base import method_of
from paddlectl.methods.catalogue import MADE_AS, teacher_of
from paddlectl.registry.records import Content, RunRecord
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.studies.study import Loaded, Study, Variant, varied
from paddlectl.tasks.naming import content
from paddlectl.tasks.suite import AnyTask, load

RANDOM = "random"
"""The method of policies that have learned nothing."""


class Source(NamedTuple):
    """A policy that cells reuse: of a task, by a method's usual numbers, with a seed and a budget."""

    task: AnyTask
    method: str
    seed: int
    frames: int | None = None

    @property
    def name(self) -> str:
        """`BlockedDoor hdm seed 3`."""
        return f"{self.task} {self.method} seed {self.seed}"

    def job(self) -> TrainJob | RandomJob:
        """What learns it."""
        if self.method == RANDOM:
            return RandomJob(self.task, self.seed)
        return TrainJob(self.task, self.seed, self.frames, method=self.method)


@dataclass(frozen=True)
class Cell:
    """One transfer of a study.

    Attributes:
        scenario: With the variant's changes.
        variant: Its name; empty in a study without variants.
        sources: What it reuses.
        rules: As a `TransferJob` has them, as are the settings' `changes`.
    """

    scenario: Scenario
    method: str
    variant: str
    seed: int
    frames: int
    sources: tuple[Source, ...]
    rules: Any
    changes: Mapping[str, Any]

    @property
    def panel(self) -> str:
        """`A`, or `A, no floor`: where it is shown in a figure of one method."""
        return f"{self.scenario.name}, {self.variant}" if self.variant else self.scenario.name

    @property
    def name(self) -> str:
        """`A paddle seed 3`."""
        variant = f" {self.variant}" if self.variant else ""
        return f"{self.scenario.name} {self.method}{variant} seed {self.seed}"

    @cached_property
    def identity(self) -> str:
        """The same for cells that one run serves: without sources all scenarios of a target are one."""
        told = _key_of_job(self.job(tuple(map(_key_of_source, self.sources))))
        return hashlib.sha256(told.encode()).hexdigest()[:16]

    def job(self, sources: tuple[str, ...]) -> TransferJob:
        """What runs it, with the ids of its sources."""
        return TransferJob(
            self.scenario, sources, self.method, self.seed, self.frames, self.rules, self.changes
        )


class Found(NamedTuple):
    """How far the registry is with a cell or source.

    Attributes:
        state: `finished`, `stopped` (also failed), `running` in some process, `missing`, `waiting` for
            sources, or `kept`: not here, but in a file of results.
        run: The run, if there is one.
    """

    state: str
    run: RunRecord | None = None


MISSING = Found("missing")
WAITING = Found("waiting")
KEPT = Found("kept")


class Runs:
    """The runs of a registry by what decides them. It reads the registry once."""

    def __init__(self, registry: Registry | None) -> None:
        self._registry = registry
        self._known: dict[str, list[RunRecord]] = {}
        for record in reversed(registry.runs() if registry else ()):
            self._known.setdefault(_key_of(record), []).append(record)

    def source(self, source: Source) -> Found:
        """The run that learned a source."""
        return self._best(_key_of_source(source))

    def cell(self, cell: Cell, sources: Sequence[Found]) -> Found:
        """The run that is a cell, with these of its sources."""
        if any(found.state != "finished" for found in sources):
            return WAITING
        return self._best(_key_of_job(cell.job(policies_of(sources))))

    def _best(self, key: str) -> Found:
        """Of several the one that is furthest: the first that finished, or the last that was stopped.

        So later runs of the same change nothing, and one that couldn't go on isn't in the way of a new one.
        """
        found = [Found(self._state(record), record) for record in self._known.get(key, ())]
        for state in ("finished", "running"):
            for each in found:
                if each.state == state:
                    return each
        return found[-1] if found else MISSING

    def _state(self, record: RunRecord) -> str:
        if record.status == "finished":
            return "finished" if record.policy else "stopped"
        assert self._registry is not None
        alive = record.status == "running" and self._registry.files.goes_on(record.id)
        return "running" if alive else "stopped"


def policies_of(sources: Iterable[Found]) -> tuple[str, ...]:
    """The ids of what finished sources learned."""
    return tuple(found.run.policy for found in sources if found.run and found.run.policy)


def cells_of(loaded: Loaded, seeds: Sequence[int] | None = None, frames: int | None = None) -> list[Cell]:
    """All cells of a study, those of one seed together.

    Args:
        loaded: The study.
        seeds: Instead of its own.
        frames: Instead of its own, or its scenarios'.
    """
    study = loaded.study
    return [
        _cell(study, scenario, name, variant, method, seed, frames)
        for seed in (study.seeds if seeds is None else seeds)
        for scenario in loaded.scenarios
        for name, variant in (study.variants or {"": Variant()}).items()
        for method in study.methods
        if variant.methods is None or method in variant.methods
    ]


def _cell(
    study: Study,
    scenario: Scenario,
    name: str,
    variant: Variant,
    method: str,
    seed: int,
    frames: int | None,
) -> Cell:
    teaches = _teacher_of(method, scenario.target)
    scenario = varied(scenario, variant)
    random, budget = variant.random or (), study.source_frames
    learned = [task for task in scenario.source_names if task not in random] if teaches else []
    sources = [Source(task, str(teaches), seed, budget) for task in learned]
    sources += [Source(task, RANDOM, seed) for task in random]
    frames = frames or study.frames or scenario.frames
    usual = TransferJob(scenario, (), method, seed, frames)
    rules = changed(rules_of(usual), variant.rules) if variant.rules else None
    return Cell(scenario, method, name, seed, frames, tuple(sources), rules, variant.settings)


@cache
def _teacher_of(method: str, target: AnyTask) -> str | None:
    return teacher_of(method, load(target))


def _key_of(record: RunRecord) -> str:
    settings = record.settings
    scenario = settings.get("scenario") or {}
    return _key(
        record.method,
        record.content,
        record.seed,
        record.sources,
        settings.get("frames"),
        *_as_today(record),
        [scenario.get("similarity"), scenario.get("guidance")],
    )


def _as_today(record: RunRecord) -> tuple[Any, Any]:
    """A run's settings and rules as this version writes them: what came later is as it was without it."""
    learning, rules = (record.settings.get(name) for name in ("learning", "rules"))
    try:
        usual_settings, usual_rules = _defaults(MADE_AS.get(record.method, record.method), task_of(record))
        learning = dataclasses.asdict(restored(usual_settings, learning, "settings"))
        if usual_rules and record.kind == "transfer":
            rules = dataclasses.asdict(restored(usual_rules, rules or {}, "rules"))
    except (PaddlectlError, TypeError, ValueError):
        pass  # of another version, or of a plug-in that isn't here: no cell is like it
    return learning, rules


@cache
def _defaults(method: str, task: AnyTask) -> tuple[Any, Any]:
    made, loaded = method_of(method), load(task)
    rules = made.rules_for(loaded)
    return with_defaults(made.settings_from(loaded, {})), rules and with_defaults(rules)


@cache
def _key_of_source(source: Source) -> str:
    method = MADE_AS.get(source.method, source.method)
    made = TrainJob(source.task, source.seed, source.frames, method=method)
    frames = 0 if source.method == RANDOM else budget_of(made)
    learning = dataclasses.asdict(settings_of(made))
    return _key(source.method, content(source.task), source.seed, (), frames, learning)


def _key_of_job(job: TransferJob) -> str:
    scenario = job.scenario.model_dump(mode="json")
    rules = rules_of(job)
    return _key(
        job.method,
        content(job.scenario.target),
        job.seed,
        job.sources,
        job.frames,
        dataclasses.asdict(settings_of(job)),
        rules and dataclasses.asdict(rules),
        [scenario["similarity"], scenario["guidance"]],
    )


def _key(
    method: str,
    task: Content,
    seed: int,
    sources: Sequence[str],
    frames: Any,
    learning: Any,
    rules: Any = None,
    scenario: Any = None,
) -> str:
    """All that decides what a run does; the scenario's numbers only if there is a source to weigh."""
    numbers = [frames, learning, rules, scenario if sources else None]
    told = json.dumps([method, task.identity, seed, list(sources), *numbers])
    return json.dumps(json.loads(told, parse_float=_number), sort_keys=True)


def _number(text: str) -> float | int:
    """30.0 is 30."""
    value = float(text)
    return int(value) if value.is_integer() else value
