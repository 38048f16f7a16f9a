"""Steps a second of the batched engine against the MiniGrid face, in turns; prints JSON.

An engine step is all that a learner needs: step, valuation, observation, subgoals reached, and new layouts
for the lanes that finished. A MiniGrid step makes MiniGrid's own observation. Both act at random.

    OMP_NUM_THREADS=1 python benchmarks/engine_speed.py --task BlockedBoxUnlockPickup --lanes 1024
"""

import argparse
import json
import platform
import time
from collections.abc import Callable
from statistics import median

import numpy as np

from paddlectl.tasks import suite
from paddlectl.tasks.minigrid.env import PaddleEnv


def engine_steps(task: str, num_envs: int, seconds: float) -> float:
    """Steps a second of all lanes together."""
    env = suite.load(task).make(num_envs, 0)
    rng = np.random.default_rng(0)
    actions = rng.integers(env.actions.size, size=(64, num_envs))
    subgoals = rng.integers(len(suite.load(task).domain_subgoals), size=(64, num_envs))

    def run(i: int) -> int:
        step = env.step(actions[i % 64])
        env.valuation()
        env.observe(subgoals[i % 64])
        env.reached(subgoals[i % 64])
        finished = step.terminated | step.truncated
        if finished.any():
            env.reset(finished)
        return num_envs

    return _rate(run, seconds)


def minigrid_steps(task: str, seconds: float) -> float:
    """Steps a second of one MiniGrid environment."""
    env = PaddleEnv(task)
    env.reset(seed=0)
    actions = np.random.default_rng(0).integers(7, size=1024).tolist()

    def run(i: int) -> int:
        *_, terminated, truncated, _ = env.step(actions[i % 1024])
        if terminated or truncated:
            env.reset()
        return 1

    return _rate(run, seconds)


def _rate(run: Callable[[int], int], seconds: float) -> float:
    for i in range(20):
        run(i)
    start, steps, i = time.perf_counter(), 0, 0
    while time.perf_counter() - start < seconds:
        steps += run(i)
        i += 1
    return steps / (time.perf_counter() - start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", default="BlockedBoxUnlockPickup", choices=suite.names())
    parser.add_argument("--lanes", type=int, default=1024)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat and face")
    options = parser.parse_args()
    rows = [
        (
            engine_steps(options.task, options.lanes, options.seconds),
            minigrid_steps(options.task, options.seconds),
        )
        for _ in range(options.repeats)
    ]
    result = {
        "task": options.task,
        "lanes": options.lanes,
        "engine_steps_per_second": round(median(engine for engine, _ in rows)),
        "minigrid_steps_per_second": round(median(minigrid for _, minigrid in rows)),
        "ratio": round(median(engine / minigrid for engine, minigrid in rows), 1),
        "ratios": [round(engine / minigrid, 1) for engine, minigrid in rows],
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
