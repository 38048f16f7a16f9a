"""Small settings for a transfer, and a transfer in a process of its own:

python small_transfer.py REGISTRY MODE SEED POLICY... prints the SHA-256 of the learned checkpoint, and
whether that loaded torch's compiler.
"""

import sys
from collections.abc import Mapping
from typing import Any

from paddlectl.agents import recording
from paddlectl.experiments import policies
from paddlectl.experiments.jobs import TransferJob
from paddlectl.experiments.runner import run_transfer
from paddlectl.methods import finetune
from paddlectl.registry.store import Registry
from paddlectl.scenario import Guidance, Scenario

FRAMES = 21 * 256  # rounds; two episodes of each lane at least
TARGET = "BlockedBoxUnlockPickup"
SMALL = {"num_envs": 8, "rollout_steps": 32, "low_level": {"epochs": 1}}
"""Eight lanes, so that a few thousand frames hold a few dozen episodes."""

SHORT = ((recording, "EARLY", 8), (finetune, "TRIALS", 2), (policies, "EVALUATION_EPISODES", 8))
"""Module, name and value: what is shorter, too."""


def job(
    reused: tuple[str, ...],
    mode: str,
    method: str = "paddle",
    seed: int = 0,
    frames: int = FRAMES,
    changes: Mapping[str, Any] = SMALL,
) -> TransferJob:
    scenario = Scenario(
        name="A",
        target=TARGET,
        sources=("BlockedDoor", "GapBall"),
        guidance=Guidance.model_validate({"mode": mode}),
    )
    return TransferJob(scenario, reused, method, seed, frames, changes=changes)


def main(location: str, mode: str, seed: str, *reused: str) -> None:
    for module, name, value in SHORT:
        setattr(module, name, value)
    with Registry.open(location) as registry:
        row: dict[str, Any] = run_transfer(job(reused, mode, seed=int(seed)), registry, lambda _: None)
        print(registry.policy(row["policy"]).checkpoint, "torch._dynamo" in sys.modules)


if __name__ == "__main__":
    import torch

    torch.set_num_threads(1)
    main(*sys.argv[1:])
