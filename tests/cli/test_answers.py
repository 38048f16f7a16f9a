"""What the commands answer about a registry whose numbers are known: JSON for scripts, text for people."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import insert, select, update

import paddlectl
from paddlectl.experiments.jobs import TransferJob
from paddlectl.registry.schema import policies, runs
from paddlectl.registry.store import Registry
from paddlectl.report.summary import MOST_LINES
from paddlectl.tasks.stock.families import FAMILIES
from samples import GAP_BALL, ROOT, TARGET, Command, add_source, add_transfer, body, program

Process = Callable[..., subprocess.CompletedProcess[str]]


def psi(literals: int, heads: int = 1) -> float:
    return 0.8 * literals / 6 + 0.2 * heads / 7


# Target scene: for each source how many of its 6 literals agree, how many heads, and the scenes that tie.
BY_HAND = {
    "": (psi(4), ["E", "K"], psi(5), [""]),
    "E": (psi(5), ["E"], psi(5), ["E"]),
    "K": (psi(5), ["K"], psi(4), ["", "KO"]),
    "X": (psi(4), ["EX"], psi(4), [""]),
    "B": (psi(4), ["EB"], psi(5), [""]),
    "G": (psi(4), ["E", "K"], psi(4), [""]),
    "O": (psi(3), ["E", "K"], psi(4, 2), ["EO"]),
    "EX": (psi(5), ["EX"], psi(4), ["E"]),
    "EB": (psi(5), ["EB"], psi(5), ["E"]),
    "EO": (psi(4), ["E"], psi(5, 2), ["EO"]),
    "KO": (psi(4), ["K"], psi(5), ["KO"]),
    "GO": (psi(3), ["E", "K"], psi(3, 2), ["EO"]),
    "EOX": (psi(4), ["EX"], psi(4, 2), ["EO"]),
}


def test_similarity_by_hand(registry: Registry, command: Command) -> None:
    answer = command(
        "similarity", "--target", TARGET, "--source", "BlockedDoor", "--source", "GapBall", "--json"
    )
    found = answer.json
    assert list(found) == ["target", "body_weight", "head_weight", "sources", "scenes", "overall"]
    assert (found["target"], found["body_weight"], found["head_weight"]) == (TARGET, 0.8, 0.2)
    assert found["sources"] == ["policy-1", "policy-2"]
    scenes = {tuple(scene["body"]): scene for scene in found["scenes"]}
    for true, (blocked, blocked_scenes, gap, gap_scenes) in BY_HAND.items():
        scene = scenes[tuple(body(TARGET, true))]
        assert len(scene["heads"]) == 7
        assert scene["self_similarity"] == pytest.approx(max(blocked, gap), abs=1e-12)
        one, two = scene["matches"]
        assert (one["policy"], one["task"]) == ("policy-1", "BlockedDoor")
        assert one["similarity"] == pytest.approx(blocked, abs=1e-12)
        assert one["scenes"] == [body("BlockedDoor", each) for each in blocked_scenes]
        assert two["similarity"] == pytest.approx(gap, abs=1e-12)
        assert two["scenes"] == [body("GapBall", each) for each in gap_scenes]


def test_similarity_without_sources_takes_the_best_of_every_other_task(
    registry: Registry, command: Command
) -> None:
    assert command("similarity", "--target", TARGET, "--json").json["sources"] == ["policy-1", "policy-2"]
    assert command("similarity", "--target", "GapBall", "--json").json["sources"] == ["policy-3", "policy-1"]


def test_a_source_named_twice_counts_once(registry: Registry, command: Command) -> None:
    answer = command(
        "similarity", "--target", TARGET, "--source", "GapBall", "--source", "policy-2", "--json"
    )
    assert answer.json["sources"] == ["policy-2"]


def test_similarity_takes_of_a_task_the_policy_that_a_transfer_would(
    registry: Registry, command: Command
) -> None:
    for method, text in (("ppo", None), ("random", program("GapBall", GAP_BALL))):
        add_source(registry, "GapBall", text, method=method, success_rate=1.0)
    for more in ((), ("--source", "BlockedDoor", "--source", "GapBall")):
        found = command("similarity", "--target", TARGET, *more, "--json").json
        assert found["sources"] == ["policy-1", "policy-2"]


def test_one_weight_leaves_the_rest_to_the_other(registry: Registry, command: Command) -> None:
    answer = command("similarity", "--target", TARGET, "--body-weight", "0.7", "--json").json
    assert (answer["body_weight"], answer["head_weight"]) == (0.7, 0.3)


def test_tasks(command: Command) -> None:
    tasks = command("tasks", "--json").json["tasks"]
    assert len(tasks) == 10 + len(FAMILIES)
    columns = ["name", "domain", "horizon", "heads", "vocabulary", "summary", "presets", "definition"]
    assert all(list(task) == columns for task in tasks)
    presets = {task["name"]: task["presets"] for task in tasks if task["presets"]}
    assert presets == {name: ["paper"] for name in ("CoffeeMaze", "MailMaze", "CoffeeMailMaze")}
    box_door = next(task for task in tasks if task["name"] == "BoxDoor")
    assert box_door["heads"] == ["gt_box()", "gt_key()", "gt_door()"]
    assert box_door["horizon"] == 320


def test_policies_and_runs(registry: Registry, command: Command) -> None:
    solved = command("policies", "--json").json["policies"]
    assert [(row["policy"], row["task"]) for row in solved] == [
        ("policy-3", TARGET),
        ("policy-2", "GapBall"),
        ("policy-1", "BlockedDoor"),
    ]
    assert solved[0]["success_rate"] == 0.97
    begun = command("runs", "--json").json["runs"]
    assert [(row["run"], row["kind"], row["status"]) for row in begun] == [
        ("run-3", "transfer", "finished"),
        ("run-2", "train", "finished"),
        ("run-1", "train", "finished"),
    ]
    assert begun[0]["sources"] == ["policy-1", "policy-2"]
    assert begun[0]["policy"] == "policy-3"


@pytest.mark.parametrize("name", ["runs", "policies"])
def test_lists_show_the_newest_and_say_how_many_more_there_are(
    registry: Registry, command: Command, name: str
) -> None:
    with registry.index.writing() as connection:
        for table in (runs, policies):
            row = connection.execute(select(table).where(table.c.id == 1)).mappings().one()
            connection.execute(insert(table), [{**row, "id": number} for number in range(4, 1104)])
    kind = name[:-1] if name == "runs" else "policy"
    found = command(name, "--json").json
    assert (list(found), found["total"], len(found[name])) == ([name, "total"], 1103, 50)
    assert [row[kind] for row in found[name][:2]] == [f"{kind}-1103", f"{kind}-1102"]
    text = command(name).out.splitlines()
    assert text[-1] == "1,053 more; --all lists them"
    assert (sum(f"{kind}-" in line for line in text)) == 50
    assert len(command(name, "--limit", "7", "--json").json[name]) == 7
    found = command(name, "--all", "--json").json
    assert (found["total"], len(found[name])) == (1103, 1103)
    text = command(name, "--all").out
    assert "more" not in text and sum(f"{kind}-" in line for line in text.splitlines()) == 1103
    assert command(name, "--limit", "1103").out == text


def test_show(registry: Registry, command: Command) -> None:
    found = command("show", "BlockedDoor", "--json").json
    fields = ["policy", "task", "clauses", "minimised", "definition", "settings", "rules", "unusual"]
    assert sorted(found) == sorted(fields)
    assert (found["policy"], found["task"]) == ("policy-1", "BlockedDoor")
    assert found["clauses"][0] == {
        "head": "gt_blockage()",
        "body": body("BlockedDoor", "EX"),
        "probability": 0.98,
    }
    assert "put_blockage() :- has_blockage(agent)" in found["minimised"]
    text = command("show", "policy-1").out
    assert "0.97 :: put_blockage() :-" in text


def test_explain(registry: Registry, command: Command) -> None:
    found = command("explain", "run-3", "--json").json
    assert (found["run"], found["method"], found["target"]) == ("run-3", "paddle", TARGET)
    assert found["sources"] == ["policy-1", "policy-2"]
    assert found["program"]["policy"] == "policy-3"
    similarity = command("similarity", "--target", TARGET, "--json").json
    assert found["mapping"] == {name: value for name, value in similarity.items() if name != "overall"}
    assert len(found["weights"]) == 7
    assert {"scene", "policy", "similarity", "performance", "weight", "chosen", "phase"} <= set(
        found["weights"][0]
    )
    assert found["trace"][0]["guide"] == "policy-1"
    assert found["trace_scores"] == {"early": 0.9, "late": 0.0}


def test_explain_says_who_led_and_why(registry: Registry, command: Command) -> None:
    told = " ".join(command("explain", "--full").out.split())
    assert (
        "Early: BlockedDoor led 96 % of 400 decisions; of these 100 % as its Λ was the largest. Its subgoal"
        " (likeliest: gt_blockage()) was reached in 95 %. At the end of the phase its Λ was 1.10 (ψ 0.69,"
        " Φ 0.41), GapBall's 0.76." in told
    )
    assert "Late: the target itself led 70 % of 100 decisions" in told
    assert (
        "GapBall led 100 % of 50 decisions; of these 100 % as its Λ was the largest. Its subgoal (likeliest:"
        " gt_key()) was reached in 50 %. At the end of the phase its Λ was 0.99 (ψ 0.69, Φ 0.30)." in told
    )
    assert "BlockedDoor → gt_blockage(), 12 steps, reached" in told
    assert (
        "jump-start 0.70, final score 0.88, final success 90 %, area under the curve 0.80,"
        " unseen success 97 %" in told
    )


def test_explain_is_short_unless_all_is_asked_for(registry: Registry, command: Command) -> None:
    told = command("explain").out
    assert len(told.splitlines()) <= MOST_LINES
    assert "jump-start 0.70" in told and "In the end the target leads in the one scene" in " ".join(
        told.split()
    )
    assert told.endswith("all of it: paddlectl explain run-3 --full\n")
    assert len(command("explain", "--full").out.splitlines()) > MOST_LINES


def test_explain_takes_the_newest_transfer(registry: Registry, command: Command) -> None:
    add_transfer(registry)
    add_source(registry, "GapBall", program("GapBall", GAP_BALL))
    assert command("explain", "--json").json["run"] == "run-4"
    assert command("explain", "latest", "--json").json["run"] == "run-4"


def test_text_fits_a_hundred_columns(registry: Registry, command: Command) -> None:
    for line in (
        "explain",
        "explain --full",
        "runs",
        "policies",
        "show GapBall",
        f"similarity --target {TARGET}",
    ):
        assert max(map(len, command(*line.split()).out.splitlines())) <= 100


def test_from_scratch_no_source_is_needed(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[TransferJob] = []

    def run_jobs(jobs: list[TransferJob], *_: object) -> list[dict[str, str]]:
        asked.extend(jobs)
        return [{"run": "run-1"}]

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    answer = command("transfer", ROOT / "scenarios" / "A.yaml", "--method", "hdm", "--seed", "0", "--json")
    assert (answer.code, answer.json["runs"]) == (0, [{"run": "run-1"}])
    assert [(job.method, job.sources) for job in asked] == [("hdm", ())]


LISTS = ("runs", "policies", "tasks", "registry check")
TEXTS = ("show GapBall", f"similarity --target {TARGET}", "explain")


@pytest.mark.parametrize("line", LISTS + TEXTS)
def test_half_an_id_is_never_shown(
    registry: Registry, command: Command, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_transfer(registry)
    (registry.folder / "objects" / "left").write_text("")
    ids = {"runs": "run-4 policy-4", "policies": "run-4 policy-4", "explain": "run-4: BlockedDoor"}
    for width in (20, 47, 79, 80, 99, 200):
        monkeypatch.setenv("COLUMNS", str(width))
        lines = command(*line.split()).out.splitlines()
        assert all(len(text.rstrip()) <= max(width, 36) for text in lines), width
        assert all(any(name in text for text in lines) for name in ids.get(line, "").split()), width


def test_an_unknown_width_and_a_narrow_encoding(registry: Registry, process: Process) -> None:
    where = {"PADDLECTL_REGISTRY": registry.location, "COLUMNS": "0", "PYTHONIOENCODING": "ascii"}
    told = process("similarity", "--target", TARGET, **where)
    assert (told.returncode, told.stderr) == (0, "")
    assert "Psi of BlockedBoxUnlockPickup from BlockedDoor (policy-1)" in told.stdout
    assert "has_key(agent)" in told.stdout


def test_stored_text_is_no_markup_and_steers_no_terminal(registry: Registry, command: Command) -> None:
    with registry.index.writing() as connection:
        connection.execute(update(runs).values(scenario="[red]A[/red]\x1b[2J\x9b\u202e"))
    out = command("runs").out
    assert "[red" in out
    assert not set("\x1b\x9b\u202e") & set(out)


def test_an_interrupted_transfer_is_explained_as_far_as_it_went(registry: Registry, command: Command) -> None:
    run = registry.add_run(
        kind="transfer", method="hdm", task=TARGET, scenario="A", sources=(), seed=0, settings={}, versions={}
    )
    registry.finish_run(run.id, status="interrupted", frames=10, episodes=0, seconds=0.1, results={})
    found = command("explain", run.id, "--json").json
    assert (found["program"], found["mapping"], found["weights"], found["trace"]) == (None, None, [], [])
    assert "No policy was stored: the run is interrupted." in command("explain", run.id).out


def test_the_version(command: Command) -> None:
    answer = command("--version")
    assert (answer.code, answer.out, answer.err) == (0, f"paddlectl {paddlectl.__version__}\n", "")


def test_explain_writes_a_page_and_replaces_nothing_but_a_page(
    registry: Registry, command: Command, tmp_path: Path
) -> None:
    answer = command("explain", "run-3", "--html", str(tmp_path / "x.html"))
    assert answer.code == 0 and "run-3 is explained in" in answer.out
    assert (tmp_path / "x.html").read_text().startswith("<!doctype html>")
    (tmp_path / "mine.py").write_text("mine")
    (tmp_path / "link.html").symlink_to(tmp_path / "mine.py")
    os.mkfifo(tmp_path / "pipe.html")
    for name in ("", "no/x.html", "mine.py", "link.html", "pipe.html"):
        assert command("explain", "run-3", "--html", str(tmp_path / name)).code == 2, name
    assert (tmp_path / "mine.py").read_text() == "mine" and (tmp_path / "pipe.html").is_fifo()
    assert "can't be written" in command("explain", "run-3", "--html", "/proc/x.html").err
