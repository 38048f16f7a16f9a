"""Makes what this version leaves to be read for ever: `python freeze.py`, once for each release.

- `registry/bundles/BoxDoor-<schema>.zip.gz`: a policy that has learned BoxDoor, exported. Its networks have
  32 units a layer, and zeros up to the usual number, so that it is small when compressed.
- `registry/released/<schema>`: the first schema's registry as this version has upgraded it.
"""

import gzip
import shutil
import sqlite3
import tempfile
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import torch

from paddlectl.experiments import sources
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.sources import keep, train_source
from paddlectl.hybrid.policy import HybridPolicy
from paddlectl.learners import ppo
from paddlectl.registry import bundles
from paddlectl.registry.schema import REVISIONS
from paddlectl.registry.store import Registry
from released import BUNDLES, RELEASED, rebuilt

UNITS = 32


def freeze_policy(place: Path) -> None:
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
        mock.patch.object(sources, "keep", keep_padded),
    ):
        row = train_source(TrainJob("BoxDoor", 0), registry, lambda progress: print(progress.note, end="\r"))
    print(row)
    bundles.export(registry, row["policy"], place / "policy.zip")
    frozen = gzip.compress((place / "policy.zip").read_bytes(), 9, mtime=0)
    (BUNDLES / f"BoxDoor-{REVISIONS[-1]}.zip.gz").write_bytes(frozen)


def _padded(small: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """The same numbers in a larger tensor of zeros."""
    large = torch.zeros_like(like)
    large[tuple(slice(0, length) for length in small.shape)] = small
    return large


def freeze_registry(place: Path) -> None:
    """Runs that go on have empty folders, which git doesn't keep: hence `.keep`."""
    old, frozen = rebuilt("0001", place / "old"), RELEASED / REVISIONS[-1]
    Registry.open(old)
    shutil.copytree(old, frozen, ignore=shutil.ignore_patterns("registry.*"))
    for run in (frozen / "runs").iterdir():
        if not any(run.iterdir()):
            (run / ".keep").touch()
    with closing(sqlite3.connect(old / "registry.db")) as connection:
        (frozen / "registry.sql").write_text("\n".join(connection.iterdump()) + "\n")


if __name__ == "__main__":
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        freeze_registry(Path(folder))
        freeze_policy(Path(folder))
