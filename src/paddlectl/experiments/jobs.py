"""What can be asked for, and what is told of it meanwhile; plain values that cross processes."""

from dataclasses import dataclass

from paddlectl.scenario import Scenario


@dataclass(frozen=True)
class TrainJob:
    """Learn one source; `frames` None is the usual budget."""

    task: str
    seed: int
    frames: int | None = None


@dataclass(frozen=True)
class TransferJob:
    """Run a scenario once; `sources` are policy ids."""

    scenario: Scenario
    sources: tuple[str, ...]
    method: str
    seed: int
    frames: int


@dataclass(frozen=True)
class Progress:
    """How far a run is; the rates are over its latest episodes."""

    run: str
    frames: int
    total: int
    episodes: int
    success_rate: float
    mean_score: float
    note: str


Job = TrainJob | TransferJob
