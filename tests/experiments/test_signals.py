"""^C and SIGTERM while sources are being learned."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from paddlectl.hybrid.settings import HybridSettings
from paddlectl.registry.store import Registry
from samples import ROOT
from trials.children import jobs_at_work

LANES = 8  # so that a round ends soon
BLOCK = LANES * HybridSettings().rollout_steps


def train(registry):
    line = [sys.executable, "-m", "paddlectl", "train", "BlockedDoor", "--frames", "9999999"]
    line += ["--set", f"num_envs={LANES}"]
    return subprocess.Popen(
        [*line, "--registry", str(registry)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for(path):
    patience = time.monotonic() + 120
    while not path.exists():
        assert time.monotonic() < patience, f"{path.name} didn't come"
        time.sleep(0.05)


def ended(process):
    """Its exit code, and that it says what happened in a line."""
    out, err = process.communicate(timeout=60)
    assert out == ""
    assert "Traceback" not in err
    assert err.splitlines()[-1] == "interrupted"
    return process.returncode


def hears_no_signal(process):
    status = Path(f"/proc/{process}/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("SigBlk"))
    (other,) = (line for line in status.splitlines() if line.startswith("SigIgn"))
    deaf = int(line.split()[1], 16) | int(other.split()[1], 16)
    return all(deaf >> (number - 1) & 1 for number in (signal.SIGINT, signal.SIGTERM))


# A terminal sends ^C to the whole group; kill and the like send SIGTERM to the one process.
@pytest.mark.parametrize(
    ("send", "number", "code"), [(os.killpg, signal.SIGINT, 130), (os.kill, signal.SIGTERM, 143)]
)
def test_a_stopped_training_marks_its_run(tmp_path, send, number, code):
    process = train(tmp_path / "registry")
    wait_for(tmp_path / "registry" / "runs" / "run-1" / "progress.jsonl")
    send(process.pid, number)
    assert ended(process) == code
    with Registry.open(tmp_path / "registry", create=False) as registry:
        (run,) = registry.runs()
        assert (run.status, run.policy) == ("interrupted", None)
        assert run.frames >= BLOCK
        assert len(registry.files.read_rows(run.id, "progress")) * BLOCK == run.frames


@pytest.mark.skipif(not Path("/proc").exists(), reason="there is no /proc to find processes in")
def test_a_training_is_stopped_before_it_has_begun(tmp_path):
    process = train(tmp_path / "registry")
    assert process.stderr.readline() == "1 run × 9,999,999 frames\n"
    patience = time.monotonic() + 60
    while not (own := [child for child, parent in jobs_at_work().items() if parent == process.pid]):
        assert time.monotonic() < patience and process.poll() is None
        time.sleep(0.01)
    assert hears_no_signal(*own), "else what Python does at its start is told as a traceback"
    os.killpg(process.pid, signal.SIGINT)
    assert process.stderr.read() == "not begun: BlockedDoor seed 0\ninterrupted\n"
    assert process.stdout.read() == "" and process.wait(60) == 130
