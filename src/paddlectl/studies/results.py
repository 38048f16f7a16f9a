"""What is known of the finished cells of a study: a row each, as the registry or a file of results has it."""

import dataclasses
import fcntl
import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from paddlectl.errors import InvalidFileError
from paddlectl.experiments.curves import LearningCurve
from paddlectl.experiments.log import ended_episodes
from paddlectl.registry.files.objects import write_atomically
from paddlectl.registry.names import ELSEWHERE, shortened
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry

SUCCESS = 0.9
"""The share of 100 episodes that `frames_to_success` asks for."""
EPISODES = 50
"""Between two points of a curve over episodes."""
DIGITS = 4
MOST = 2**63
"""Numbers in a file of results are smaller."""


@dataclass(frozen=True)
class Result:
    """A run's figures and curve.

    Attributes:
        variant: What was changed against the scenario; empty if nothing was.
        run: `run-42`, in the registry that it was run in.
        code: The version of paddlectl that ran it, with its commit if it was a checkout.
        source_frames: Environment steps that its sources were trained with; they count for no method. None if
            one of them is in another registry.
        jump_start: As `LearningCurve.figures` has it, as are the next three: None of a run that is too short.
        frames_to_success: Until nine of ten among 100 episodes were solved; None if they never were.
        unseen_success: Share of the layouts that no training uses which its policy solves, as is the next.
        unseen_length: Mean length of those episodes.
        by_frames: Mean score of the latest 100 episodes, at 100 moments evenly spread from frame 0. [100]
        by_episodes: The same after every 50 episodes.
        cell: The `Cell.identity` of what it is in a study; empty if it was run in none.
    """

    scenario: str
    target: str
    method: str
    variant: str
    seed: int
    run: str
    code: str
    frames: int
    episodes: int
    seconds: float
    source_frames: int | None
    jump_start: float | None
    final_score: float | None
    final_success: float | None
    area_under_curve: float | None
    frames_to_success: int | None
    unseen_success: float
    unseen_length: float
    by_frames: tuple[float, ...]
    by_episodes: tuple[float, ...]
    cell: str = ""

    @property
    def has_figures(self) -> bool:
        """Whether the run was long enough to have any."""
        return self.area_under_curve is not None


def result_of(
    registry: Registry, record: RunRecord, scenario: str = "", variant: str = "", cell: str = ""
) -> Result:
    """The figures of a finished run; of the scenario that it ran, unless another shares it."""
    curve = LearningCurve(ended_episodes(registry, record.id, whole=True), record.frames)
    policy = registry.policy(record.policy or "")
    return Result(
        scenario=scenario or record.scenario or record.task,
        target=record.task,
        method=record.method,
        variant=variant,
        seed=record.seed,
        run=record.id,
        code=record.versions.get("paddlectl", ""),
        frames=record.frames,
        episodes=record.episodes,
        seconds=record.seconds,
        source_frames=_source_frames(registry, record),
        **curve.figures(),
        frames_to_success=curve.frames_to(SUCCESS),
        unseen_success=policy.success_rate,
        unseen_length=policy.mean_length,
        by_frames=tuple(round(score, DIGITS) for score in curve.by_frames()),
        by_episodes=tuple(round(score, DIGITS) for score in curve.by_episodes(EPISODES)),
        cell=cell,
    )


def _source_frames(registry: Registry, record: RunRecord) -> int | None:
    if any(source.startswith(ELSEWHERE) for source in record.sources):
        return None
    return sum(registry.policy(source).frames for source in record.sources)


def write_results(path: Path, results: Iterable[Result]) -> None:
    """Keeps results, a line each, for those who haven't the registry; a file that is there is replaced."""
    lines = ",\n".join(json.dumps(dataclasses.asdict(result), sort_keys=True) for result in results)
    write_atomically(path, f"[\n{lines}\n]\n".encode(), shared=False)


def change_results(path: Path, change: Callable[[Sequence[Result]], Iterable[Result]]) -> None:
    """Replaces what a file of results has, or will have, by what becomes of it; others who do so wait.

    Args:
        path: The file; it needn't be there.
        change: Gives the new results for those that are there now.

    Raises:
        InvalidFileError: If it isn't a file of results.
        OSError: If it can't be written.
    """
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        write_results(path, change(read_results(path) if path.exists() else ()))
    finally:
        os.close(folder)


def read_results(path: Path) -> list[Result]:
    """What `write_results` kept.

    Raises:
        InvalidFileError: If it isn't that.
    """
    try:
        return [*map(_result, _rows(json.loads(path.read_text(encoding="utf-8"))))]
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        told = f"{path}: not a file of results: {error}"
        raise InvalidFileError(told, "run: paddlectl sweep --help") from error


def _rows(value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        raise ValueError("it has no list of rows")
    return value


def _result(row: dict[str, Any]) -> Result:
    row = {"cell": "", **row}
    if wrong := sorted(row.keys() ^ _FIELDS):
        raise ValueError(f"a row lacks or adds {', '.join(wrong)}")
    for name, value in row.items():
        if not _fits(_FIELDS[name], value):
            raise ValueError(f"{name} can't be {shortened(repr(value))}")
    curves = {name: tuple(map(float, row[name])) for name in ("by_frames", "by_episodes")}
    return Result(**row | curves)


def _fits(kind: Any, value: Any) -> bool:
    """Whether the value, as JSON has it, is one of the field's kind."""
    if get_origin(kind) is tuple:
        return isinstance(value, list) and all(_fits(float, number) for number in value)
    if isinstance(value, int | float) and not (abs(value) < MOST and not isinstance(value, bool)):
        return False  # also what is infinite or no number
    kinds = get_args(kind) or (kind,)
    return isinstance(value, tuple(kinds) + ((int,) if float in kinds else ()))


_FIELDS = get_type_hints(Result)
