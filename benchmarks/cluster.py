"""What a Ray cluster costs: the same study by `sweep --jobs N`, and on a cluster of N CPUs of this machine.

    python benchmarks/cluster.py [--cells 8] [--frames 120000] [--jobs 2] [--times 3]

It needs Ray: `pip install 'paddlectl[ray]'`. Wall seconds of the whole command; the cluster has been started
before, as clusters are. Both take turns. The result goes into benchmarks/cluster.json. The overhead should be
5 % at most where a run takes a minute, so the frames are to be chosen for that.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "tests"))

from nodes import nodes  # noqa: E402
from paddlectl.experiments.log import versions  # noqa: E402
from paddlectl.studies.results import read_results  # noqa: E402

BAR = 5.0  # per cent
STUDY = """
name: cluster
scenarios: [{root}/scenarios/A.yaml]
methods: [hdm]
seeds: 0-{last}
frames: {frames}
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=8)
    parser.add_argument("--frames", type=int, default=120_000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--times", type=int, default=3)
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    seconds: dict[str, list[float]] = {"home": [], "ray": []}
    runs: dict[str, list[float]] = {"home": [], "ray": []}
    with tempfile.TemporaryDirectory() as folder, nodes(1, options.jobs) as cluster:
        study = Path(folder) / "study.yaml"
        study.write_text(
            STUDY.format(root=HERE.parent, last=options.cells - 1, frames=options.frames), encoding="utf-8"
        )
        ways = {"home": ["--jobs", str(options.jobs)], "ray": ["--on", cluster.address]}
        for number in range(options.times):
            for name, way in ways.items():
                place = Path(folder) / f"{name}-{number}"
                seconds[name].append(took(study, place, way))
                runs[name] += [row.seconds for row in read_results(place.with_suffix(".json"))]
                print(f"{name:<5} {seconds[name][-1]:.1f} s", flush=True)
    told = summary(seconds, runs) | vars(options) | {"versions": versions(), "machine": platform.machine()}
    (HERE / "cluster.json").write_text(json.dumps(told, indent=1) + "\n")
    print(f"overhead {told['overhead_percent']} % with runs of {told['run_seconds']['home']} s; bar {BAR} %")


def took(study: Path, place: Path, way: list[str]) -> float:
    """Wall seconds of a sweep into a new registry."""
    line = [sys.executable, "-m", "paddlectl", "sweep", str(study), "--registry", str(place), *way]
    began = time.perf_counter()
    subprocess.run(
        [*line, "--results", str(place.with_suffix(".json"))], check=True, capture_output=True, text=True
    )
    return time.perf_counter() - began


def summary(seconds: dict[str, list[float]], runs: dict[str, list[float]]) -> dict[str, Any]:
    """Medians, and by how much the one with Ray is longer."""
    home, ray = (statistics.median(seconds[name]) for name in ("home", "ray"))
    return {
        "overhead_percent": round(100 * (ray / home - 1), 1),
        "seconds": {name: [round(each, 1) for each in found] for name, found in seconds.items()},
        "run_seconds": {name: round(statistics.median(found), 1) for name, found in runs.items()},
    }


if __name__ == "__main__":
    main()
