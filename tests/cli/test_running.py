"""What `train`, `transfer` and `resume` tell of many runs, and of what fails, is lost or can't be written."""

import io
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from paddlectl.cli import running
from paddlectl.cli.quiet import Courtesy
from paddlectl.errors import NotFoundError, PaddlectlError
from paddlectl.experiments import runner
from paddlectl.experiments.jobs import Begun, Event, Failure, Job, Note, Progress, ResumeJob, TrainJob
from paddlectl.experiments.runner import train_source
from paddlectl.methods.base import Setup
from paddlectl.registry.names import ELSEWHERE
from paddlectl.registry.records import RunRecord
from paddlectl.registry.store import Registry
from paddlectl.report import progress
from samples import ROOT, Command, reuse

ROW = {
    "run": "run-9", "policy": "policy-9", "task": "BoxDoor", "seed": 0, "frames": 1, "episodes": 1,
    "seconds": 1.0, "success_rate": 1.0, "mean_score": 1.0, "crispness": 1.0,
}  # fmt: skip
Tell = Callable[[int, Event], None]


def add_run(
    registry: Registry, status: str, sources: tuple[str, ...] = (), seconds: float = 1.0
) -> RunRecord:
    run = registry.add_run(
        kind="train", method="hdm", task="BoxDoor", scenario=None, sources=(), seed=0,
        settings={"frames": 20_000}, versions={},
    )  # fmt: skip
    return registry.finish_run(run.id, status=status, frames=10_000, episodes=1, seconds=seconds, results={})


@pytest.fixture
def jobs_done(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Job]]:
    """Has `run_jobs` tell this of each job in turn, a row if it is nothing else, and notes the jobs."""

    def replace(*events: Event | BaseException) -> list[Job]:
        asked: list[Job] = []

        def run_jobs(jobs: Sequence[Job], _: str, tell: Tell, *__: object) -> list[Any]:
            asked.extend(jobs)
            outcomes = []
            for event, index in zip(events, [*range(len(jobs)), 0], strict=False):
                if isinstance(event, BaseException):
                    raise event
                tell(index, event)
                outcomes.append(event)
            return outcomes

        monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
        return asked

    return replace


@pytest.mark.parametrize(("crispness", "look"), [(1.0, "show"), (None, "evaluate")])
def test_what_has_no_program_isnt_to_be_shown(
    command: Command, jobs_done: Callable[..., list[Job]], crispness: float | None, look: str
) -> None:
    jobs_done(ROW | {"crispness": crispness})
    assert command("train", "BoxDoor").out.endswith(f"next: paddlectl {look} policy-9\n")


def test_what_failed_is_told_after_the_rows_of_the_others(
    command: Command, jobs_done: Callable[..., list[Job]]
) -> None:
    lost = Failure("run-3", PaddlectlError("run-3 was ended by SIGKILL", "run: paddlectl resume run-3"))
    refused = Failure(None, NotFoundError("no policy policy-1", "run: paddlectl policies"))
    jobs_done(ROW, lost, refused)
    answer = command("train", "BoxDoor", "--seeds", "0-2")
    assert answer.code == 1
    assert "policy-9" in answer.out
    assert answer.err.splitlines()[1:] == [
        "error: BoxDoor seed 1: run-3 was ended by SIGKILL",
        "run: paddlectl resume run-3",
        "error: BoxDoor seed 2: no policy policy-1",
        "run: paddlectl policies",
    ]
    document = command("train", "BoxDoor", "--seeds", "0-2", "--json").json
    assert document["runs"] == [ROW]
    assert [(each["job"], each["run"]) for each in document["failed"]] == [
        ("BoxDoor seed 1", "run-3"),
        ("BoxDoor seed 2", None),
    ]


def test_one_job_alone_fails_with_its_own_exit_code(
    command: Command, jobs_done: Callable[..., list[Job]]
) -> None:
    jobs_done(Failure(None, NotFoundError("no policy policy-1", "run: paddlectl policies")))
    answer = command("train", "BoxDoor")
    assert (answer.code, answer.out) == (4, "")
    assert answer.err.splitlines()[1:] == ["error: no policy policy-1", "run: paddlectl policies"]


def test_an_interruption_names_every_run_to_go_on_with_and_what_was_not_begun(
    command: Command, jobs_done: Callable[..., list[Job]]
) -> None:
    jobs_done(Begun("run-4"), Begun("run-5"), ROW, KeyboardInterrupt())
    answer = command("train", "BoxDoor", "--seeds", "0-30")
    assert answer.code == 130
    told = answer.err.splitlines()[1:]
    assert told[0] == "go on with: paddlectl resume run-4 run-5"
    assert told[1].startswith("not begun: BoxDoor seed 3, BoxDoor seed 4, ")
    assert told[1].endswith("BoxDoor seed 22 and 8 more")
    assert told[2:] == ["interrupted"]


