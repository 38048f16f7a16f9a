"""Small settings for a transfer, and a transfer in a process of its own:

python small_transfer.py REGISTRY MODE SEED POLICY... prints the SHA-256 of the learned checkpoint.
"""

import sys
from typing import Any

from paddlectl.experiments import sources, transfers
from paddlectl.experiments.jobs import TransferJob
from paddlectl.hybrid.policy import settings_for
from paddlectl.registry.store import Registry
from paddlectl.scenario import Guidance, Scenario

FRAMES = 8192
TARGET = "BlockedBoxUnlockPickup"
CHANGES = (
    (
        transfers,
        "settings_for",
        lambda task, *changes: settings_for(task, *changes, {"lanes": 8, "low_level": {"epochs": 1}}),
    ),
    (transfers, "WINDOW", 10),
    (sources, "EVALUATION_EPISODES", 8),
)
"""Eight lanes, so that a few thousand frames hold a few dozen episodes."""


def job(
    policies: tuple[str, ...], mode: str, method: str = "paddle", seed: int = 0, frames: int = FRAMES
) -> TransferJob:
    scenario = Scenario(
        name="A",
        target=TARGET,
        sources=("BlockedDoor", "GapBall"),
        guidance=Guidance.model_validate({"mode": mode}),
    )
    return TransferJob(scenario, policies, method, seed, frames)


def main(location: str, mode: str, seed: str, *policies: str) -> None:
    for module, name, value in CHANGES:
        setattr(module, name, value)
    with Registry.open(location) as registry:
        row: dict[str, Any] = transfers.run_transfer(
            job(policies, mode, seed=int(seed)), registry, lambda _: None
        )
        print(registry.policy(row["policy"]).checkpoint)


if __name__ == "__main__":
    import torch

    torch.set_num_threads(1)
    main(*sys.argv[1:])
