"""Jobs side by side in processes: their rows, their runs, and what is left when something goes wrong."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import safetensors.torch

import paddlectl
from hurried import hurry
from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.experiments import processes
from paddlectl.experiments.jobs import Begun, Failure, Note, Progress, TrainJob, TransferJob
from paddlectl.experiments.policies import evaluate, revive
from paddlectl.experiments.processes import rows_of, run_jobs
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.logic.syntax import ProgramSyntaxError, parse_program
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.tasks.suite import load
from samples import ROOT
from schemas import require_row
from trials.children import jobs_at_work
from trials.runs import small

FRAMES = HybridSettings().num_envs * HybridSettings().rollout_steps  # of one block


def test_rows_are_in_the_order_of_the_jobs(trained):
    assert [row["task"] for row in trained.rows] == ["GapBall", "BlockedDoor"]
    for row in trained.rows:
        assert set(row) == {
            "run", "policy", "task", "method", "seed", "frames", "episodes", "seconds",
            "success_rate", "mean_score", "crispness",
        }  # fmt: skip
        assert (row["seed"], row["frames"]) == (0, FRAMES)


def test_runs_are_finished_and_their_policies_kept(trained):
    runs = {run.id: run for run in trained.registry.runs()}
    assert len(runs) == 2
    for row in trained.rows:
        run, policy = runs[row["run"]], trained.registry.policy(row["policy"])
        assert (run.kind, run.method, run.task, run.status) == ("train", "hdm", row["task"], "finished")
        assert (run.frames, run.episodes, run.policy) == (FRAMES, row["episodes"], policy.id)
        assert run.results["success_rate"] == policy.success_rate == row["success_rate"]
        assert run.settings["frames"] == 1
        assert run.versions["torch"]
        program = parse_program(policy.program)
        assert {clause.head for clause in program.clauses} <= set(load(policy.task).subgoals)
        assert all(p >= 0.1 for p in program.probabilities)


def test_what_is_new_is_told_by_job(trained):
    for index, row in enumerate(trained.rows):
        begun, note, progress, outcome = [event for number, event in trained.told if number == index]
        assert note == Note(f"{FRAMES:,} frames are run instead of 1: whole rounds of {FRAMES:,}")
        assert begun == Begun(row["run"])
        assert (progress.run, progress.frames) == (row["run"], FRAMES)
        assert outcome == row


def test_rows_are_as_train_tells_them(trained):
    for row in trained.rows:
        require_row(row, "train")
        require_row(row, "resume")


def test_a_run_from_python_learns_the_same(trained, tmp_path):
    with small():
        result = paddlectl.train("BlockedDoor", seed=0, frames=1, registry=tmp_path / "registry")
    ours = Registry.open(tmp_path / "registry").policy(result.policy.id)
    theirs = trained.registry.policy(trained.rows[1]["policy"])
    assert (ours.task, ours.checkpoint, ours.program) == (theirs.task, theirs.checkpoint, theirs.program)
    assert result.figures == {name: trained.rows[1][name] for name in result.figures}


def test_a_train_run_leaves_its_tables(trained):
    for row in trained.rows:
        (progress,) = trained.registry.files.read_rows(row["run"], "progress")
        assert set(progress) == {
            "frames", "episodes", "latest_success", "latest_score", "crispness", "seconds",
        }  # fmt: skip
        episodes = trained.registry.files.read_rows(row["run"], "episodes")
        assert len(episodes) == row["episodes"]


def test_a_kept_policy_is_revived_with_its_tensors(trained):
    record = trained.registry.policy(trained.rows[1]["policy"])
    policy = revive(trained.registry, record)
    kept = safetensors.torch.load(trained.registry.read_checkpoint(record))
    assert all((policy.state()[name] == tensor).all() for name, tensor in kept.items())
    assert set(kept) == set(policy.state())


def test_evaluation_is_a_function_of_its_seed(trained):
    record = trained.registry.policy(trained.rows[0]["policy"])
    one, same = (evaluate(trained.registry, record, "GapBall", 12, 1) for _ in range(2))
    assert one == same
    assert set(one) == {
        "policy", "task", "episodes", "seed", "success_rate", "mean_score", "mean_length",
    }  # fmt: skip
    assert (one["policy"], one["task"], one["episodes"], one["seed"]) == (record.id, "GapBall", 12, 1)


def test_a_policy_can_be_played_on_another_task_of_its_domain(trained):
    record = trained.registry.policy(trained.rows[0]["policy"])
    found = evaluate(trained.registry, record, "BlockedDoor", 4, 1)
    assert (found["task"], found["episodes"]) == ("BlockedDoor", 4)


def add_damaged_source(registry, trained):
    """A policy whose stored program isn't one any more."""
    sound = trained.registry.policy(trained.rows[0]["policy"])
    run = registry.add_run(
        kind="train",
        method="hdm",
        task="GapBall",
        scenario=None,
        sources=(),
        seed=0,
        settings={},
        versions={},
    )
    registry.finish_run(run.id, status="finished", frames=1, episodes=1, seconds=1.0, results={})
    return registry.add_policy(
        run=run.id,
        task="GapBall",
        domain="minigrid",
        method="hdm",
        seed=0,
        frames=1,
        program="0.9 :: gt_key( :-",
        checkpoint=trained.registry.read_checkpoint(sound),
        success_rate=1.0,
        mean_score=0.9,
        mean_length=30.0,
        crispness=0.9,
        metadata={},
    )


