"""The short tier of the reliability trials; `make soak` runs the long one with other seeds."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SOAK = Path(__file__).with_name("soak.py")
COUNTS = {
    "killed_writers": 120,
    "killed_care": 6,
    "killed_runs": 16,
    "stopped_runs": 8,
    "failing_writes": 1,
    "full_disk": 12,
    "yaml_files": 4000,
    "programs": 4000,
    "index_files": 60,
    "command_lines": 600,
}
MOST_MEGABYTES = 600  # of a process that has loaded all of the command line and its packages


@pytest.mark.parametrize("name", COUNTS)
def test_a_trial(name: str) -> None:
    line = [sys.executable, str(SOAK), name, str(COUNTS[name]), "1"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-1000:]
    found = json.loads(done.stdout)
    if "skipped" in found:
        pytest.skip(found["skipped"])
    for nothing in ("lost", "different", "between", "ids_given_twice"):
        assert found.get(nothing, 0) == 0
    assert found.get("megabytes", 0) <= MOST_MEGABYTES
