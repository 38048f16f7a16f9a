"""Makes what this version leaves to be read for ever: `python freeze.py`, once for each release.

- `registry/bundles/BoxDoor-<schema>.zip.gz`: a policy that has learned BoxDoor, exported. Its networks have
  32 units a layer, and zeros up to the usual number, so that it is small when compressed.
- `registry/bundles/BoxDoor-soft-<schema>.zip.gz`: the same by other settings than the usual ones.
- `registry/released/<schema>`: the first schema's registry as this version has upgraded it.

What is there already is left as it is. `python freeze.py runs` records anew how the small seeded runs end,
`experiments/seeded_runs.json`: whenever learning itself was changed.
"""

import gzip
import json
import shutil
import sqlite3
import sys
import tempfile
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import torch

from paddlectl.experiments import runner
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.policies import keep
from paddlectl.experiments.runner import train_source
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.learners import ppo
from paddlectl.registry.bundles import bundles
from paddlectl.registry.schema import REVISIONS
from paddlectl.registry.store import Registry
from released import BUNDLES, RELEASED, rebuilt
from trials.runs import SEEDED, add_sources, begin, digest, ended, machine, small

RECORDED = Path(__file__).parent / "experiments" / "seeded_runs.json"
UNITS = 32
POLICIES: dict[str, dict[str, Any]] = {
    "BoxDoor": {},
    "BoxDoor-soft": {"sharpness": 1.0, "low_level": {"sharpness": 1.0}, "decisions": {"max_steps": 40}},
}
"""Name -> what differs from the usual settings, all of it in how the policy plays."""


def freeze_policy(name: str, place: Path) -> None:
    frozen = BUNDLES / f"{name}-{REVISIONS[-1]}.zip.gz"
    if frozen.exists():
        return
    mlp = ppo.mlp

    def keep_padded(registry: Registry, run: Any, policy: HybridPolicy, log: Any) -> Any:
        with mock.patch.object(ppo, "mlp", mlp):
            usual = HybridPolicy(policy.task, 0, policy.settings)
        learned = policy.state()
        usual.load({name: _padded(learned[name], tensor) for name, tensor in usual.state().items()})
        return keep(registry, run, usual, log)

    registry = Registry.open(place / "registry")
    with (
        mock.patch.object(ppo, "mlp", partial(mlp, hidden=(UNITS,) * 3)),
        mock.patch.object(runner, "keep", keep_padded),
    ):
        job = TrainJob("BoxDoor", 0, changes=POLICIES[name])
        row = train_source(job, registry, lambda progress: print(progress.note, end="\r"))
    print(row)
    bundles.export(registry, row["policy"], place / "policy.zip")
    frozen.write_bytes(gzip.compress((place / "policy.zip").read_bytes(), 9, mtime=0))


def _padded(small: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """The same numbers in a larger tensor of zeros."""
    large = torch.zeros_like(like)
    large[tuple(slice(0, length) for length in small.shape)] = small
    return large


def freeze_registry(place: Path) -> None:
    """Runs that go on have empty folders, which git doesn't keep: hence `.keep`."""
    frozen = RELEASED / REVISIONS[-1]
    if frozen.exists():
        return
    old = rebuilt("0001", place / "old")
    Registry.open(old)
    shutil.copytree(old, frozen, ignore=shutil.ignore_patterns("registry.*"))
    for run in (frozen / "runs").iterdir():
        if not any(run.iterdir()):
            (run / ".keep").touch()
    with closing(sqlite3.connect(old / "registry.db")) as connection:
        (frozen / "registry.sql").write_text("\n".join(connection.iterdump()) + "\n")


def record_runs(place: Path) -> None:
    recorded: dict[str, Any] = {"machine": machine()}
    with small():
        registry = Registry.open(place / "registry")
        add_sources(registry)
        for kind in SEEDED:
            recorded[kind] = digest(ended(registry, begin(kind, registry, Checkpointer())["run"]))
    RECORDED.write_text(json.dumps(recorded, indent=2) + "\n")


if __name__ == "__main__":
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        if sys.argv[1:] == ["runs"]:
            record_runs(Path(folder))
            sys.exit()
        freeze_registry(Path(folder))
        for name in POLICIES:
            freeze_policy(name, Path(folder) / name)
