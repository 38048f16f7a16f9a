"""Scenario files: what to learn, from which sources, how and how often."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    PlainSerializer,
    PlainValidator,
    Tag,
    model_validator,
)
from pydantic_core import PydanticKnownError

from paddlectl import whole
from paddlectl.errors import PaddlectlError, UsageError
from paddlectl.methods import catalogue
from paddlectl.methods.base import method_of
from paddlectl.methods.changes import Changes, Misfit, unfit
from paddlectl.registry import fields
from paddlectl.registry.names import number_of
from paddlectl.tasks import suite
from paddlectl.tasks.naming import given
from paddlectl.tasks.suite import AnyTask, load
from paddlectl.transfer.guidance import PaperSettings
from paddlectl.yaml_files import Closed, KeyPath, Kind, Problem, check_values, load_file, unknown

_LIKE_ID = re.compile(r"(policy|run)?[\W_]*0*([0-9]*)", re.IGNORECASE)


def _seeds(value: Any) -> Any:
    """`0-5`, `0,3,7` or one seed, as on the command line, or what a list holds."""
    if isinstance(value, list):
        return tuple(value)
    if not isinstance(value, str) and type(value) is not int:
        return value
    try:
        return whole.seeds(str(value))
    except UsageError as error:
        raise ValueError(f"{error.message}; {error.hint}") from None


def _named(value: Any) -> Any:
    """A task's name or file, or what was read of a file."""
    if not isinstance(value, AnyTask):
        raise PydanticKnownError("string_type")
    return value


Named = Annotated[AnyTask, PlainValidator(_named), PlainSerializer(str)]
"""A file's is replaced by the task that it defines when a scenario is read; stored is its name."""
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0, lt=fields.SEEDS)]
Name = Annotated[
    str, Field(min_length=1, max_length=fields.LONGEST_SCENARIO, pattern=f"^({fields.SCENARIO})$")
]
Seeds = Annotated[
    tuple[Seed, ...], Field(min_length=1, max_length=fields.MOST_SEEDS), BeforeValidator(_seeds)
]
Frames = Annotated[int, Field(gt=0, le=fields.MOST_FRAMES)]
Names = Annotated[tuple[Named, ...], Field(min_length=1, max_length=fields.MOST_SOURCES)]


class TaskSources(Closed):
    """Tasks whose policies may be reused, and which of each.

    Attributes:
        tasks: Their names or files.
        seed: The `best` policy, or that of the transfer's own seed: `paired`, so that seeds are independent.
    """

    tasks: Names
    seed: Literal["best", "paired"] = "best"


class SimilarSources(Closed):
    """The policies that are most similar to the target, one a task.

    Attributes:
        auto: How many.
        seed: Of the `best` of each task, or of those of the transfer's own seed.
    """

    auto: Annotated[int, Field(ge=1, le=fields.MOST_SOURCES)]
    seed: Literal["best", "paired"] = "best"

    @model_validator(mode="before")
    @classmethod
    def _either(cls, sources: Any) -> Any:
        if isinstance(sources, dict) and "tasks" in sources:
            raise ValueError("auto chooses, tasks are named: leave out one of them")
        return sources


class _KeysOfSources(TaskSources):
    """All keys that the forms of sources have."""

    auto: int


def _form(sources: Any) -> str:
    if isinstance(sources, SimilarSources) or (isinstance(sources, dict) and "auto" in sources):
        return "similar"
    return "mapping" if isinstance(sources, dict | TaskSources) else "list"


Sources = Annotated[
    Annotated[Names, Tag("list")]
    | Annotated[TaskSources, Tag("mapping")]
    | Annotated[SimilarSources, Tag("similar")],
    Discriminator(_form),
]


class Similarity(Closed):
    """The shares of body and heads in ψ (method: γ_body and γ_head)."""

    body_weight: Share = 0.8
    head_weight: Share = 0.2

    @model_validator(mode="after")
    def _sum_is_one(self) -> "Similarity":
        if not math.isclose(self.body_weight + self.head_weight, 1.0, rel_tol=0.0, abs_tol=1e-9):
            raise ValueError("body_weight and head_weight must add up to 1")
        return self


