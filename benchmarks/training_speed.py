"""Frames a second of one training process, its peak memory, and the time outside the networks; prints JSON.

The process does what `paddlectl train` does in it: engine, decisions, both updates, crispness, the run's
tables. The first round, in which everything is made and warmed up, isn't counted. Time inside the networks
is the time in `PPO.act` and `PPO.update`. What the networks do with it is told by PyTorch's profiler in a few
more rounds: each operation's share of the time in all of them.

    OMP_NUM_THREADS=1 python benchmarks/training_speed.py --rounds 20 --write
"""

import argparse
import functools
import json
import platform
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from paddlectl.agents.interaction import Learning
from paddlectl.experiments.jobs import Progress, TrainJob
from paddlectl.experiments.runner import train_source
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.learners.ppo import PPO
from paddlectl.methods.base import Setup
from paddlectl.methods.hdm import HDM
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite

OUTPUT = Path(__file__).with_suffix(".json")


class Clock:
    """When each round ended, and the time spent so far in the functions it times."""

    def __init__(self) -> None:
        self.inside = 0.0
        self.rounds: list[tuple[int, float, float]] = []  # frames, time, time inside

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapped(*args: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args)
            finally:
                self.inside += time.perf_counter() - start

        return wrapped

    def round_ended(self, progress: Progress) -> None:
        self.rounds.append((progress.frames, time.perf_counter(), self.inside))


def measure(task: str, rounds: int) -> dict[str, Any]:
    """Trains for that many counted rounds in a registry that is thrown away."""
    torch.set_num_threads(1)
    clock = Clock()
    settings = HybridSettings()
    PPO.act = clock.timed(PPO.act)  # type: ignore[method-assign]
    PPO.update = clock.timed(PPO.update)  # type: ignore[method-assign]
    with tempfile.TemporaryDirectory() as folder, Registry.open(folder) as registry:
        frames = (rounds + 1) * settings.num_envs * settings.rollout_steps
        train_source(TrainJob(task, 0, frames), registry, clock.round_ended)
    (frames_before, began, inside_before), *_, (frames, ended, inside) = clock.rounds
    seconds = ended - began
    return {
        "task": task,
        "frames": frames - frames_before,
        "seconds": round(seconds, 2),
        "frames_per_second": round((frames - frames_before) / seconds),
        "share_outside_networks": round(1 - (inside - inside_before) / seconds, 3),
        "peak_memory_mib": round(_peak_memory() / 2**20),
        "seed": 0,
        "threads": torch.get_num_threads(),
        "hidden": [layer.out_features for layer in _linear_layers()][:-1],
        "epochs": settings.low_level.epochs,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "machine": _cpu(),
    }


def profile(task: str, rounds: int = 3, most: int = 12) -> dict[str, float]:
    """The operations that take the largest shares of PyTorch's time."""
    torch.set_num_threads(1)
    settings = HybridSettings()
    loaded, frames = suite.load(task), (rounds + 1) * settings.num_envs * settings.rollout_steps
    agent = HDM.make(Setup(loaded, settings, 0, frames))
    trained = Learning(loaded.make(settings.num_envs, 0), agent, frames)
    next(trained)
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CPU]) as profiled:
        for _ in trained:
            pass
    times = {event.key: event.self_cpu_time_total for event in profiled.key_averages()}
    largest = sorted(times, key=times.__getitem__, reverse=True)[:most]
    return {key: round(times[key] / sum(times.values()), 3) for key in largest}


def _linear_layers() -> list[torch.nn.Linear]:
    return [layer for layer in PPO(1, 1, 0).actor if isinstance(layer, torch.nn.Linear)]


def _peak_memory() -> int:
    """Bytes; Linux tells kibibytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]}, {len(names)} cores" if names else platform.processor()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", default="BoxDoor", choices=suite.names())
    parser.add_argument("--rounds", type=int, default=20, help="counted rounds, 1 at least")
    parser.add_argument("--write", action="store_true", help=f"to {OUTPUT.name} as well")
    options = parser.parse_args()
    measured = measure(options.task, max(1, options.rounds)) | {"profile": profile(options.task)}
    result = json.dumps(measured, indent=2)
    print(result)
    if options.write:
        OUTPUT.write_text(result + "\n")


if __name__ == "__main__":
    main()
