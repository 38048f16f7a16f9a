"""What a figure of weights shows: Λ of each policy in the scenes that come up most, over training."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from paddlectl.agents.base import TARGET_NAME
from paddlectl.errors import IntegrityError
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report.mapping import scene_text
from paddlectl.report.panels import Panel, Series, mean_line

MOST_SCENES = 6
"""Panels for each scenario."""

Weights = dict[tuple[int, str], dict[int, float]]


class Watched(NamedTuple):
    """What runs of one scenario recorded.

    Attributes:
        bodies: Of the target's scenes, as texts.
        met: Scene -> how often somebody led there.
        runs: Λ by scene and task of the policy, then by frames, for each run.
    """

    bodies: Sequence[Sequence[str]]
    met: Counter[int]
    runs: Sequence[Weights]


def weight_panels(registry: Registry, runs: Mapping[str, Sequence[RunRecord]]) -> list[Panel]:
    """For each scenario the scenes that came up most, a line for each policy.

    Args:
        registry: Where the runs are.
        runs: Those of each scenario.
    """
    return [
        _panel(scenario, watched, scene)
        for scenario, records in runs.items()
        for watched in [_watched(registry, records)]
        for scene in sorted(scene for scene, _ in watched.met.most_common(MOST_SCENES))
    ]


def _panel(scenario: str, watched: Watched, scene: int) -> Panel:
    policies = dict.fromkeys(policy for run in watched.runs for at, policy in run if at == scene)
    series = tuple(
        _series(policy, [run.get((scene, policy), {}) for run in watched.runs]) for policy in policies
    )
    return Panel(scenario, scene_text(watched.bodies[scene]), "frames", "Λ", series)


def _series(policy: str, runs: Sequence[Mapping[int, float]]) -> Series:
    """Over the runs that met the scene, from where all of them had; between two moments Λ stays as it was."""
    known = [run for run in runs if run]
    moments = sorted({frames for run in known for frames in run})
    shown = [frames for frames in moments if frames >= max(min(run) for run in known)]
    curves = np.array([[_at(run, frames) for frames in shown] for run in known])
    return mean_line(policy, np.array(shown, float), curves)


def _at(run: Mapping[int, float], frames: int) -> float:
    return run[max(at for at in run if at <= frames)]


def _watched(registry: Registry, records: Sequence[RunRecord]) -> Watched:
    met: Counter[int] = Counter()
    runs, bodies = [], []
    for record in records:
        tasks = {source: registry.policy(source).task for source in record.sources}
        weights: Weights = {}
        try:
            mapping: Any = registry.files.read_document(record.id, "mapping")
            bodies = [tuple(map(str, scene["body"])) for scene in mapping["scenes"]]
            scenes = range(len(bodies))
            for row in registry.files.read_rows(record.id, "moments"):
                scene, policy = scenes[scenes.index(row["scene"])], tasks.get(row["policy"], TARGET_NAME)
                weights.setdefault((scene, policy), {})[int(row["frames"])] = float(row["weight"])
                met[scene] += int(row["chosen"])
        except (KeyError, TypeError, ValueError) as error:
            raise IntegrityError(
                f"the weights of {record.id} aren't what a run writes", "run: paddlectl registry check"
            ) from error
        runs.append(weights)
    return Watched(bodies, met, runs)
