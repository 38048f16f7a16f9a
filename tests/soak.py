"""The long tier of the reliability tests: `make soak`. Its counts go to benchmarks/soak.json.

python soak.py [--share 0.1] [--only NAME…]   trials at a share of the long tier, never below the short one
python soak.py NAME COUNT [SEED]              one trial; its counts as JSON on stdout, exit 1 if it fails
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
TESTS = Path(__file__).parent
sys.path[:0] = [str(TESTS), str(TESTS.parent / "src")]
RESULTS = TESTS.parent / "benchmarks" / "soak.json"


class Trial(NamedTuple):
    """A function of a count, a seed and a folder, which fails or gives its counts.

    Attributes:
        module: Its module in `trials`, where it has the trial's name.
        short: The count that every version is tested with, here if not in the test suite.
        long: The count before a release.
    """

    module: str
    short: int
    long: int


TRIALS = {
    "killed_writers": Trial("killed_writers", 200, 2000),
    "killed_care": Trial("killed_writers", 10, 200),
    "killed_runs": Trial("killed_runs", 20, 500),
    "stopped_runs": Trial("killed_runs", 10, 100),
    "stopped_commands": Trial("killed_runs", 10, 100),
    "killed_sweeps": Trial("killed_sweeps", 10, 50),
    "lost_nodes": Trial("lost_nodes", 6, 60),
    "lost_heads": Trial("lost_nodes", 4, 40),
    "orphans": Trial("lost_workers", 10, 100),
    "lost_workers": Trial("lost_workers", 10, 100),
    "stopped_every": Trial("equal_runs", 15, 250),
    "repeated_runs": Trial("equal_runs", 3, 20),
    "writers_at_once": Trial("crowds", 50, 500),
    "makers_at_once": Trial("crowds", 10, 200),
    "shared_folders": Trial("sharing", 10, 200),
    "live_readers": Trial("live", 200, 1000),
    "failing_writes": Trial("disks", 1, 20),
    "full_disk": Trial("disks", 50, 1000),
    "changed_files": Trial("changes", 2000, 100_000),
    "index_files": Trial("fuzz", 500, 20_000),
    "planted_faults": Trial("health", 41, 500),
    "healthy_registries": Trial("health", 100, 1000),
    "checked_bytes": Trial("health", 300, 3000),
    "yaml_files": Trial("fuzz", 20_000, 1_000_000),
    "programs": Trial("fuzz", 20_000, 1_000_000),
    "bundle_files": Trial("fuzz", 1000, 100_000),
    "command_lines": Trial("fuzz", 2000, 50_000),
}


def memory_folder() -> str | None:
    """Where files are kept in memory, if there is such a place: a killed process leaves the same there."""
    place = Path("/dev/shm")
    return str(place) if os.access(place, os.W_OK) else None


def tried(name: str, count: int, seed: int) -> dict[str, Any]:
    work = getattr(import_module(f"trials.{TRIALS[name].module}"), name)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        counts = work(count, seed, Path(folder))
    return {**counts, "seed": seed, "seconds": round(time.monotonic() - began, 1)}


def soaked(name: str, share: float) -> dict[str, Any]:
    """One trial in a process of its own, so that what it prints and its memory are its own."""
    _, short, long = TRIALS[name]
    count = max(short, round(long * share))
    print(f"{name} × {count:,}", file=sys.stderr, flush=True)
    line = [sys.executable, __file__, name, str(count), str(int.from_bytes(os.urandom(3)))]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    counts = json.loads(done.stdout) if done.returncode == 0 else {"failed": done.stderr[-1000:]}
    print(f"  {counts}", file=sys.stderr, flush=True)
    return {"count": count, **counts, "date": datetime.now(UTC).date().isoformat()}


def main() -> int:
    if sys.argv[1:2] == ["full_disk_within"]:  # by the trial itself, in its own file system
        count, seed, folder = sys.argv[2:]
        within = import_module("trials.disks").full_disk_within
        print(json.dumps(within(int(count), int(seed), Path(folder))))
        return 0
    if len(sys.argv) > 2 and sys.argv[1] in TRIALS:
        name, count, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3] if len(sys.argv) > 3 else 0)
        print(json.dumps(tried(name, count, seed)))
        return 0
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--share", type=float, default=1.0, help="of the long tier")
    parser.add_argument("--only", nargs="+", choices=TRIALS, default=list(TRIALS), metavar="NAME")
    options = parser.parse_args()
    results: dict[str, Any] = {"python": platform.python_version(), "machine": f"{os.cpu_count()} cores"}
    results |= {"trials": json.loads(RESULTS.read_text()).get("trials", {}) if RESULTS.exists() else {}}
    for name in options.only:
        found = soaked(name, options.share)
        known = results["trials"] | {name: found}
        results["trials"] = {each: known[each] for each in TRIALS if each in known}
        RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    return any("failed" in results["trials"][name] for name in options.only)


if __name__ == "__main__":
    sys.exit(main())
