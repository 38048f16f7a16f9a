"""The short tier of the reliability trials, as far as it is quick; `make soak` runs all, with other seeds."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from soak import RESULTS, TRIALS

SOAK = Path(__file__).with_name("soak.py")
COUNTS = {
    "killed_writers": 30,
    "killed_care": 3,
    "shared_folders": 2,
    "live_readers": 16,
    "full_disk": 3,
    "yaml_files": 2500,
    "programs": 2500,
    "index_files": 40,
    "changed_files": 800,
    "healthy_registries": 20,
    "command_lines": 500,
}


@pytest.mark.parametrize("name", COUNTS)
def test_a_trial(name: str) -> None:
    line = [sys.executable, str(SOAK), name, str(COUNTS[name]), "1"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr[-3000:] + done.stdout[-1000:]
    found = json.loads(done.stdout)
    if "skipped" in found:
        pytest.skip(found["skipped"])
    for nothing in ("lost", "different", "between", "ids_given_twice", "undetected", "false_alarms"):
        assert found.get(nothing, 0) == 0


def test_the_results_hold_every_trial_at_its_short_count_or_more() -> None:
    results = json.loads(RESULTS.read_text())["trials"]
    assert list(results) == list(TRIALS)
    for name, trial in TRIALS.items():
        assert results[name]["count"] >= trial.short, name
        assert not {"failed", "skipped"} & results[name].keys(), name