def test_a_job_that_fails_or_is_lost_stops_no_other(tmp_path, trained, monkeypatch):
    """One fails, one's process is killed, one is stopped by itself; the last one goes on."""
    hurry(monkeypatch, tmp_path)
    with Registry.open(tmp_path / "registry") as registry:
        damaged = add_damaged_source(registry, trained)
    scenario = Scenario(name="A", target="BlockedBoxUnlockPickup", sources=("GapBall",))
    told = []

    def tell(index, event):
        told.append((index, event))
        if isinstance(event, Begun) and index in (1, 2):
            (process,) = multiprocessing.active_children()
            os.kill(process.pid, signal.SIGKILL if index == 1 else signal.SIGTERM)

    transfer = TransferJob(scenario, (damaged.id,), "paddle", 0, 64)
    jobs = [transfer, *(TrainJob("BlockedDoor", seed, 10**9) for seed in (1, 2)), TrainJob("GapBall", 0, 1)]
    failed, killed, stopped, row = outcomes = run_jobs(jobs, str(tmp_path / "registry"), tell, workers=1)
    assert [outcome for _, outcome in told if isinstance(outcome, dict | Failure)] == outcomes
    assert (row["task"], row["frames"]) == ("GapBall", FRAMES)
    assert failed.error.exit_code == 5
    assert damaged.id in failed.error.message
    for outcome, name in ((killed, "SIGKILL"), (stopped, "SIGTERM")):
        assert outcome.error.message.startswith(f"{outcome.run} was ended by {name}")
        assert outcome.error.hint == f"run: paddlectl resume {outcome.run}"
    with Registry.open(tmp_path / "registry", create=False) as registry:
        states = [registry.run(outcome.run).status for outcome in (failed, killed, stopped)]
        assert states == ["failed", "interrupted", "interrupted"]
        assert registry.run(row["run"]).status == "finished"
    with pytest.raises(IntegrityError):
        rows_of(outcomes)


@pytest.mark.skipif(not Path("/proc").exists(), reason="there is no /proc to find processes in")
def test_a_process_whose_parent_was_killed_keeps_a_checkpoint_and_is_gone(tmp_path):
    line = [sys.executable, "-m", "paddlectl", "train", "BlockedDoor", "--frames", "9999999"]
    line += [
        "--set",
        "num_envs=8",
    ]  # a round must end soon, even on a busy machine, for the checkpoint to be kept
    parent = subprocess.Popen(
        [*line, "--registry", str(tmp_path / "registry")],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        stderr=subprocess.DEVNULL,
    )
    run = tmp_path / "registry" / "runs" / "run-1"
    wait_until((run / "progress.jsonl").exists)
    (worker,) = [child for child, owner in jobs_at_work().items() if owner == parent.pid]
    parent.kill()
    parent.wait()
    wait_until(lambda: worker not in jobs_at_work())
    assert any((run / "checkpoints").glob("*.json"))
    with Registry.open(tmp_path / "registry", create=False) as registry:
        assert registry.run("run-1").status == "interrupted"


def wait_until(true):
    patience = time.monotonic() + 60
    while not true():
        assert time.monotonic() < patience
        time.sleep(0.05)


def test_nobody_who_doesnt_listen_holds_a_job_up():
    """Its pipe full, or its reader gone: progress is dropped, and the job goes on."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    line = processes._Line(theirs)
    tick = Progress("run-1", 1, 2, 0, None, None, "x" * 1000)
    for _ in range(1000):
        line.send_if_room(tick)
    assert ours.recv() == tick
    ours.close()
    line.send_if_room(tick)
    line.send(Begun("run-1"))


def kinds(of=PaddlectlError):
    return [of, *(kind for each in of.__subclasses__() for kind in kinds(each))]


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.__name__)
def test_every_error_can_leave_a_process(kind):
    error = kind(3, 7, "what") if kind is ProgramSyntaxError else kind("what is wrong", "what to do")
    told = pickle.loads(pickle.dumps(error))
    assert (type(told), str(told), told.hint) == (kind, str(error), error.hint)


def test_no_jobs_make_no_rows(tmp_path):
    assert run_jobs([], str(tmp_path / "registry"), lambda *_: None) == []