def test_resume_all_goes_past_what_can_not_go_on(
    registry: Registry, command: Command, jobs_done: Callable[..., list[Job]]
) -> None:
    imported = add_run(registry, "interrupted")
    reuse(registry, imported.id, [f"{ELSEWHERE}policy-1"])
    stopped = add_run(registry, "interrupted")
    asked = jobs_done({**ROW, "run": stopped.id})
    answer = command("resume", "--all", "--json")
    assert asked == [ResumeJob(stopped.id)]
    assert (answer.code, answer.json["runs"][0]["run"]) == (1, stopped.id)
    assert answer.json["failed"] == [
        {"job": imported.id, "run": imported.id, "error": f"{imported.id} can't go on here\nstart it anew"}
    ]
    assert f"error: {imported.id}: {imported.id} can't go on here" in answer.err


@pytest.mark.parametrize(
    ("options", "plan"),
    [
        (("--frames", "60000"), "1 run × 60,000 frames"),
        (("--frames", "60000", "--seeds", "0-5", "--jobs", "2"), "6 runs × 60,000 frames, 2 at a time"),
        (("CoffeeMaze", "--jobs", "4"), "2 runs, 4,100,000 frames, 2 at a time"),
        (("--method", "ppo"), "1 run × 250,000 frames"),
        (("DoorBall", "--method", "hdqn"), "2 runs × 100,000 frames, 2 at a time"),
        (("MailMaze", "--preset", "paper"), "error: hdm has no preset paper for BoxDoor"),
    ],
)
def test_what_is_to_come_is_told_before_it_starts(
    command: Command, jobs_done: Callable[..., list[Job]], options: tuple[str, ...], plan: str
) -> None:
    jobs_done(*[ROW] * 6)
    assert command("train", "BoxDoor", *options).err.splitlines()[0] == plan


@pytest.mark.parametrize(
    "line",
    [
        "CoffeeMaze",
        "CoffeeMaze --preset paper",
        "CoffeeMaze --method hdqn --preset paper",
        "CoffeeMaze --method td3",
        "BoxDoor --method ppo",
        "BoxDoor --method ppo --frames 7",
    ],
)
def test_the_budget_that_is_told_is_the_one_that_is_run(
    command: Command,
    jobs_done: Callable[..., list[Job]],
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[Setup] = []

    def stop(*given: Any) -> None:
        begun.extend(each for each in given if isinstance(each, Setup))
        raise KeyboardInterrupt

    asked = jobs_done(ROW)
    told = command("train", *line.split()).err.splitlines()[0]
    monkeypatch.setattr(runner, "_learned", stop)
    (job,) = asked
    assert isinstance(job, TrainJob)
    with Registry.open(tmp_path / "run") as registry, pytest.raises(KeyboardInterrupt):
        train_source(job, registry, lambda _: None)
    with Registry.open(tmp_path / "run") as registry:
        assert registry.runs()[0].settings["frames"] == begun[0].frames
    assert told == f"1 run × {begun[0].frames:,} frames"


def test_how_long_is_told_by_earlier_runs(command: Command, jobs_done: Callable[..., list[Job]]) -> None:
    jobs_done(*[ROW] * 6)
    command("train", "BoxDoor", "--frames", "1000")
    with Registry.open(str(os.environ["PADDLECTL_REGISTRY"])) as registry:
        for seconds in (10.0, 20.0, 90.0):
            add_run(registry, "finished", seconds=seconds)
    told = command("train", "BoxDoor", "--frames", "60000", "--seeds", "0-5", "--jobs", "2").err
    assert told.splitlines()[0] == "6 runs × 60,000 frames, 2 at a time, about 6 minutes"


def test_a_thousand_jobs_cost_no_more_to_show_than_two(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    written: dict[int, tuple[str, float]] = {}
    for count in (2, 1000):
        terminal = Terminal()
        monkeypatch.setattr(sys, "stderr", terminal)
        began = time.process_time()
        with progress.progress([f"BoxDoor seed {seed}" for seed in range(count)]) as view:
            for index in (0, 1):
                running._show(view, index, Progress(f"run-{index}", 5, 10, 1, 0.5, 0.5, ""))
            running._show(view, 0, Failure(None, PaddlectlError("")))
            running._show(view, 1, Note("an earlier checkpoint is used"))
        written[count] = terminal.getvalue(), time.process_time() - began
    assert "note: an earlier checkpoint is used" in written[1000][0]
    assert "1 done, 998 to come" in written[1000][0]
    assert "seed 2" not in written[1000][0]
    assert written[1000][1] <= 3 * written[2][1] + 0.1


def test_messages_that_can_not_be_written_stop_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    stream = Courtesy(os.fdopen(writer, "w", buffering=1))
    for _ in range(3):
        assert stream.write("told\n") == 5
        stream.flush()
    assert not stream.isatty()


def test_a_training_goes_on_without_anywhere_to_tell_of_it(tmp_path: Path) -> None:
    """Nor is a file of the working folder taken for a module of Python's, here or in a run's process."""
    for module in ("signal", "types", "struct", "torch", "paddlectl"):
        (tmp_path / f"{module}.py").write_text("raise SystemExit('run by mistake')")
    line = [str(Path(sys.executable).with_name("paddlectl")), "train", "BoxDoor", "--frames", "1"]
    reader, where = os.pipe()
    os.close(reader)
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=where, text=True, check=False
    )
    os.close(where)
    assert done.returncode == 0 and "policy-1" in done.stdout, done.stdout