class Guidance(Closed):
    """How a guide is chosen: by the rules of this project, or by Eqs. 2 and 3.

    All but `mode` are readings of those equations (`PaperSettings`) and belong to `mode: paper`.
    """

    mode: Literal["default", "paper"] = "default"
    initial_performance: Share = PaperSettings.initial_performance
    normalise: Literal["clip", "none"] = PaperSettings.normalise
    failure_cost: Share = PaperSettings.failure_cost
    values: Literal["per_guide", "per_subgoal"] = PaperSettings.values
    source_softness: Share = PaperSettings.source_softness
    imitation_margin: Share = PaperSettings.imitation_margin
    num_envs: Annotated[int, Field(ge=1, le=4096)] = PaperSettings.num_envs

    @model_validator(mode="after")
    def _readings_of_paper(self) -> "Guidance":
        for name, value in self._given().items():
            if self.mode != "paper" and value != getattr(PaperSettings, name):
                raise ValueError(f"{name} is a reading of the paper: add mode: paper, or leave it out")
        return self

    def readings(self) -> PaperSettings | None:
        """How the paper's equations are read; None if they aren't what guides."""
        return PaperSettings(**self._given()) if self.mode == "paper" else None

    def _given(self) -> dict[str, Any]:
        return self.model_dump(exclude={"mode"})


class Scenario(Closed):
    """One transfer: what to learn, from which sources, how and how often.

    Attributes:
        target: The task to learn: its name, or its file from where the scenario's file is.
        sources: Likewise tasks whose best policies may be reused, and ids of policies; or another form.
        frames: Environment steps of each run.
        rules: Other than the usual ones by which the method reuses sources, by name.
        settings: Of the method, likewise, also within each other: `{low_level: {learning_rate: 1e-3}}`.
    """

    name: Name
    target: Named
    sources: Sources
    method: str = "paddle"
    seeds: Seeds = (0,)
    frames: Frames = 400_000
    similarity: Similarity = Similarity()
    guidance: Guidance = Guidance()
    rules: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)

    @property
    def source_names(self) -> tuple[AnyTask, ...]:
        """The tasks and policies that `sources` names, in its order; none if they are chosen."""
        if isinstance(self.sources, SimilarSources):
            return ()
        return self.sources.tasks if isinstance(self.sources, TaskSources) else self.sources

    @property
    def chosen(self) -> int:
        """How many sources are chosen by their similarity; 0 if they are named."""
        return self.sources.auto if isinstance(self.sources, SimilarSources) else 0

    @property
    def source_count(self) -> int:
        """How many policies each transfer reuses."""
        return self.chosen or len(self.source_names)

    @property
    def paired(self) -> bool:
        """Whether each transfer reuses the policies of its own seed."""
        return not isinstance(self.sources, tuple) and self.sources.seed == "paired"


def load_scenario(path: Path) -> Scenario:
    """Reads and checks a scenario file.

    Raises:
        NotFoundError: If there is no such file.
        InvalidFileError: If it isn't a scenario; the message starts with file:line:column.
    """
    return _read(load_file(path, _KIND), path.parent)


def scenario_of(values: Mapping[str, Any]) -> Scenario:
    """A scenario from what a file would hold.

    Raises:
        InvalidFileError: If it isn't one.
    """
    return _read(check_values(values, _KIND), Path())


def _read(scenario: Scenario, folder: Path) -> Scenario:
    """The scenario with what its task files define."""
    names = read_tasks(scenario.source_names, folder)
    sources: Any = scenario.sources
    if isinstance(sources, TaskSources):
        sources = sources.model_copy(update={"tasks": names})
    elif isinstance(sources, tuple):
        sources = names
    (target,) = read_tasks((scenario.target,), folder)
    return scenario.model_copy(update={"target": target, "sources": sources})


def read_tasks(names: tuple[AnyTask, ...], folder: Path) -> tuple[AnyTask, ...]:
    """Tasks with what files define instead of the files' names."""
    return tuple(given(name, folder) if isinstance(name, str) else name for name in names)


def unreadable(key: KeyPath, names: tuple[AnyTask, ...], folder: Path) -> Iterator[Problem]:
    """Names in a list, or the one at a key, that are of files which define no task."""
    for place, name in _places(key, names):
        try:
            read_tasks((name,), folder)
        except PaddlectlError as error:
            yield Problem(place, "; ".join(filter(None, (error.message, error.hint))))


def ambiguous(tasks: Iterable[AnyTask]) -> str:
    """What to say where two tasks have one name; empty if none do."""
    found: dict[str, AnyTask] = {}
    for task in tasks:
        if found.setdefault(str(task), task) != task:
            return f"two tasks are called {task}; give one of them another name"
    return ""


