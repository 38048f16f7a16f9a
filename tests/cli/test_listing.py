"""Which runs and policies are listed, and how far those are that go on."""

import json
import os
import pty
import signal
import subprocess
import sys

import pytest

from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from samples import ROOT, TARGET, Command, add_source


def listed(command: Command, line: str, field: str = "run") -> list[str]:
    answer = command(*line.split(), "--json")
    assert answer.code == 0, answer.err
    rows = answer.json[f"{'policies' if field == 'policy' else 'runs'}"]
    assert answer.json["total"] == len(rows)
    return [row[field] for row in rows]


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("runs --task GapBall", ["run-2"]),
        (f"runs --task {TARGET} --method paddle", ["run-3"]),
        ("runs --method ppo", ["run-4"]),
        ("runs --scenario A", ["run-3"]),
        ("runs --status finished --method hdm", ["run-2", "run-1"]),
        ("runs --status failed", []),
        ("runs --since 1h", ["run-4", "run-3", "run-2", "run-1"]),
        ("runs --since 2999-01-01", []),
        ("runs --since 2020-01-01T10:30", ["run-4", "run-3", "run-2", "run-1"]),
    ],
)
def test_runs_are_chosen(registry: Registry, command: Command, line: str, found: list[str]) -> None:
    add_source(registry, "BoxDoor", None, method="ppo")
    assert listed(command, line) == found


def test_when_is_told_in_the_users_own_time(
    registry: Registry, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    import time

    with registry.index.writing() as connection:
        connection.execute(runs.update().values(created="2026-03-31T22:30:00.000+00:00"))
    for zone, found in (("UTC", 0), ("<+03>-3", 3)):
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        assert len(listed(command, "runs --since 2026-04-01")) == found
    monkeypatch.delenv("TZ")
    time.tzset()


def test_policies_are_chosen(registry: Registry, command: Command) -> None:
    add_source(registry, "BoxDoor", None, method="ppo")
    assert listed(command, "policies --task GapBall", "policy") == ["policy-2"]
    assert listed(command, "policies --method ppo", "policy") == ["policy-4"]


def test_a_run_that_goes_on_is_listed_with_its_frames_so_far(registry: Registry, command: Command) -> None:
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="BoxDoor",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    ).id
    assert json.loads(command("runs", "--json").out)["runs"][0]["frames"] == 0
    registry.files.append_rows(run, "progress", [{"frames": 2048}, {"frames": 4096}])
    assert json.loads(command("runs", "--status", "running", "--json").out)["runs"][0]["frames"] == 4096


def test_watched_they_are_told_until_an_interrupt(registry: Registry) -> None:
    line = [sys.executable, "-m", "paddlectl", "runs", "--watch", "--registry", str(registry.location)]
    own, terminal = pty.openpty()
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "TERM": "xterm", "COLUMNS": "100"}
    process = subprocess.Popen(line, stdout=terminal, stderr=subprocess.PIPE, env=environment)
    os.close(terminal)
    shown = b""
    while b"run-1" not in shown:
        shown += os.read(own, 1000)
    process.send_signal(signal.SIGINT)
    assert (process.wait(20), process.communicate()[1]) == (130, b"interrupted\n")
    os.close(own)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("runs --status finishd", "did you mean finished?"),
        ("runs --status=", "use one of running"),
        ("runs --since soon", "soon is no date"),
        ("runs --since 9999999d", "is no date"),
        ("runs --since 999999d", "is no date"),
        ("runs --task=", "--task can't be ''"),
        ("runs --watch", "--watch needs a terminal"),
        ("policies --method=\x1b", r"--method can't be '\x1b'"),
    ],
)
def test_what_cant_be_meant_is_told(command: Command, line: str, told: str) -> None:
    answer = command(*line.split(" "))
    assert (answer.code, answer.out) == (2, "") and told in answer.err and "\x1b" not in answer.err


def test_the_command_lists_first_and_asks_unless_told(registry: Registry, command: Command) -> None:
    answer = command("registry", "delete", "run-3")
    assert answer.code == 2 and "run-3" in answer.out and "add --yes" in answer.err
    assert registry.run("run-3")
    answer = command("registry", "delete", "run-3", "--yes")
    assert answer.code == 0 and answer.out.endswith("B are free now\n")
    assert "run-3" not in listed(command, "runs")
    refused = command("registry", "delete", "run-3", "--yes")
    assert (refused.code, refused.out) == (4, "") and "no run run-3" in refused.err


def test_an_empty_list_says_if_nobody_has_such_a_name(registry: Registry, command: Command) -> None:
    near = command("runs", "--task", "gapbal", "--json")
    assert near.code == 0 and near.err == "note: there is no task gapbal; did you mean GapBall?\n"
    assert command("policies", "--method", "hdmm").err.endswith("no method hdmm; did you mean hdm?\n")
    assert not command("runs", "--task", "GapBall", "--method", "cup").err
