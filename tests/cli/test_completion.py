"""What the shell is offered where there is much to offer."""

from pathlib import Path

import pytest

from paddlectl.cli import completion
from paddlectl.registry.store import Registry
from samples import add_source


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Twelve runs, of which the newest three are offered."""
    monkeypatch.setattr(completion, "MOST", 3)
    with Registry.open(tmp_path / "registry") as opened:
        for task in ("GapBall", *["BoxDoor"] * 11):
            add_source(opened, task, None)
        opened.label_runs(["run-2"], name="run_of_old")
        return str(opened.location)


@pytest.mark.parametrize(
    ("incomplete", "offered"),
    [
        ("", ["run-12", "run-11", "run-10"]),
        ("run-", ["run-12", "run-11", "run-10"]),
        ("run-1", ["run-12", "run-11", "run-10"]),
        ("run-2", ["run-2", "run_of_old"]),
        ("run_", ["run-2", "run_of_old"]),
        ("100%", []),
        ("%", []),
    ],
)
def test_of_the_runs_that_begin_so_the_newest(place: str, incomplete: str, offered: list[str]) -> None:
    assert [name for name, _ in completion.run_names(place, incomplete)] == offered


def test_every_task_that_is_solved_however_old_its_policies(place: str) -> None:
    names = [name for name, _ in completion.policy_names(place)]
    assert names == ["BoxDoor", "GapBall", "policy-12", "policy-11", "policy-10"]
    assert [name for name, _ in completion.policy_names(place, "policy-7")][2:] == ["policy-7"]
