"""Which policies a scenario's transfers reuse, and what is said where one is missing or can't be reused."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from paddlectl.errors import NotFoundError, PaddlectlError, UsageError
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.resuming import job_of, resume
from paddlectl.experiments.runner import run_transfer
from paddlectl.experiments.sources import resolve, unlearned
from paddlectl.registry.bundles import bundles
from paddlectl.registry.index.index import Index
from paddlectl.registry.store import Registry
from paddlectl.report.explanation import explanation_document
from paddlectl.scenario import Scenario, TaskSources
from samples import BLOCKED_DOOR, ROOT, TARGET, add_source, program
from small_transfer import SMALL
from trials.runs import StopAfter, quiet, small

PROGRAM = program("BlockedDoor", BLOCKED_DOOR)
PUPIL = "cup"
"""A method that reuses the policies of ppo or td3."""


def scenario(*sources: str, target: str = TARGET) -> Scenario:
    return Scenario(name="A", target=target, sources=sources)


def paired(*tasks: str, target: str = TARGET) -> Scenario:
    return Scenario(name="A", target=target, sources=TaskSources(tasks=tasks, seed="paired"))


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    return Registry.open(tmp_path / "registry")


@pytest.fixture
def learned(registry: Registry) -> Callable[..., str]:
    def add(task: str, method: str = "hdm", seed: int = 0, success: float = 0.9, **more: Any) -> str:
        domain = more.pop("domain", "minigrid")
        return add_source(registry, task, PROGRAM, domain, method, seed, success)

    return add


def refusal(kind: type[PaddlectlError], registry: Registry, *asked: Any) -> tuple[str, str]:
    with pytest.raises(kind) as caught:
        resolve(registry, *asked).required()
    assert "\n" not in caught.value.message + caught.value.hint
    return caught.value.message, caught.value.hint


def test_of_a_task_the_best_of_the_method_that_teaches(
    registry: Registry, learned: Callable[..., str]
) -> None:
    hdm = learned("GapBall", success=0.5)
    learned("GapBall", success=0.4)
    flat = learned("GapBall", "ppo", success=0.3)
    for other in ("random", "td3", "hdqn"):
        learned("GapBall", other, success=1.0)
    for method, best in (("paddle", hdm), ("finetune", hdm), (PUPIL, flat)):
        found = resolve(registry, scenario("GapBall"), method, (3, 1))
        assert found.required() == {3: (best,), 1: (best,)}


@pytest.mark.parametrize("method", ["paddle", "finetune"])
def test_what_a_transfer_learned_is_a_source_for_the_next(
    registry: Registry, learned: Callable[..., str], method: str
) -> None:
    alone, flat = learned("GapBall", success=0.5), learned("GapBall", "ppo", success=0.3)
    kept = learned("GapBall", method, success=0.9)
    asked = scenario("GapBall")
    assert resolve(registry, asked, "paddle", (0,)).required() == {0: (kept,)}
    assert resolve(registry, asked, PUPIL, (0,)).required() == {0: (flat,)}
    assert resolve(registry, scenario(kept), "paddle", (0,)).required() == {0: (kept,)}
    paired_ids = resolve(registry, paired("GapBall"), "paddle", (0,)).required()
    assert paired_ids == {0: (alone,)}, "seeds are paired with what was learned from nothing"


def test_the_teacher_is_that_of_the_targets_actions(registry: Registry, learned: Callable[..., str]) -> None:
    learned("CoffeeMaze", domain="maze2d")
    continuous = learned("CoffeeMaze", "td3", domain="maze2d")
    asked = scenario("CoffeeMaze", target="CoffeeMailMaze")
    assert resolve(registry, asked, PUPIL, (0,)).required() == {0: (continuous,)}


def test_a_method_that_reuses_nothing_needs_nothing(registry: Registry) -> None:
    for asked in (scenario("GapBall"), scenario("policy-9"), paired("GapBall")):
        assert resolve(registry, asked, "hdm", (0, 1)).required() == {0: (), 1: ()}


def test_a_paired_seed_reuses_the_newest_policy_of_each_task_with_that_seed(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("GapBall", seed=1, success=1.0)
    ids = {(task, seed): learned(task, seed=seed) for seed in (2, 1) for task in ("GapBall", "BlockedDoor")}
    for method in ("random", "ppo", "paddle"):
        learned("GapBall", method, seed=1, success=1.0)
    learned("OpenGoal", seed=1)
    found = resolve(registry, paired("BlockedDoor", "GapBall"), "paddle", (1, 2))
    assert found.required() == {s: (ids["BlockedDoor", s], ids["GapBall", s]) for s in (1, 2)}
    assert found.missing == []


def test_named_policies_stand_beside_tasks_in_the_order_of_the_file(
    registry: Registry, learned: Callable[..., str]
) -> None:
    worse, best = learned("GapBall", success=0.1), learned("GapBall")
    door = learned("BlockedDoor")
    found = resolve(registry, scenario(worse, "BlockedDoor", best), "paddle", (0, 4)).required()
    assert found == {0: (worse, door, best), 4: (worse, door, best)}


def test_a_policy_that_a_task_brings_in_again_is_refused(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("GapBall")
    asked = scenario("policy-1", "OpenGoal", "GapBall")
    message, hint = refusal(UsageError, registry, asked, "paddle", (0,))
    assert message == "policy-1 is the best policy for GapBall: it would be reused twice"
    assert hint == "name policy-1 or GapBall alone"


@pytest.mark.parametrize("beside", ["GapBall", "policy-2"])
def test_what_would_stand_in_for_a_policy_may_stand_beside_it(
    registry: Registry, learned: Callable[..., str], beside: str
) -> None:
    learned("GapBall", "ppo")
    learned("GapBall")
    learned("GapBall", success=0.1)
    _, hint = refusal(UsageError, registry, scenario("policy-1", beside), "paddle", (0,))
    assert hint == f"leave out policy-1, as {beside} stands beside it"
    assert resolve(registry, scenario(beside), "paddle", (0,)).required() == {0: ("policy-2",)}


NAMED = [
    # (task, domain and method of policy-1, message, hint)
    ("CoffeeMaze", "maze2d", "hdm", f"solves CoffeeMaze of maze2d; {TARGET} is of minigrid", "policies"),
    ("Unheard", "minigrid", "hdm", "solves Unheard, which is no task here", "run: paddlectl policies"),
    ("GapBall", "minigrid", "ppo", "was learned by ppo; paddle reuses what hdm learned", "name GapBall ins"),
    ("GapBall", "minigrid", "random", "was learned by random; paddle reuses", "run: paddlectl train GapBall"),
    ("GapBall", "minigrid", "hdqn", "was learned by hdqn; paddle reuses what hdm learned", "GapBall"),
    ("OpenGoal", "minigrid", "ppo", "was learned by ppo; paddle reuses", "name policy-2 instead"),
]


@pytest.mark.parametrize(("task", "domain", "method", "told", "hint"), NAMED)
def test_a_named_policy_that_cant_be_reused(
    registry: Registry, learned: Callable[..., str], task: str, domain: str, method: str, told: str, hint: str
) -> None:
    assert learned(task, method, domain=domain) == "policy-1"
    learned("OpenGoal")
    # before what is missing: no training would help
    found = refusal(UsageError, registry, scenario("DoorBall", "policy-1"), "paddle", (0,))
    assert found[0].startswith(f"policy-1 {told}")
    assert hint in found[1]


def test_the_hint_for_a_policy_of_another_kind_names_the_method_that_teaches(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("GapBall")
    _, hint = refusal(UsageError, registry, scenario("policy-1"), PUPIL, (0,))
    assert hint == "name GapBall instead, and run: paddlectl train GapBall --method ppo"


def test_a_named_policy_that_isnt_there_is_told_with_the_nearest(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("GapBall")
    found = refusal(NotFoundError, registry, scenario("policy-11"), "paddle", (0,))
    assert found == ("no policy policy-11", "did you mean policy-1? or run: paddlectl policies")


def test_what_is_missing_is_told_with_the_command_that_learns_it(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("BlockedDoor", "random", success=1.0)
    learned("GapBall", seed=1)
    best, both = scenario("BlockedDoor", "GapBall", "BoxDoor"), paired("BlockedDoor", "GapBall")
    for asked, method, seeds, message, command in (
        (best, "paddle", (5,), "BlockedDoor, BoxDoor by hdm", "BlockedDoor BoxDoor"),
        (best, PUPIL, (5,), "BlockedDoor, GapBall, BoxDoor by ppo",
         "BlockedDoor GapBall BoxDoor --method ppo"),
        (both, "paddle", (2,), "BlockedDoor, GapBall with seed 2 by hdm", "BlockedDoor GapBall --seed 2"),
        (both, PUPIL, (0, 1, 2), "BlockedDoor, GapBall with seeds 0-2 by ppo",
         "BlockedDoor GapBall --seeds 0-2 --method ppo"),
        (both, "paddle", (7, 0, 1, 2),
         "BlockedDoor with seeds 0-2,7 and GapBall with seeds 0,2,7 by hdm",
         "BlockedDoor --seeds 0-2,7, then paddlectl train GapBall --seeds 0,2,7"),
        (both, "paddle", (1,), "BlockedDoor with seed 1 by hdm", "BlockedDoor --seed 1"),
    ):  # fmt: skip
        found = refusal(NotFoundError, registry, asked, method, seeds)
        assert found == (f"no policy for {message}", f"run: paddlectl train {command}")


def test_what_is_missing_is_trained_by_a_job_for_each_task_and_seed(
    registry: Registry, learned: Callable[..., str]
) -> None:
    learned("GapBall", "ppo", seed=1)
    found = resolve(registry, paired("BlockedDoor", "GapBall"), PUPIL, (1, 2))
    lacking = [("BlockedDoor", 1), ("BlockedDoor", 2), ("GapBall", 2)]
    assert found.missing == [TrainJob(task, seed, method="ppo") for task, seed in lacking]
    assert found.ids == {}
    found = resolve(registry, scenario("OpenGoal", "GapBall"), PUPIL, (1, 2))
    assert found.missing == [TrainJob("OpenGoal", 0, method="ppo")]


def test_without_a_registry_every_task_is_missing() -> None:
    command = unlearned(paired("BlockedDoor", "GapBall"), "hdm", (3, 4)).command()
    assert command == "paddlectl train BlockedDoor GapBall --seeds 3-4"
    assert unlearned(scenario("policy-2", "GapBall"), "hdm", (3, 4)).command() == "paddlectl train GapBall"


def test_to_look_up_a_thousand_paired_seeds_costs_little(
    registry: Registry, learned: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    usual = Index._transaction
    monkeypatch.setattr(Index, "_transaction", lambda *given: (asked.append(1), usual(*given))[1])
    learned("GapBall")
    asked.clear()
    found = resolve(registry, paired("GapBall", "OpenGoal"), "paddle", range(1000))
    assert len(found.missing) == 1999
    assert len(asked) <= 4


# What a run was begun with goes with it


@pytest.fixture
def twice(sources: Path, tmp_path: Path) -> Registry:
    """Two sources of seed 0 and of seed 1, all hardly trained."""
    shutil.copytree(sources, tmp_path / "twice")
    registry = Registry.open(tmp_path / "twice")
    for policy in registry.policies()[::-1]:
        told = {k: v for k, v in dataclasses.asdict(policy).items() if k not in ("id", "created")}
        registry.add_policy(**told | {"seed": 1, "checkpoint": registry.read_checkpoint(policy)})
    return registry


def test_a_paired_transfer_is_resumed_explained_exported_and_imported(
    twice: Registry, tmp_path: Path
) -> None:
    asked = paired("BlockedDoor", "GapBall")
    ids = resolve(twice, asked, "paddle", (0, 1)).required()
    assert len({*ids[0], *ids[1]}) == 4
    job = TransferJob(asked, ids[1], "paddle", 1, 8 * 32 * 4, changes=SMALL)
    with small():
        unbroken = run_transfer(job, twice, quiet)
        with suppress(KeyboardInterrupt):
            run_transfer(job, twice, quiet, Checkpointer(stop=StopAfter(2)))
        run = twice.runs()[0]
        assert (run.status, run.sources) == ("interrupted", ids[1])
        assert (job_of(run).scenario, job_of(run).sources) == (asked, ids[1])  # type: ignore[union-attr]
        newer = twice.policy(ids[1][1])
        told = {k: v for k, v in dataclasses.asdict(newer).items() if k not in ("id", "created")}
        twice.add_policy(**told | {"checkpoint": twice.read_checkpoint(newer)})  # comes too late for this run
        row = resume(run.id, twice, quiet, Checkpointer())
    assert row["sources"] == unbroken["sources"] == list(ids[1])
    assert twice.policy(row["policy"]).checkpoint == twice.policy(unbroken["policy"]).checkpoint
    assert explanation_document(twice, twice.run(run.id))["sources"] == list(ids[1])
    bundles.export(twice, run.id, tmp_path / "x.zip")
    taken = bundles.import_(lambda: Registry.open(tmp_path / "other"), tmp_path / "x.zip")
    imported = Registry.open(tmp_path / "other").run(taken["run"])
    assert imported.settings["scenario"]["sources"] == {"tasks": ["BlockedDoor", "GapBall"], "seed": "paired"}
    assert imported.sources == tuple(f"elsewhere:{policy}" for policy in ids[1])


# The command line, but that its runs are small and in its own process.
COMMAND = """
import sys
from dataclasses import replace
from paddlectl.cli.app import main
from paddlectl.experiments import processes
from paddlectl.experiments.runner import run_transfer
from paddlectl.registry.store import Registry
from small_transfer import SMALL
from trials.runs import quiet, small

def run_jobs(jobs, location, *_):
    with small(), Registry.open(location) as registry:
        return [run_transfer(replace(job, changes=SMALL), registry, quiet) for job in jobs]

processes.run_jobs = run_jobs
sys.exit(main())
"""


def test_the_command_gives_each_paired_seed_its_own_sources(twice: Registry, tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    sources = "{tasks: [BlockedDoor, GapBall], seed: paired}"
    file.write_text(f"name: A\ntarget: {TARGET}\nsources: {sources}\nseeds: 0-1\nframes: 1\n")
    line = [sys.executable, "-c", COMMAND, "transfer", str(file), "--registry", twice.location, "--json"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}:{ROOT / 'tests'}"}
    done = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    ids = resolve(twice, paired("BlockedDoor", "GapBall"), "paddle", (0, 1)).required()
    plan = "; ".join(f"{', '.join(ids[seed])} (seed {seed})" for seed in ids)
    assert done.stderr.splitlines()[0] == f"sources: {plan}"
    rows = {row["seed"]: row for row in json.loads(done.stdout)["runs"]}
    assert {seed: tuple(row["sources"]) for seed, row in rows.items()} == ids
    assert {seed: twice.run(row["run"]).sources for seed, row in rows.items()} == ids
