"""Commands run in this process or in one of their own, and a registry for them to speak of."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from paddlectl.cli import app
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, GAP_BALL, ROOT, Answer, Command, add_source, add_transfer, program


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Runs one command line in this process, through its error boundary."""
    monkeypatch.setenv("PADDLECTL_REGISTRY", str(tmp_path / "registry"))
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)

    def run(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["paddlectl", *map(str, arguments)])
        capsys.readouterr()
        code = app.main()
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Answer(code, out, err)

    return run


@pytest.fixture
def process() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs one command line as a user does, in a process of its own."""

    def run(*arguments: object, **variables: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": str(ROOT / "src")} | variables
        line = [sys.executable, "-m", "paddlectl", *map(str, arguments)]
        return subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)

    return run


@pytest.fixture
def registry(_made: Path, tmp_path: Path) -> Registry:
    """policy-1 solves BlockedDoor, policy-2 GapBall, policy-3 came out of the transfer run-3."""
    shutil.copytree(_made, tmp_path / "registry")
    return Registry.open(tmp_path / "registry")


@pytest.fixture(scope="session")
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = Registry.open(tmp_path_factory.mktemp("made") / "registry")
    for task, clauses in (("BlockedDoor", BLOCKED_DOOR), ("GapBall", GAP_BALL)):
        add_source(made, task, program(task, clauses))
    add_transfer(made)
    return made.folder
