"""How long commands take in a registry of many runs, as whole processes, beside a bare Typer command.

python benchmarks/start_up.py

Wall and CPU seconds, the least of some calls, so that other work on the machine counts little. The result
goes into benchmarks/start_up.json.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from paddlectl.experiments.log import versions
from paddlectl.registry.store import Registry

HERE = Path(__file__).parent
BARE = """
import typer
app = typer.Typer()
@app.command()
def one(name: str = "x") -> None: print(name)
@app.command()
def other() -> None: pass
app()
"""
REAL = (
    "train BlockedDoor GapBall --frames 2048",
    "transfer scenarios/A.yaml --frames 4096",
)
ASKED = (
    "--help",
    "runs",
    "runs --task BoxDoor --status finished --limit 20",
    "policies",
    "show run-3",
    "show policy-1",
    "explain run-3",
    "registry gc --json",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--calls", type=int, default=10)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "registry"
        os.environ["PADDLECTL_REGISTRY"] = str(place)
        for line in REAL:
            called(command(line))
        fill(place, options.runs - 3)
        rows = {"bare Typer": measured([sys.executable, "-c", BARE, "one"], options.calls)}
        rows |= {line: measured(command(line), options.calls) for line in ASKED}
    told = {"runs": options.runs, "calls": options.calls, "seconds": rows, "versions": versions()}
    (HERE / "start_up.json").write_text(json.dumps(told, indent=1) + "\n")
    for line, row in rows.items():
        print(f"{line:<50} {row['wall']:.2f} s wall  {row['cpu']:.2f} s CPU")


def command(line: str) -> list[str]:
    return [sys.executable, "-m", "paddlectl", *line.split()]


def fill(place: Path, count: int) -> None:
    """Adds finished runs, each with its policy."""
    with Registry.open(place) as registry:
        real = registry.run("run-1")
        policy = registry.policy("policy-1")
        for seed in range(count):
            run = registry.add_run(
                kind="train",
                method="hdm",
                task="BoxDoor",
                scenario=None,
                sources=[],
                seed=seed,
                settings=real.settings,
                versions=real.versions,
            )
            registry.add_policy(
                run=run.id,
                task="BoxDoor",
                domain=policy.domain,
                method="hdm",
                seed=seed,
                frames=policy.frames,
                program=policy.program,
                checkpoint=seed.to_bytes(8),
                metadata=policy.metadata,
                success_rate=0.5,
                mean_score=0.5,
                mean_length=30.0,
                crispness=0.9,
            )
            registry.finish_run(
                run.id, status="finished", frames=2048, episodes=50, seconds=1.0, results=real.results
            )


def measured(line: list[str], calls: int) -> dict[str, float]:
    """The least wall and CPU seconds of some calls."""
    seconds = [called(line) for _ in range(calls)]
    return {name: round(min(each[name] for each in seconds), 3) for name in ("wall", "cpu")}


def called(line: list[str]) -> dict[str, Any]:
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(line, cwd=HERE.parent, check=True, capture_output=True)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"wall": wall, "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}


if __name__ == "__main__":
    main()
