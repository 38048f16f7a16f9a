"""`compare`, of a registry's runs and of a file of results."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from paddlectl.cli.completion import compared_names, figure_names
from paddlectl.registry.store import Registry
from paddlectl.studies.results import write_results
from samples import ROOT, TARGET, Command, add_policy, reuse
from studies.made import SIX, moved, results

EPISODES = 600  # as many frames as run-3


def add(
    registry: Registry,
    method: str = "paddle",
    seed: int = 0,
    score: float = 0.7,
    scenario: str | None = "A",
    task: str = TARGET,
    status: str = "finished",
    settings: Mapping[str, Any] = MappingProxyType({}),
    episodes: int = EPISODES,
) -> str:
    """A transfer, each episode of which had that score."""
    run = registry.add_run(
        kind="transfer", method=method, task=task, scenario=scenario, sources=("policy-1", "policy-2"),
        seed=seed, settings=settings, versions={},
    )  # fmt: skip
    rows = [
        {
            "order": n,
            "started": 100 * n,
            "frames": 100 * n + 90,
            "score": score,
            "length": 90,
            "success": True,
        }
        for n in range(episodes)
    ]
    registry.files.append_rows(run.id, "episodes", rows)
    add_policy(registry, run.id, task, None, method=method, seed=seed)
    registry.finish_run(
        run.id, status=status, frames=100 * episodes, episodes=episodes, seconds=1.0, results={}
    )
    return run.id


@pytest.fixture(scope="module")
def many(_made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("many") / "registry"
    shutil.copytree(_made, place)
    with Registry.open(place) as registry:
        for seed in range(4):
            add(registry, "paddle", seed, 0.8 + seed / 100)
            add(registry, "cup", seed, 0.6 + seed / 100)
            add(registry, "cup", seed, 0.5, scenario="B", task="OpenGoal")
    return place


@pytest.fixture
def compared(many: Path, tmp_path: Path) -> Registry:
    """Scenario A by two methods with four seeds, B by one."""
    shutil.copytree(many, tmp_path / "registry")
    return Registry.open(tmp_path / "registry")


A = ("--scenario", "A", "--task", TARGET)


def test_runs_of_a_registry_by_hand(compared: Registry, command: Command) -> None:
    told = command("compare", *A, "--method", "paddle", "--method", "cup", "--json").json
    assert (told["figure"], told["of"], told["labels"]) == ("area_under_curve", "paddle", ["cup", "paddle"])
    cup, paddle = told["cells"]
    assert (paddle["label"], paddle["n"], paddle["seeds"]) == ("paddle", 4, [0, 1, 2, 3])
    assert paddle["source_frames"] == 2000
    assert cup["jump_start"]["mean"]["value"] == pytest.approx(0.615)
    assert paddle["frames_to_success"]["median"]["value"] == 99 * 100 + 90
    assert told["verdicts"]["jump_start"] == ["paddle is ahead of cup in A (jump-start, 4 seeds)"]


def test_it_is_told_in_words(compared: Registry, command: Command) -> None:
    out = " ".join(command("compare", *A, "--figure", "final_score").out.split())
    assert "Final score, with 95 % intervals over seeds" in out
    assert "paddle is ahead of cup in A (final score, 4 seeds)" in out
    assert "note: fewer than 5 seeds" in out
    assert "at 6 seeds" in out


def test_a_trial_does_not_take_the_place_of_a_run(compared: Registry, command: Command) -> None:
    before = command("compare", *A, "--method", "paddle", "--json").json["cells"]
    add(compared, "paddle", 0, 0.1, settings={"unusual": {"rules.target_floor": 0.0}})
    add(compared, "paddle", 1, 0.1, episodes=EPISODES - 1)
    told = command("compare", *A, "--method", "paddle", "--json").json
    assert told["cells"] == before
    (note,) = [note for note in told["notes"] if "left out" in note]
    assert note.startswith("runs left out: 3, ")


def test_of_several_runs_of_a_seed_the_newest_counts(compared: Registry, command: Command) -> None:
    add(compared, "paddle", 0, 0.1, settings={"frames": 3})
    told = command("compare", *A, "--method", "paddle", "--json").json
    assert told["cells"][0]["n"] == 4
    assert told["cells"][0]["final_score"]["mean"]["value"] == pytest.approx((0.1 + 0.81 + 0.82 + 0.83) / 4)
    (note,) = [note for note in told["notes"] if "left out" in note]
    assert note.startswith("runs left out: 2, 2 of them with other settings; ")


def test_what_is_not_finished_is_left_out_and_said(compared: Registry, command: Command) -> None:
    add(compared, "paddle", 9, 0.1, status="interrupted")
    add(compared, "ptf", 9, 0.1, status="interrupted")
    told = command("compare", "--method", "paddle", "--json").json
    assert "unfinished transfers left out: 1" in told["notes"]
    assert all(9 not in cell["seeds"] for cell in told["cells"])


def test_a_run_without_scenario_goes_by_its_task(compared: Registry, command: Command) -> None:
    add(compared, "paddle", 0, 0.5, scenario=None)
    assert command("compare", "--scenario", TARGET, "--json").json["cells"][0]["n"] == 1


def test_an_imported_run_is_compared_though_its_sources_are_elsewhere(
    compared: Registry, command: Command
) -> None:
    run = add(compared, "ptf", 0, 0.5)
    reuse(compared, run, ["elsewhere:policy-1"])
    (cell,) = command("compare", "--method", "ptf", "--json").json["cells"]
    assert cell["source_frames"] is None
    assert command("compare", "--method", "ptf").code == 0


def test_damaged_episodes_are_no_result(compared: Registry, command: Command) -> None:
    for change in (lambda path: path.write_bytes(path.read_bytes()[:5000]), Path.unlink):
        run = add(compared, "ptf", 0, 0.5)
        change(compared.folder / "runs" / run / "episodes.jsonl")
        assert command("compare", "--method", "ptf").code == 5


@pytest.mark.parametrize(
    ("line", "code", "told"),
    [
        ("--method cupp", 4, "is of method cupp; there are"),
        ("--method ptf", 4, "is of method ptf; there are cup, paddle"),
        ("--scenario a", 4, "did you mean A? or run: paddlectl transfer"),
        ("--task GapBal", 4, "there are"),
        ("--scenario B --method paddle", 4, "there are A by cup, A by paddle, B by cup"),
        ("--of cupp", 4, "did you mean cup? or one of: "),
        ("--of ptf", 4, "one of: cup; paddle"),
        ("--figure area", 2, "one of: area_under_curve, jump_start, final_score, frames_to_success"),
        ("--figure jumpstart", 2, "did you mean jump_start?"),
        ("nothing.json", 4, "no file nothing.json"),
        ("nothing.yaml", 4, "nothing.yaml"),
        ("nothing.txt", 2, "neither a study (.yaml) nor a file of results (.json)"),
    ],
)
def test_mistakes_are_told(compared: Registry, command: Command, line: str, code: int, told: str) -> None:
    answer = command("compare", *line.split())
    assert (answer.code, answer.out) == (code, "")
    assert told in answer.err and len(answer.err.splitlines()) <= 2


def test_where_nothing_is_finished_it_says_what_to_run(tmp_path: Path, command: Command) -> None:
    Registry.open(tmp_path / "registry").close()
    answer = command("compare")
    assert answer.code == 4
    assert "run: paddlectl transfer A --train-missing" in answer.err


def test_a_file_of_results_needs_no_registry(tmp_path: Path, command: Command) -> None:
    rows = results({("A", "paddle"): SIX, ("A", "cup"): moved(-0.3), ("B", "cup"): SIX})
    write_results(tmp_path / "r.json", rows)
    told = command("compare", tmp_path / "r.json", "--scenario", "A", "--of", "cup", "--json").json
    assert told["verdicts"]["area_under_curve"] == [
        "cup is behind paddle in A (area under the curve, 6 seeds)"
    ]
    assert not (tmp_path / "registry").exists()
    (tmp_path / "r.json").write_text("[1]")
    assert command("compare", tmp_path / "r.json").code == 3
    (tmp_path / "r.json").write_text("[]")
    assert command("compare", tmp_path / "r.json").code == 4


STUDY = f"""\
name: small
scenarios: [{ROOT}/scenarios/A.yaml]
methods: [paddle, hdm]
seeds: [0, 1]
frames: 2048
"""


def test_a_study_of_which_nothing_is_finished_says_what_to_run(
    registry: Registry, tmp_path: Path, command: Command
) -> None:
    (tmp_path / "study.yaml").write_text(STUDY)
    answer = command("compare", tmp_path / "study.yaml")
    assert answer.code == 4, answer
    assert f"run: paddlectl sweep {tmp_path / 'study.yaml'}" in answer.err


def test_what_the_shell_is_offered(compared: Registry) -> None:
    assert compared_names(compared.location) == ["A", "B"]
    assert "jump_start" in figure_names()


def test_in_a_process_of_its_own(compared: Registry, process) -> None:
    done = process("compare", "--registry", compared.location, COLUMNS="80")
    assert done.returncode == 0 and done.stderr == ""
    assert all(len(line.rstrip()) <= 80 for line in done.stdout.splitlines())


def test_seeds_choose_of_runs_and_of_results(compared: Registry, command: Command, tmp_path: Path) -> None:
    told = command("compare", *A, "--seeds", "1-2", "--json").json
    assert {tuple(cell["seeds"]) for cell in told["cells"]} == {(1, 2)}
    path = tmp_path / "results.json"
    write_results(path, results({("A", "paddle"): SIX, ("A", "cup"): SIX}))
    assert command("compare", path, "--seeds", "3,5", "--json").json["cells"][0]["seeds"] == [3, 5]
    answer = command("compare", path, "--seeds", "12")
    assert answer.code == 4 and "is of seed 12; there are 0, 1, 2, 3, 4, 5" in answer.err