def _misuses(scenario: Scenario, path: Path) -> Iterator[Problem]:
    """What a schema can't know: names of tasks and methods, and sources that can't serve the target."""
    key: KeyPath = ("sources", "tasks") if isinstance(scenario.sources, TaskSources) else ("sources",)
    problems = [*unreadable(key, scenario.source_names, path.parent)]
    problems += [
        problem._replace(path=("target",)) for problem in unreadable((), (scenario.target,), path.parent)
    ]
    yield from problems
    if problems:
        return
    scenario = _read(scenario, path.parent)
    if wrong := ambiguous((scenario.target, *scenario.source_names)):
        yield Problem(key, wrong)
    if not catalogue.known(scenario.method):
        yield Problem(("method",), unknown("method", scenario.method, catalogue.names()))
    if not suite.known(scenario.target):
        yield Problem(("target",), unknown("task", str(scenario.target), suite.names()))
    for place, name in _places(key, scenario.source_names):
        if message := misnamed(name, key, scenario.target):
            yield Problem(place, message)
    yield from repeated(key, scenario.source_names)
    yield from repeated(("seeds",), scenario.seeds)
    if catalogue.known(scenario.method) and suite.known(scenario.target):
        for place, why in misfits_of(scenario, scenario.method, Changes(scenario.settings, scenario.rules)):
            yield Problem(place, why, at_key=True)


def misfits_of(scenario: Scenario, method: str, changes: Changes) -> Iterator[Misfit]:
    """What can't be changed of a method's numbers where it learns the target."""
    if changes.settings or changes.rules:
        yield from unfit(method_of(method), load(scenario.target), scenario, changes)


def repeated(key: KeyPath, values: tuple[Any, ...]) -> Iterator[Problem]:
    """The values of a list that stand there before."""
    for path, value in _places(key, values):
        if value in values[: int(path[-1])]:
            shown = value if isinstance(value, int) else str(value)
            yield Problem(path, f"{shown!r} stands twice in {'.'.join(map(str, key))}")


def _places(key: KeyPath, values: tuple[Any, ...]) -> Iterator[tuple[KeyPath, Any]]:
    for index, value in enumerate(values):
        yield (*key, index), value


def misnamed(name: AnyTask, key: KeyPath, target: AnyTask) -> str:
    """What is wrong with the name of a source, as far as a file can tell; empty if nothing is."""
    if isinstance(name, str) and number_of(name, "policy") is not None:
        return f"{name} is no task; to name policies write sources: [{name}]" if key[1:] else ""
    if isinstance(name, str) and not suite.known(name):
        return _unknown_policy(name) or unknown("task", name, suite.names())
    if not suite.known(target) or load(name).domain == load(target).domain:
        return ""
    message = f"{name} is a task of {load(name).domain}, the target {target} of {load(target).domain}"
    return f"{message}: its policy can't act there"


def _unknown_policy(name: str) -> str:
    """What to say of `Policy_7`, `7` or `run-7`; empty for what isn't like an id."""
    found = _LIKE_ID.fullmatch(name[:80])
    if not found or not any(found.groups()):
        return ""
    meant = f"policy-{found[2]}"
    near = number_of(meant, "policy") is not None and (found[1] or "").lower() != "run"
    return f"unknown policy {name[:80]!r}; " + (
        f"did you mean {meant!r}?" if near else "ids look like policy-7"
    )


def _advice(path: KeyPath, kind: str, written: str) -> str | None:
    match kind:
        case "string_type" if path[0] == "sources":
            return f"write policy-{written}" if number_of(f"policy-{written}", "policy") else ""
        case "tuple_type" if written == "auto":
            return "write {auto: 3}"
        case "tuple_type" if written == "paired":
            return "write {tasks: [BlockedDoor, GapBall], seed: paired}"
    return advice_on_seeds(path, kind, written)


def advice_on_seeds(path: KeyPath, kind: str, written: str) -> str | None:
    """What to write instead of `[0-5]` and other ways to name seeds; None for what isn't under `seeds`."""
    match kind:
        case "int_type" | "int_from_float" if path[0] == "seeds" and _is_range(written):
            return f"write seeds: {written}, without brackets"
        case "tuple_type" if path == ("seeds",):
            return "write them as 0-5 or 0,3,7"
    return None


def _is_range(text: str) -> bool:
    try:
        return len(whole.seeds(text)) > 1
    except UsageError:
        return False


def _in_file(path: KeyPath) -> KeyPath:
    """Without the name of the sources' form, list or mapping."""
    return path[:1] + path[2:] if path[:1] == ("sources",) else path


_KIND = Kind(
    "scenario",
    Scenario,
    {(): Scenario, ("sources",): _KeysOfSources, ("similarity",): Similarity, ("guidance",): Guidance},
    _misuses,
    _in_file,
    _advice,
)
