"""The long tier of the reliability tests: `make soak`. Its counts go to benchmarks/soak.json.

python soak.py [--share 0.1]         everything, at the counts of the long tier or a share of them
python soak.py NAME COUNT [SEED]     one trial; its counts as JSON on stdout, exit 1 if it fails
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
TESTS = Path(__file__).parent
sys.path[:0] = [str(TESTS), str(TESTS.parent / "src")]
RESULTS = TESTS.parent / "benchmarks" / "soak.json"
FIRST_SCHEMA = TESTS / "registry" / "released" / "0001"

Trial = Callable[[int, int, Path], dict[str, Any]]


def _killed_runs(count: int, seed: int, folder: Path) -> dict[str, Any]:
    import torch

    from trials.killed_runs import killed_runs

    torch.set_num_threads(1)
    return killed_runs(count, seed, folder / "registry")


def _stopped_runs(count: int, seed: int, folder: Path) -> dict[str, Any]:
    import torch

    from trials.killed_runs import stopped_runs

    torch.set_num_threads(1)
    return stopped_runs(count, seed, folder / "registry")


def _killed_writers(count: int, seed: int, folder: Path) -> dict[str, Any]:
    from trials.killed_writers import killed_writers

    return killed_writers(count, seed, folder / "registry")


def _killed_care(count: int, seed: int, folder: Path) -> dict[str, Any]:
    from released import rebuilt
    from trials.killed_writers import killed_care

    return killed_care(count, seed, folder, rebuilt("0001", folder / "first"))


def _disks(name: str) -> Trial:
    def trial(count: int, seed: int, folder: Path) -> dict[str, Any]:
        import torch

        from trials import disks

        torch.set_num_threads(1)
        return getattr(disks, name)(count, seed, folder)  # type: ignore[no-any-return]

    return trial


def _fuzz(name: str) -> Trial:
    def trial(count: int, seed: int, folder: Path) -> dict[str, Any]:
        from trials import fuzz

        return getattr(fuzz, name)(count, seed, folder)  # type: ignore[no-any-return]

    return trial


TRIALS: dict[str, tuple[Trial, int]] = {
    "killed_writers": (_killed_writers, 2000),
    "killed_care": (_killed_care, 100),
    "killed_runs": (_killed_runs, 500),
    "stopped_runs": (_stopped_runs, 100),
    "failing_writes": (_disks("failing_writes"), 1),
    "full_disk": (_disks("full_disk"), 1000),
    "yaml_files": (_fuzz("yaml_files"), 1_000_000),
    "programs": (_fuzz("programs"), 1_000_000),
    "bundle_files": (_fuzz("bundle_files"), 100_000),
    "index_files": (_fuzz("index_files"), 20_000),
    "command_lines": (_fuzz("command_lines"), 50_000),
}


def memory_folder() -> str | None:
    """Where files are kept in memory, if there is such a place: a killed process leaves the same there."""
    place = Path("/dev/shm")
    return str(place) if os.access(place, os.W_OK) else None


def tried(name: str, count: int, seed: int) -> dict[str, Any]:
    began = time.monotonic()
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        counts = TRIALS[name][0](count, seed, Path(folder))
    return {**counts, "seed": seed, "seconds": round(time.monotonic() - began, 1)}


def main() -> int:
    if sys.argv[1:2] == ["full_disk_within"]:  # by the trial itself, in its own file system
        count, seed, folder = sys.argv[2:]
        print(json.dumps(_disks("full_disk_within")(int(count), int(seed), Path(folder))))
        return 0
    if len(sys.argv) > 2 and sys.argv[1] in TRIALS:
        name, count, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3] if len(sys.argv) > 3 else 0)
        print(json.dumps(tried(name, count, seed)))
        return 0
    share = float(sys.argv[2]) if sys.argv[1:2] == ["--share"] else 1.0
    results: dict[str, Any] = {
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        "machine": f"{os.cpu_count()} cores",
        "share": share,
    }
    for name, (_, most) in TRIALS.items():
        count = max(1, round(most * share))
        print(f"{name} × {count:,}", file=sys.stderr, flush=True)
        line = [sys.executable, __file__, name, str(count), str(int.from_bytes(os.urandom(3)))]
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        results[name] = json.loads(done.stdout) if done.returncode == 0 else {"failed": done.stderr[-1000:]}
        print(f"  {results[name]}", file=sys.stderr, flush=True)
        RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    return any("failed" in str(found) for found in results.values())


if __name__ == "__main__":
    sys.exit(main())
