"""Study files: scenarios × methods × variants × seeds, and which figure they make."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from paddlectl import shipped
from paddlectl.errors import PaddlectlError, UsageError
from paddlectl.methods import catalogue
from paddlectl.methods.changes import Changes
from paddlectl.registry.names import is_id
from paddlectl.scenario import (
    Frames,
    Guidance,
    Name,
    Names,
    Scenario,
    Seeds,
    Similarity,
    TaskSources,
    advice_on_seeds,
    ambiguous,
    load_scenario,
    misfits_of,
    misnamed,
    read_tasks,
    repeated,
    unreadable,
)
from paddlectl.tasks import suite
from paddlectl.tasks.suite import AnyTask
from paddlectl.yaml_files import Closed, KeyPath, Kind, Problem, load_file, unknown

MOST = 200
"""Scenarios, methods and variants of a study, each."""
MOST_CELLS = 100_000

Several = Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST)]


class Variant(Closed):
    """What is changed against the scenario and the methods' usual numbers; empty is neither.

    Attributes:
        methods: Those that it is for; None is all of the study.
        sources: Tasks to reuse instead of the scenario's.
        random: Tasks of which a policy that has learned nothing is a source, instead of one that has.
        rules: Of the guidance, by name (`transfer.guidance.GuidanceSettings`).
        settings: Of the method, by name, also within each other: `{learner: {learning_rate: 1e-3}}`.
    """

    methods: Several | None = None
    sources: Names | None = None
    random: Names | None = None
    similarity: Similarity | None = None
    guidance: Guidance | None = None
    rules: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)


class Study(Closed):
    """Transfers to compare: all scenarios by all methods, in all variants, with all seeds.

    A transfer reuses sources of its own seed, learned by the usual numbers of the method that teaches.

    Attributes:
        figure: What is drawn: learning `curves`, or each candidate's `weights` in each scene.
        scenarios: Their files, from where the study's file is, or names of such as are shipped.
        frames: Environment steps of each transfer; None is as many as its scenario says.
        source_frames: Of each source; None is the usual budget.
        variants: By the names that figures have for them; none is the scenarios as they are.
    """

    name: Name
    figure: Literal["curves", "weights"] = "curves"
    scenarios: Several
    methods: Several
    seeds: Seeds
    frames: Frames | None = None
    source_frames: Frames | None = None
    variants: dict[Name, Variant] = Field(default_factory=dict, max_length=MOST)


class Loaded(NamedTuple):
    """A study with its scenarios.

    Attributes:
        file: Where it was read from.
    """

    file: Path
    study: Study
    scenarios: tuple[Scenario, ...]


def load_study(path: Path) -> Loaded:
    """Reads and checks a study file and its scenarios' files.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a study; the message starts with file:line:column.
    """
    study = _read(load_file(path, _KIND), path.parent)
    files = [shipped.scenario(name, path.parent) for name in study.scenarios]
    return Loaded(path, study, tuple(map(load_scenario, files)))


def _read(study: Study, folder: Path) -> Study:
    """The study with what its variants' task files define."""
    variants = {
        name: variant.model_copy(
            update={part: tasks and read_tasks(tasks, folder) for part, tasks in _tasks_of(variant).items()}
        )
        for name, variant in study.variants.items()
    }
    return study.model_copy(update={"variants": variants})


def _tasks_of(variant: Variant) -> dict[str, tuple[AnyTask, ...] | None]:
    return {"sources": variant.sources, "random": variant.random}


def varied(scenario: Scenario, variant: Variant) -> Scenario:
    """The scenario with the variant's changes, its sources paired by seed."""
    tasks = variant.sources or scenario.source_names
    changes = {
        "sources": TaskSources(tasks=tasks, seed="paired"),
        "similarity": variant.similarity or scenario.similarity,
        "guidance": variant.guidance or scenario.guidance,
    }
    return scenario.model_copy(update=changes)


