"""Which runs of a registry are a study's cells, and what is to be run for it."""

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import update

from entered import entered
from paddlectl.errors import InvalidFileError
from paddlectl.experiments.jobs import RandomJob, ResumeJob, TrainJob, TransferJob
from paddlectl.experiments.runner import rules_of, settings_of
from paddlectl.registry.schema import runs
from paddlectl.registry.store import Registry
from paddlectl.studies.cells import Cell, cells_of
from paddlectl.studies.study import load_study
from paddlectl.studies.sweep import Plan, plan
from paddlectl.transfer.guidance import GuidanceSettings
from samples import ROOT

SCENARIOS = ", ".join(str(ROOT / "scenarios" / f"{name}.yaml") for name in ("A", "C"))


def cells(folder: Path, text: str) -> list[Cell]:
    path = folder / "study.yaml"
    path.write_text(f"name: mine\nscenarios: [{SCENARIOS}]\n{text}\n")
    return cells_of(load_study(path))


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    return Registry.open(tmp_path / "registry")


def names(found: Plan, *tried: str) -> list[str]:
    return [step.name for step in found.steps(tried)]


def run_steps(registry: Registry, made: list[Cell]) -> list[str]:
    """Enters all that is to be done next as finished runs."""
    steps = plan(registry, made).steps()
    return [entered(registry, step.job) for step in steps]


def test_what_a_file_of_results_has_needs_neither_a_run_nor_sources(
    registry: Registry, tmp_path: Path
) -> None:
    made = cells(tmp_path, "methods: [paddle, hdm]\nseeds: 0")
    kept = {cell.identity for cell in made if cell.scenario.name == "A"}
    found = plan(registry, made, kept)
    assert [each.state for _, each in found.cells] == ["kept", "kept", "waiting", "kept"]
    assert names(found) == ["BlockedDoor hdm seed 0", "BoxDoor hdm seed 0"]
    assert {source.name for source in found.sources} == set(names(found))
    run_steps(registry, [made[1]])
    now = plan(registry, made, kept).cells
    assert [each.state for _, each in now] == ["kept", "finished", "waiting", "finished"]


def test_all_of_one_seed_come_together_and_variants_are_for_their_methods(tmp_path: Path) -> None:
    variants = "variants: {usual: {}, other: {methods: [paddle], rules: {target_floor: 0.0}}}"
    made = cells(tmp_path, f"methods: [paddle, hdm]\nseeds: 0-1\n{variants}")
    assert [cell.name for cell in made[:6]] == [
        "A paddle usual seed 0", "A hdm usual seed 0", "A paddle other seed 0",
        "C paddle usual seed 0", "C hdm usual seed 0", "C paddle other seed 0",
    ]  # fmt: skip
    assert {cell.seed for cell in made[6:]} == {1} and len(made) == 12
    assert made[2].rules.target_floor == 0.0 and made[0].rules is None
    assert made[0].frames == 400_000, "the scenario's own"


def test_sources_come_first_then_each_transfer_once(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle, hdm, cup]\nseeds: 3\nframes: 1000")
    assert names(plan(registry, made)) == [
        "BlockedDoor hdm seed 3", "GapBall hdm seed 3", "BlockedDoor ppo seed 3", "GapBall ppo seed 3",
        "BoxDoor hdm seed 3", "BoxDoor ppo seed 3",
    ]  # fmt: skip
    run_steps(registry, made)
    now = plan(registry, made)
    # hdm reuses nothing, so that it is the same in both scenarios
    assert names(now) == [
        "A paddle seed 3",
        "A hdm seed 3",
        "A cup seed 3",
        "C paddle seed 3",
        "C cup seed 3",
    ]
    jobs = {step.name: step.job for step in now.steps()}
    policies = {run.id: run.policy for run in registry.runs()}
    assert jobs["A cup seed 3"].sources == (policies["run-3"], policies["run-4"])
    assert jobs["C paddle seed 3"].sources == (policies["run-1"], policies["run-5"])
    run_steps(registry, made)
    whole = plan(registry, made)
    assert names(whole) == [] and whole.count("finished") == 6
    runs = {cell.name: found.run and found.run.id for cell, found in whole.cells}
    assert runs["A hdm seed 3"] == runs["C hdm seed 3"]


