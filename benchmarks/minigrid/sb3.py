"""Stable-Baselines3's PPO on MiniGrid's own tasks, on the state that the method `ppo` sees: the full grid.

OMP_NUM_THREADS=1 python benchmarks/minigrid/sb3.py [--frames 500000]

With the numbers and networks of `ppo`, as in benchmarks/sb3_reference.py. The result, a row a task and seed,
goes into benchmarks/minigrid/sb3.json; rows that are there are kept.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from sb3_reference import Rounds, made_with, on_engine, recent_success  # noqa: E402
from torch import set_num_threads  # noqa: E402

TARGETS = (
    "MiniGrid-BlockedUnlockPickup-v0",
    "MiniGrid-ObstructedMaze-1Dlhb-v0",
    "MiniGrid-KeyCorridorS4R3-v0",
)
SEEDS = (10, 11, 12)
RESULT = HERE / "sb3.json"


def learned(task: str, seed: int, frames: int) -> dict[str, Any]:
    """How many episodes it solved, of all and of the latest 100 by their start."""
    model, began = on_engine(seed, task), time.perf_counter()
    model.learn(frames, Rounds())
    episodes = model.env.episodes
    return {
        "task": task,
        "seed": seed,
        "frames": model.num_timesteps,
        "seconds": round(time.perf_counter() - began, 1),
        "episodes": len(episodes),
        "solved": sum(episode.score > 0 for episode in episodes),
        "latest_success": recent_success(episodes),
        **made_with(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--frames", type=int, default=500_000)
    frames = parser.parse_args().frames
    set_num_threads(1)
    rows = json.loads(RESULT.read_text()) if RESULT.exists() else []
    for task in TARGETS:
        for seed in SEEDS:
            if not any((row["task"], row["seed"]) == (task, seed) for row in rows):
                rows.append(learned(task, seed, frames))
                RESULT.write_text(json.dumps(rows, indent=1) + "\n")
            row = next(row for row in rows if (row["task"], row["seed"]) == (task, seed))
            told = f"{row['solved']} of {row['episodes']} episodes solved, latest {row['latest_success']}"
            print(f"{task} seed {seed}, {row['frames']:,} frames, {row['seconds']} s: {told}", flush=True)


if __name__ == "__main__":
    main()