def _misuses(study: Study, path: Path) -> Iterator[Problem]:
    """What a schema can't know: files, tasks, methods, and numbers that there are not."""
    for key in ("scenarios", "methods", "seeds"):
        yield from repeated((key,), getattr(study, key))
    scenarios = []
    for index, name in enumerate(study.scenarios):
        try:
            scenarios.append(load_scenario(shipped.scenario(name, path.parent)))
        except PaddlectlError as error:
            yield Problem(("scenarios", index), "; ".join(filter(None, (error.message, error.hint))))
            continue
        if named := [source for source in scenarios[-1].source_names if is_id(str(source))]:
            yield Problem(
                ("scenarios", index), f"it reuses {named[0]}; a study reuses those of its own seeds"
            )
        if scenarios[-1].chosen:
            yield Problem(("scenarios", index), "its sources are chosen (auto); a study's are named")
            scenarios.pop()
            continue
        for method in filter(catalogue.known, study.methods):
            own = Changes(scenarios[-1].settings, scenarios[-1].rules)
            yield from (
                Problem(("scenarios", index), f"{'.'.join(place)}: {method}: {why}")
                for place, why in misfits_of(scenarios[-1], method, own)
            )
    yield from _unknown_methods(("methods",), study.methods, catalogue.names())
    yield from _unfit_methods(study.methods, scenarios)
    names = [scenario.name for scenario in scenarios]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield Problem(("scenarios", index), f"another scenario before is called {name!r}, too")
    if (
        cells := math.prod(map(len, (study.scenarios, study.methods, study.seeds, study.variants or "1")))
    ) > MOST_CELLS:
        yield Problem(("seeds",), f"{cells:,} cells in all; a study has {MOST_CELLS:,} at most")
    unread = [
        problem
        for name, variant in study.variants.items()
        for part, tasks in _tasks_of(variant).items()
        for problem in unreadable(("variants", name, part), tasks or (), path.parent)
    ]
    yield from unread
    if unread:
        return
    study = _read(study, path.parent)
    for name, variant in study.variants.items():
        yield from _misuses_of_variant(("variants", name), variant, study, scenarios)
    variants = [
        task for each in study.variants.values() for tasks in _tasks_of(each).values() for task in tasks or ()
    ]
    if wrong := ambiguous(
        [*variants, *(task for each in scenarios for task in (each.target, *each.source_names))]
    ):
        yield Problem(("scenarios",), wrong)


def _misuses_of_variant(
    key: KeyPath, variant: Variant, study: Study, scenarios: list[Scenario]
) -> Iterator[Problem]:
    yield from _unknown_methods((*key, "methods"), variant.methods or (), study.methods)
    if variant.random:
        unlike = [name for name in variant.methods or study.methods if not _takes_random(name)]
        yield from (
            Problem(
                (*key, "random"), f"{name} can't reuse those; say for which methods this is: methods: […]"
            )
            for name in unlike
        )
    for part, tasks in _tasks_of(variant).items():
        yield from repeated((*key, part), tasks or ())
        for index, task in enumerate(tasks or ()):
            for scenario in scenarios:
                if message := misnamed(task, ("sources", "tasks"), scenario.target):
                    yield Problem((*key, part, index), message)
    for method in filter(catalogue.known, variant.methods or study.methods):
        for scenario in scenarios:
            for place, why in misfits_of(
                varied(scenario, variant), method, Changes(variant.settings, variant.rules)
            ):
                yield Problem((*key, *place), f"{method}: {why}", at_key=True)


def _unfit_methods(methods: tuple[str, ...], scenarios: list[Scenario]) -> Iterator[Problem]:
    """Those that can't choose the actions of a target."""
    for index, method in enumerate(methods):
        for scenario in scenarios if catalogue.known(method) else ():
            try:
                catalogue.require_actions(method, suite.load(scenario.target))
            except UsageError as error:
                yield Problem(("methods", index), error.message)


def _takes_random(method: str) -> bool:
    """Whether it reuses policies of the kind of which there are such as have learned nothing."""
    return not catalogue.known(method) or catalogue.MADE_AS["random"] in catalogue.entry_of(method).teaches


def _unknown_methods(key: KeyPath, methods: tuple[str, ...], known: tuple[str, ...]) -> Iterator[Problem]:
    for index, name in enumerate(methods):
        if name not in known:
            yield Problem((*key, index), unknown("method", name, known))


_KIND = Kind(
    "study",
    Study,
    {
        (): Study,
        ("variants", "*"): Variant,
        ("variants", "*", "similarity"): Similarity,
        ("variants", "*", "guidance"): Guidance,
    },
    _misuses,
    advice=advice_on_seeds,
)
