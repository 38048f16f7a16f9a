"""What can be asked for, and what is told of it meanwhile; plain values that cross processes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from paddlectl.scenario import Scenario
from paddlectl.tasks.suite import AnyTask


@dataclass(frozen=True)
class TrainJob:
    """Learn one source.

    Attributes:
        frames: None is the usual budget.
        changes: What shall differ from the method's usual settings, as `{"credit": {"planned": False}}`.
        preset: One of the method's for the task, instead of its usual settings.
        method: By which.
        name: What its run is called.
        tags: Of its run.
    """

    task: AnyTask
    seed: int
    frames: int | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    preset: str | None = None
    method: str = "hdm"
    name: str | None = None
    tags: tuple[str, ...] = ()


@dataclass(frozen=True)
class TransferJob:
    """Run a scenario once; `sources` are policy ids.

    Attributes:
        rules: By which sources are reused; None are those of the scenario.
        changes: As for a `TrainJob`, over those of the scenario; so are name and tags.
    """

    scenario: Scenario
    sources: tuple[str, ...]
    method: str
    seed: int
    frames: int
    rules: Any = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    name: str | None = None
    tags: tuple[str, ...] = ()


@dataclass(frozen=True)
class RandomJob:
    """Keep a policy that has learned nothing, as a source."""

    task: AnyTask
    seed: int


@dataclass(frozen=True)
class Progress:
    """How far a run is; the rates are over its latest 100 episodes in the order of their start.

    They are None as long as the first of them goes on.
    """

    run: str
    frames: int
    total: int
    episodes: int
    latest_success: float | None
    latest_score: float | None
    note: str


@dataclass(frozen=True)
class ResumeJob:
    """Go on with a run that was stopped."""

    run: str


Job = TrainJob | TransferJob | RandomJob | ResumeJob


class Begun(NamedTuple):
    """A job's run is in the registry now, and goes on."""

    run: str


class Note(NamedTuple):
    """What else the user should know, in a line."""

    text: str


class Failure(NamedTuple):
    """How a job ended that has no row; `run` is None if it had none yet."""

    run: str | None
    error: Exception


Row = dict[str, Any]
Outcome = Row | Failure
Event = Begun | Progress | Note | Outcome
"""What is told of a job; its outcome comes last."""
