"""A registry with a bit of everything, written by its own interface."""

from typing import Any

import numpy as np
import safetensors.numpy

from paddlectl.registry.records import PolicyRecord, RunRecord
from paddlectl.registry.store import Registry

ARRAYS = safetensors.numpy.save({"x": np.arange(1000.0)})


class Filler:
    """Adds runs and policies with only what a test cares about."""

    def __init__(self, registry: Registry) -> None:
        self.registry = registry

    def run(self, **given: Any) -> RunRecord:
        plain = {"kind": "train", "method": "hdm", "task": "BoxDoor", "scenario": None, "sources": []}
        rest = {"seed": 0, "settings": {"lanes": 64}, "versions": {"python": "3.11"}}
        return self.registry.add_run(**plain | rest | given)

    def policy(self, run: str, **given: Any) -> PolicyRecord:
        plain = {"task": "BoxDoor", "domain": "minigrid", "method": "hdm", "seed": 0, "frames": 1000}
        text = {"program": "0.98 :: gt_key() :- !has_key(agent)\n", "checkpoint": b"weights", "metadata": {}}
        figures = {"success_rate": 0.5, "mean_score": 0.4, "mean_length": 30.0, "crispness": 0.9}
        return self.registry.add_policy(run=run, **plain | text | figures | given)

    def all_kinds(self) -> None:
        """Two finished runs with a policy each, and one interrupted with two checkpoints."""
        end = {"frames": 10, "episodes": 2, "seconds": 1.5, "results": {}}
        for number in (1, 2):
            self.run()
            name = f"run-{number}"
            self.registry.files.append_rows(name, "episodes", [{"order": i} for i in range(50)])
            self.registry.files.write_document(name, "mapping", {"target": "T"})
            self.policy(name, checkpoint=ARRAYS[:-8] + bytes([number] * 8))
            self.registry.finish_run(name, status="finished", **end)
        self.run(kind="transfer", sources=["policy-1"])
        for frames in (1, 2):
            self.registry.files.append_rows("run-3", "episodes", [{"order": frames}])
            self.registry.files.save_checkpoint(
                "run-3", {"frames": frames}, ARRAYS[:-8] + bytes([frames] * 8)
            )
        self.registry.finish_run("run-3", status="interrupted", **end)