CHANGES: dict[str, Callable[[TransferJob], dict[str, Any]]] = {
    "frames": lambda job: {"frames": job.frames + 1},
    "seed": lambda job: {"seed": 4},
    "settings": lambda job: {"changes": {"num_envs": 3}},
    "rules": lambda job: {"rules": GuidanceSettings(source_memory=9.0)},
    "sources": lambda job: {"sources": job.sources[::-1]},
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_a_run_that_differs_in_anything_is_another(change: str, registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle]\nseeds: 3\nframes: 1000")
    run_steps(registry, made)
    (job, *_) = [step.job for step in plan(registry, made).steps()]
    entered(registry, dataclasses.replace(job, **CHANGES[change](job)))
    assert names(plan(registry, made)) == ["A paddle seed 3", "C paddle seed 3"]
    entered(registry, job)
    assert names(plan(registry, made)) == ["C paddle seed 3"]


def test_similarity_and_guidance_count_where_a_source_is_reused(registry: Registry, tmp_path: Path) -> None:
    text = "methods: [paddle, hdm]\nseeds: 3\nframes: 1000\nvariants: {usual: {}, body: {similarity: "
    made = cells(tmp_path, text + "{body_weight: 1.0, head_weight: 0.0}}, paper: {guidance: {mode: paper}}}")
    run_steps(registry, made)
    found = names(plan(registry, made))
    assert [name for name in found if "hdm" in name] == ["A hdm usual seed 3"]
    assert len([name for name in found if "paddle" in name]) == 6


def test_later_runs_of_the_same_change_nothing(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle]\nseeds: 3\nframes: 1000")
    run_steps(registry, made)
    run_steps(registry, made)
    before = {cell.name: found.run and found.run.id for cell, found in plan(registry, made).cells}
    entered(registry, TrainJob("BlockedDoor", 3))  # a newer one of the same
    entered(registry, TrainJob("BlockedDoor", 3, 99))  # and one of another budget
    now = plan(registry, made)
    assert {cell.name: found.run and found.run.id for cell, found in now.cells} == before


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


def test_numbers_that_came_later_are_their_defaults(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [hdm]\nseeds: 3\nframes: 1000")
    (step,) = plan(registry, made).steps()

    def older(settings: dict[str, Any]) -> None:
        del settings["learning"]["sharpness"], settings["learning"]["low_level"]["value_coef"]
        settings["learning"]["lanes"] = settings["learning"].pop("num_envs")
        settings["learning"]["credit"] = {
            name: _whole(value) for name, value in settings["learning"]["credit"].items()
        }

    entered(registry, step.job, change=older)
    assert names(plan(registry, made)) == []

    def another(settings: dict[str, Any]) -> None:
        settings["learning"]["sharpness"] = 9.0

    other = cells(tmp_path, "methods: [hdm]\nseeds: 4\nframes: 1000")
    (step,) = plan(registry, other).steps()
    entered(registry, step.job, change=another)
    assert names(plan(registry, other)) == ["A hdm seed 4"]


def test_what_was_stopped_goes_on_and_what_runs_elsewhere_is_left(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [hdm]\nseeds: 3\nframes: 1000")
    (step,) = plan(registry, made).steps()
    stopped = entered(registry, step.job, "interrupted")
    assert [step.job for step in plan(registry, made).steps()] == [ResumeJob(stopped)]
    failed = entered(registry, dataclasses.replace(step.job, frames=7), "failed")
    text = "methods: [hdm]\nseeds: 3\nframes: 7"
    assert [step.job for step in plan(registry, cells(tmp_path, text)).steps()] == [ResumeJob(failed)]
    with registry.files.hold(stopped):
        registry.resume_run(stopped)
        now = plan(registry, made)
        assert names(now) == [] and [run.id for run in now.elsewhere] == [stopped] * 2
    assert [step.job for step in plan(registry, made).steps()] == [ResumeJob(stopped)]


def test_a_run_that_cant_go_on_is_begun_anew(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle]\nseeds: 3\nframes: 1000")
    sources = plan(registry, made).steps()
    stopped = [entered(registry, step.job, "interrupted") for step in sources]
    now = plan(registry, made)
    assert [step.job for step in now.steps()] == [ResumeJob(run) for run in stopped]
    assert now.steps({*stopped[:1]})[0].job == sources[0].job
    assert now.steps({*stopped, *(step.name for step in sources)}) == []
    newer = [entered(registry, step.job, "interrupted") for step in sources]
    assert [step.job for step in plan(registry, made).steps()] == [ResumeJob(run) for run in newer]


def test_policies_that_have_learned_nothing(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle]\nseeds: 3\nvariants: {random: {random: [BoxDoor, OpenGoal]}}")
    steps = plan(registry, made).steps()
    assert [step.job for step in steps] == [
        TrainJob("BlockedDoor", 3), TrainJob("GapBall", 3), RandomJob("BoxDoor", 3), RandomJob("OpenGoal", 3),
    ]  # fmt: skip
    entered(registry, RandomJob("BoxDoor", 3), "interrupted")
    assert RandomJob("BoxDoor", 3) in [step.job for step in plan(registry, made).steps()]
    run_steps(registry, made)
    jobs = {step.name: step.job for step in plan(registry, made).steps()}
    tasks = {name: [registry.policy(source).task for source in job.sources] for name, job in jobs.items()}
    assert tasks == {
        "A paddle random seed 3": ["BlockedDoor", "GapBall", "BoxDoor", "OpenGoal"],
        "C paddle random seed 3": ["BlockedDoor", "BoxDoor", "OpenGoal"],
    }


def test_what_failed_stops_nothing_else(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle]\nseeds: 3\nframes: 1000")
    for step in plan(registry, made).steps():
        if step.task != "GapBall":
            entered(registry, step.job)
    now = plan(registry, made)
    failed = ["GapBall hdm seed 3"]
    assert names(now) == failed
    assert names(now, *failed) == ["C paddle seed 3"]
    assert now.lacking(failed, failed) == {"A paddle seed 3": "its source failed: GapBall hdm seed 3"}


OWN = "settings: {low_level: {clip: 0.1}, num_envs: 8}\nrules: {target_floor: 0, source_memory: 3}\n"


def test_the_numbers_of_a_scenario_count_and_a_variants_go_over_them(
    registry: Registry, tmp_path: Path
) -> None:
    (tmp_path / "own.yaml").write_text((ROOT / "scenarios" / "A.yaml").read_text() + OWN)
    study = tmp_path / "study.yaml"
    variants = "own: {}, other: {settings: {low_level: {clip: 0.3}}, rules: {source_memory: 4}}"
    text = f"name: mine\nmethods: [paddle]\nseeds: 3\nframes: 1000\nvariants: {{{variants}}}\n"
    study.write_text(f"{text}scenarios: [own.yaml]\n")
    made = cells_of(load_study(study))
    run_steps(registry, made)
    own, other = (step.job for step in plan(registry, made).steps())
    assert isinstance(own, TransferJob) and isinstance(other, TransferJob)
    for job, clip, memory in ((own, 0.1, 3), (other, 0.3, 4)):
        settings, rules = settings_of(job), rules_of(job)
        assert (settings.num_envs, settings.low_level.clip) == (8, clip)
        assert (rules.target_floor, rules.source_memory) == (0.0, memory)
    plain = dataclasses.replace(own, scenario=own.scenario.model_copy(update={"settings": {}, "rules": {}}))
    entered(registry, plain)
    assert len(names(plan(registry, made))) == 2, "a run by the usual numbers is none of them"
    typed = {"settings": {"low_level": {"clip": 0.1}, "num_envs": 8}, "rules": rules_of(own)}
    entered(registry, dataclasses.replace(plain, changes=typed["settings"], rules=typed["rules"]))
    assert names(plan(registry, made)) == [f"{made[1].name}"], "by --set the same as by the file"
    run_steps(registry, made)
    assert names(plan(registry, made)) == []


def test_a_run_of_a_version_that_lacked_a_number_is_a_cell_still(registry: Registry, tmp_path: Path) -> None:
    made = cells(tmp_path, "methods: [paddle, cup]\nseeds: 3\nframes: 1000")
    while run_steps(registry, made):
        pass
    with registry.index.writing() as connection:
        for run in registry.runs():
            told = json.loads(json.dumps(run.settings))
            learning = told["learning"]
            for part in (learning.get("low_level"), learning.get("learner")):
                assert part is None or part.pop("hidden")
            learning.pop("critic_hidden", None)
            row = update(runs).where(runs.c.id == int(run.id.removeprefix("run-")))
            connection.execute(row.values(settings=json.dumps(told)))
    assert names(plan(registry, made)) == []


def test_a_study_learns_named_sources_by_numbers_that_all_its_methods_have(tmp_path: Path) -> None:
    good, path = (ROOT / "scenarios" / "A.yaml").read_text(), tmp_path / "own.yaml"
    for text, told in (
        (good.replace("[BlockedDoor, GapBall]", "{auto: 2}"), "its sources are chosen (auto)"),
        (f"{good}settings: {{low_level: {{clip: 0.1}}}}\n", "settings.low_level: cup: no setting low_level"),
    ):
        path.write_text(text)
        study = tmp_path / "study.yaml"
        study.write_text(
            "name: mine\nmethods: [paddle, cup]\nseeds: 3\nscenarios: [own.yaml]\nvariants: {v: {}}\n"
        )
        with pytest.raises(InvalidFileError, match=re.escape(told)):
            load_study(study)
