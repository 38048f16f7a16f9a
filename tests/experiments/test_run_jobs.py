"""Jobs side by side in processes: their rows, their runs, and what is left when something goes wrong."""

import pickle

import pytest
import safetensors.torch

from paddlectl.errors import PaddlectlError
from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.processes import run_jobs
from paddlectl.experiments.sources import evaluate, revive
from paddlectl.hybrid.policy import HybridSettings
from paddlectl.logic.syntax import ProgramSyntaxError, parse_program
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario
from paddlectl.tasks.suite import load

FRAMES = HybridSettings().lanes * HybridSettings().block  # of one block


def test_rows_are_in_the_order_of_the_jobs(trained):
    assert [row["task"] for row in trained.rows] == ["GapBall", "BlockedDoor"]
    for row in trained.rows:
        assert set(row) == {
            "run", "policy", "task", "seed", "frames", "episodes", "seconds",
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
        assert {clause.head for clause in program.clauses} <= set(load(policy.task).heads)
        assert all(p >= 0.1 for p in program.probabilities)


def test_progress_is_told_by_job(trained):
    assert {index for index, _ in trained.told} == {0, 1}
    for index, progress in trained.told:
        assert progress.run == trained.rows[index]["run"]
        assert progress.frames == FRAMES


def test_a_train_run_leaves_its_tables(trained):
    for row in trained.rows:
        (progress,) = trained.registry.read_rows(row["run"], "progress")
        assert set(progress) == {
            "frames", "episodes", "success_rate", "mean_score", "crispness", "seconds",
        }  # fmt: skip
        episodes = trained.registry.read_rows(row["run"], "episodes")
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


def test_what_goes_wrong_in_one_job_is_told_and_the_others_are_interrupted(tmp_path, trained):
    with Registry.open(tmp_path / "registry") as registry:
        damaged = add_damaged_source(registry, trained)
    scenario = Scenario(name="A", target="BlockedBoxUnlockPickup", sources=("GapBall",))
    started = []

    def report(index, progress):
        started.append(index)

    jobs = [TrainJob("BlockedDoor", 0, 10**9), TransferJob(scenario, (damaged.id,), "paddle", 0, 64)]
    with pytest.raises(PaddlectlError) as caught:
        run_jobs(jobs, str(tmp_path / "registry"), report, workers=2)
    assert caught.value.exit_code == 5
    assert damaged.id in caught.value.message
    with Registry.open(tmp_path / "registry", create=False) as registry:
        told = {run.task: run.status for run in registry.runs()}
        assert told.pop("BlockedBoxUnlockPickup") == "failed"
        # the other may not have got as far as to enter its run
        assert told.pop("BlockedDoor", "interrupted") == "interrupted"
        assert told == {"GapBall": "finished"}


def kinds(of=PaddlectlError):
    return [of, *(kind for each in of.__subclasses__() for kind in kinds(each))]


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.__name__)
def test_every_error_can_leave_a_process(kind):
    error = kind(3, 7, "what") if kind is ProgramSyntaxError else kind("what is wrong", "what to do")
    told = pickle.loads(pickle.dumps(error))
    assert (type(told), str(told), told.hint) == (kind, str(error), error.hint)


def test_no_jobs_make_no_rows(tmp_path):
    assert run_jobs([], str(tmp_path / "registry"), lambda *_: None) == []
