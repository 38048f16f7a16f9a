"""A secret in the environment, in an address or in a scenario file comes out nowhere (R20)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli import app
from paddlectl.registry.schema import metadata
from paddlectl.registry.store import Registry
from postgres import server
from samples import BLOCKED_DOOR, GAP_BALL, SCENARIO, Answer, Command, add_source, add_transfer, program

CANARY = "canary%2Fs3cret"
"""As it stands in an address; it is found in either spelling."""
SPELLINGS = ("canary/s3cret", CANARY)
LINES = (
    "tasks", "runs", "policies", "show policy-3", "similarity --target OpenGoal", "explain latest",
    "registry check --read-data", "registry repair", "registry gc", "registry upgrade",
    "registry export run-3 {folder}/x.zip", "registry import {folder}/x.zip --registry {folder}/other",
    "registry check --registry {folder}/other", "explain run-1 --registry {folder}/other",
)  # fmt: skip
REFUSED = (
    "show policy-77", "evaluate policy-3 --task Nowhere", "registry export run-77 {folder}/y.zip",
    "runs --registry postgresql://me:{canary}@localhost:1/x?files={folder}/files",
    "train BoxDoor --registry mysql://me:{canary}@localhost/x",
    "runs --registry postgresql://me:{canary}@[/x?files=y", "runs --registry http://me:{canary}@x/y",
    "registry import postgresql://me:{canary}@x/y",
)  # fmt: skip
FILES = (
    "password: {canary}\n", "frames: {canary}\n", "similarity: {{token: {canary}}}\n",
    "seeds: [{canary}]\n", "guidance: {{mode: default}}\ntoken: [{canary}\n", "other: &a {canary}\n",
)  # fmt: skip


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    with server() as running:
        yield running.new(tmp_path / "files", CANARY)


def stored(registry: Registry) -> str:
    """Every row of the index."""
    with registry.mending() as connection:
        return str([connection.execute(table.select()).all() for table in metadata.sorted_tables])


def test_a_secret_comes_out_nowhere(
    address: str, command: Command, process: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"PADDLECTL_REGISTRY": address, "CLOUD_SECRET_KEY": SPELLINGS[0]}.items():
        monkeypatch.setenv(name, value)
    registry = Registry.open(address)
    for task, clauses in (("BlockedDoor", BLOCKED_DOOR), ("GapBall", GAP_BALL)):
        add_source(registry, task, program(task, clauses))
    add_transfer(registry)
    learned = process("train", "BoxDoor", "--frames", 1)
    told = [Answer(learned.returncode, learned.stdout, learned.stderr)]
    for line in LINES:
        words = line.format(folder=tmp_path).split()
        told += [command(*words)] + [command(*words, "--json")] * ("export" not in words)
    assert [answer for answer in told if answer.code] == []
    for line in REFUSED:
        told.append(command(*line.format(folder=tmp_path, canary=CANARY).split()))
        assert told[-1].code not in (0, 130), line
    scenario = tmp_path / "secret.yaml"
    for text in FILES:
        scenario.write_text(f"# token: {CANARY}\n{SCENARIO}{text.format(canary=CANARY)}")
        told.append(command("transfer", scenario))
        assert told[-1].code == 3 and "secret.yaml:" in told[-1].err, text
    scenario.unlink()
    told.append(unforeseen(address, command, tmp_path, monkeypatch))
    kept = {str(path): path.read_bytes().decode("latin-1") for path in tmp_path.rglob("*") if path.is_file()}
    assert len(kept) > 10
    kept |= {"PostgreSQL": stored(registry), "SQLite": stored(Registry.open(tmp_path / "other"))}
    kept |= {str(number): answer.out + answer.err for number, answer in enumerate(told)}
    assert [(place, text) for place, text in kept.items() if any(s in text for s in SPELLINGS)] == []


def unforeseen(address: str, command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Answer:
    """An error that nobody foresaw, with the address in its message, and so in its log."""

    def wrong(_: object) -> None:
        raise RuntimeError(f"no answer from {address}")

    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.setattr(app, "make_app", wrong)
    answer = command("runs")
    assert answer.code == 1 and list(folder.glob("paddlectl-*.log"))
    return answer
