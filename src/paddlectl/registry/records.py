"""What the registry holds, as plain frozen values."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

RUN_STATES = ("running", "finished", "failed", "interrupted")

RECORDINGS = "recordings"
"""The document of a run that has the episodes which can be played again."""

DEFINITION = "definition"
"""Under which a run's settings and a policy's metadata keep what a task file said of their task."""


Methods: TypeAlias = str | tuple[str, ...] | None
"""By which policies were learned: one, any of several, or whichever."""


class Content(NamedTuple):
    """A task by what it is: files may give one name to several.

    Attributes:
        definition: What its file says; None of a task that is found by its name.
    """

    name: str
    definition: Mapping[str, Any] | None = None

    @property
    def identity(self) -> str:
        """The same for tasks that are the same: their summaries don't matter."""
        told = None if self.definition is None else {**self.definition, "summary": None}
        return json.dumps([self.name, told], sort_keys=True)


@dataclass(frozen=True)
class RunRecord:
    """One run of one method with one seed.

    Attributes:
        id: `run-42`.
        kind: `train` or `transfer`.
        method: `hdm`, `paddle`, …
        task: The task learned; a transfer's target.
        scenario: Name of the scenario; None for a source.
        sources: Policy ids that the run could reuse.
        status: One of RUN_STATES.
        settings: Every setting as resolved, JSON-able.
        versions: Of Python, the packages, the platform, and the thread count.
        frames: Environment steps taken; 0 until told.
        results: Figures of the run (success_rate, final_success, jump_start, …); empty until finished.
            `success_rate` is of its policy on unseen layouts.
        policy: Id of the policy that came out of it, if any.
        created: ISO 8601, UTC, as `finished`.
        resumes: How often it was resumed after it had stopped.
        name: What its user calls it, instead of its id; of one run at most.
        tags: What its user finds it by, with others.
    """

    id: str
    kind: str
    method: str
    task: str
    scenario: str | None
    sources: tuple[str, ...]
    seed: int
    status: str
    settings: dict[str, Any]
    versions: dict[str, str]
    frames: int
    episodes: int
    seconds: float
    results: dict[str, Any]
    policy: str | None
    created: str
    finished: str | None
    resumes: int = 0
    name: str | None = None
    tags: tuple[str, ...] = ()

    @property
    def content(self) -> Content:
        """Its task as it was when the run began."""
        return content_of(self.task, self.settings)


@dataclass(frozen=True)
class PolicyRecord:
    """A learned policy.

    Attributes:
        id: `policy-7`.
        run: The run that made it.
        program: Its clause program as text (`logic.syntax`); None of a method without clauses.
        checkpoint: SHA-256 of its safetensors object.
        success_rate: On unseen layouts at the end of training, as are the scores and lengths.
        crispness: Smallest best-clause probability over the scenes on its path; None likewise.
    """

    id: str
    run: str
    task: str
    domain: str
    method: str
    seed: int
    frames: int
    program: str | None
    checkpoint: str
    success_rate: float
    mean_score: float
    mean_length: float
    crispness: float | None
    created: str
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def content(self) -> Content:
        """Its task as it was when the policy was learned."""
        return content_of(self.task, self.metadata)


def content_of(task: str, kept: Mapping[str, Any]) -> Content:
    """A task by its name and by what is kept with a run or policy."""
    definition = kept.get(DEFINITION)
    return Content(task, definition if isinstance(definition, Mapping) else None)


class StoredProgram(NamedTuple):
    """The clause program of a policy, with what tells whether the policy is a good one of its task."""

    policy: str
    task: Content
    program: str
    success_rate: float
    mean_score: float


class Label(NamedTuple):
    """What is needed to tell a run or policy from others in a list."""

    id: str
    method: str
    task: str
    name: str | None = None
