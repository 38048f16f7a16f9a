"""What the registry holds, as plain frozen values."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

RUN_STATES = ("running", "finished", "failed", "interrupted")


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


class Label(NamedTuple):
    """What is needed to tell a run or policy from others in a list."""

    id: str
    method: str
    task: str
