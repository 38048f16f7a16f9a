"""`--tasks FILE.py`: a user's own tasks by their file, whose code is run where the command line says so."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import inline
import paddlectl
from paddlectl import plugins
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.runner import train_source
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite
from samples import ROOT, Command
from trials.runs import quiet, small

PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
(CAB,) = re.findall(r"```python\n(# cab\.py.*?)```", PAGE, re.DOTALL)
LAKE = """
import numpy as np
from paddlectl.tasks.gymnasium import GymnasiumTask, Subgoal

def home(env):
    return bool(env.s == 15)

def at(env):
    return np.eye(16)[env.s]

TASK = GymnasiumTask(
    env="FrozenLake-v1", domain="lake", horizon=20, frames=64,
    predicates={"is_low(agent)": lambda env: bool(env.s >= 8)},
    subgoals={"gt_home()": Subgoal(home, at)}, success=home, flat=at,
)
TASKS = {"Lake": TASK, "Pond": TASK}
"""


def changed(field: str) -> str:
    """The second example with another field, and alone as task Own."""
    lake = LAKE[: LAKE.index("TASKS")]
    return f"{lake}from dataclasses import replace\n\n\nTASKS = {{'Own': replace(TASK, {field})}}\n"


SCENARIO = "name: lake\ntarget: Lake\nsources: [Pond]\nmethod: paddle\nframes: 256\nseeds: [0]\n"
FEW = "--set num_envs=4 --set rollout_steps=16"


@pytest.fixture
def file(tmp_path: Path) -> Iterator[Path]:
    """The example of docs/extending.md, with a second task of its domain."""
    (tmp_path / "lake.py").write_text(LAKE)
    (tmp_path / "cab.py").write_text(CAB.replace('{"Cab": CAB}', '{"Cab": CAB, "Van": CAB}'))
    yield tmp_path / "cab.py"
    forget_files()


def forget_files() -> None:
    """As a new process is, which has loaded none."""
    plugins._files.clear()
    suite.PLUGINS._of_files.clear()


@pytest.fixture
def few(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Command:
    """Runs a command line in the tasks' folder, its jobs too in this process; with few lanes."""
    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", inline.run_jobs)
    monkeypatch.chdir(tmp_path)
    return lambda *words: command(*words, *FEW.split())


def shell(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "paddlectl", *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "src"), "PADDLECTL_REGISTRY": str(folder / "registry")},
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_example_is_short() -> None:
    assert len(CAB.splitlines()) <= 40


def test_from_training_to_a_transfer(file: Path, command: Command, few: Command) -> None:
    folder = file.parent
    (folder / "lake.yaml").write_text(SCENARIO)
    learning = shell(folder, *f"train Lake --tasks lake.py --frames 1e6 --checkpoint-every 0 {FEW}".split())
    patience = time.monotonic() + 120
    while not list(folder.glob("registry/runs/run-1/checkpoints/*.json")):
        assert time.monotonic() < patience and learning.poll() is None
        time.sleep(0.05)
    learning.send_signal(signal.SIGINT)
    _, err = learning.communicate(timeout=60)
    assert learning.returncode == 130
    assert err.startswith(f"note: the code of {folder / 'lake.py'} is run, for its tasks\n")
    assert "go on with: paddlectl resume run-1 --tasks lake.py\n" in err

    told = command("resume", "run-1")
    assert told.code == 5 and told.err.endswith(
        "error: run-1 was learned on Lake, which this version doesn't have\n"
        "use the version of paddlectl that learned it, install the plug-in, "
        "or name its file: --tasks FILE.py, in Python paddlectl.add_tasks(FILE)\n"
    )
    assert "'Lake'" in command("transfer", folder / "lake.yaml").err, "no scenario names code"
    Registry.open(folder / "registry").close()
    line = "transfer lake.yaml --tasks=lake.py --train-missing --frames 64 --json"
    run = few(*line.split()).json["runs"][0]["run"]
    with Registry.open(folder / "registry") as registry:
        assert re.fullmatch("[0-9a-f]{12}", registry.run(run).versions["lake.py"])
        assert "is_low(agent)" in str(registry.policy("Pond").program)
        assert registry.run("run-1").status == "interrupted"


def test_the_example_learns(file: Path, tmp_path: Path) -> None:
    suite.add_file(file)
    registry = Registry.open(tmp_path / "registry")
    with small():
        row = train_source(TrainJob("Cab", 0, 512, {"num_envs": 4}), registry, quiet)
    assert row["frames"] == 512 and "has_passenger(taxi)" in str(registry.policy("Cab").program)


def test_commands_in_one_process(file: Path, command: Command) -> None:
    listed = command("tasks", "--tasks", file, "--json")
    assert listed.err == f"note: the code of {file} is run, for its tasks\n"
    assert {"Cab", "Van"} <= {task["name"] for task in listed.json["tasks"]}
    assert "did you mean Cab" in command("train", "cab", "--tasks", file).err
    Registry.open(os.environ["PADDLECTL_REGISTRY"]).close()
    assert "run: paddlectl train Cab --tasks" in command("show", "Cab", "--tasks", file).err
    told = command("similarity", "--target", "Cab", "--tasks", file)
    assert told.err.endswith(f"run: paddlectl train Van --tasks {file}\n")


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "src/paddlectl/cli").glob("*.py")))
def test_each_command_that_loads_tasks_has_the_option(name: str, command: Command) -> None:
    source = (ROOT / f"src/paddlectl/cli/{name}.py").read_text()
    if "EXAMPLE" in source and name not in ("app", "export", "label", "policies", "registry", "runs"):
        assert "no file nowhere.py" in command(name, "--tasks", "nowhere.py").err.replace(
            f"{Path.cwd()}/", ""
        )


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("TASKS = = 1", "it can't be loaded: SyntaxError: invalid syntax (own.py, line 1)"),
        ("\nimport nowhere", "ModuleNotFoundError: No module named 'nowhere' (own.py, line 2)"),
        ("def f():\n    1 / 0\nf()", "ZeroDivisionError: division by zero (own.py, line 2)"),
        ("raise SystemExit(0)", "SystemExit: 0 (own.py, line 1)"),
        ("", "it has no TASKS"),
        ("TASKS = ['Cab']", "it has list as TASKS"),
        ("TASKS = {}", "its TASKS is empty"),
        ("TASKS = {'Own': 3}", "Own of its TASKS is no task but int"),
        (changed("horizon='x'"), "horizon must be a whole number of steps, not 'x' (own.py, line "),
        (changed("horizon=True"), "horizon must be a whole number of steps, not True"),
        (changed("milestones='gt_home()'"), "milestones must be a tuple of texts"),
        (changed("exclusions=('a', 'b')"), "an exclusion must be a tuple of texts"),
        (changed("predicates={'is_low(agent)': 5}"), "predicate is_low(agent) must be a function, not 5"),
        (changed("predicates=[]"), "predicates must be a dict by atoms, not []"),
        (changed("subgoals={'gt_home()': home}"), "subgoal gt_home() must be a Subgoal(reached, sees)"),
        (changed("subgoals={'gt_home()': Subgoal(home, at, 3)}"), "available must be a function, not 3"),
        (changed("success=None"), "success must be a function, not None"),
        ("TASKS = {'my task': print}", "no task can have the name 'my task'"),
        ("TASKS = {3: print}", "no task can have the name 3"),
        ("TASKS = {'GapBall': print}", "there is another task GapBall"),
    ],
)
def test_a_file_that_cant_be_used_is_told_with_its_line(
    file: Path, command: Command, code: str, told: str
) -> None:
    own = file.with_name("own.py")
    own.write_text(code)
    answer = command("tasks", "--tasks", own)
    lines = answer.err.splitlines()
    assert answer.code == 3 and len(lines) == 3 and not answer.out, answer
    assert lines[1].startswith(f"error: {own}: ") and told in lines[1]


@pytest.mark.parametrize(
    ("code", "told"),
    [
        (changed("horizon=10**30"), "ValueError: horizon must be a whole number in 1..1,000,000, not 1000"),
        (changed("frames=0"), "ValueError: frames must be a whole number in 1.."),
        (changed("milestones=('gt_key()',)"), "milestone gt_key() is none of its subgoals"),
        ("TASKS = {'Own': lambda name: name}", "it gives str instead of paddlectl.tasks.base.Task"),
        ("def own(name):\n    return 1 / 0\nTASKS = {'Own': own}", "division by zero (own.py, line 2)"),
        (CAB.replace("Cab", "Own").replace("riding}", "riding, 'x': riding}"), "expected '(' after 'x'"),
    ],
)
def test_a_task_that_cant_be_made_is_its_files_fault(
    file: Path, command: Command, code: str, told: str
) -> None:
    own = file.with_name("own.py")
    own.write_text(code)
    answer = command("train", "Own", "--tasks", own)
    error, hint = answer.err.splitlines()[-2:]
    assert answer.code == 1 and error.startswith(f"error: task Own of {own} can't be used: ")
    assert told in error and hint == f"mend {own}"
    assert "note: task Own" in command("tasks", "--tasks", own).err


def test_a_listing_tries_the_tasks_of_a_file(file: Path, command: Command) -> None:
    own = file.with_name("own.py")
    own.write_text(changed("env='Nowhere-v0'").replace("{'Own'", "{'Lake': TASK, 'Own'"))
    answer = command("tasks", "--tasks", own, "--json")
    assert "Nowhere" in answer.err.splitlines()[-1] and answer.err.splitlines()[-1].startswith("note: ")
    names = [task["name"] for task in answer.json["tasks"]]
    assert "Lake" in names and "Own" not in names
    named = command("tasks", "Own", "--tasks", own)
    assert named.code == 1 and "its environment of task Own (Nowhere-v0) fails" in named.err


def test_a_listing_plays_the_tasks_of_a_file_a_little(file: Path, command: Command) -> None:
    own = file.with_name("own.py")
    own.write_text(changed("success=lambda env: bool(1 / (env.s == 0))"))
    answer = command("tasks", "Own", "--tasks", own)
    assert answer.code == 1 and "division by zero" in answer.err, "true in the first state alone"


def test_its_policy_is_there_for_python(file: Path, few: Command, tmp_path: Path) -> None:
    assert few("train", "Lake", "--tasks", "lake.py", "--frames", 64).code == 0
    forget_files()
    with pytest.raises(paddlectl.IntegrityError) as lacking:
        paddlectl.load("policy-1", tmp_path / "registry")
    assert "paddlectl.add_tasks(FILE)" in str(lacking.value.hint)
    assert paddlectl.add_tasks(tmp_path / "lake.py") == ("Lake", "Pond")
    assert paddlectl.load("Lake", tmp_path / "registry").task == "Lake"
    with pytest.raises(paddlectl.NotFoundError):
        paddlectl.add_tasks(tmp_path / "nowhere.py")


def test_what_fails_while_it_learns_is_told_with_its_line(file: Path, few: Command) -> None:
    file.write_text(CAB.replace("state[0][2] == state[0][3]", "state[0][2] == state[0][4]"))
    code, _, err = few("train", "Cab", "--tasks", "cab.py", "--frames", 64)
    line = 1 + file.read_text().splitlines().index("    return state[0][2] == state[0][4]")
    error, hint = err.splitlines()[-2:]
    assert (
        code == 1
        and error.startswith("error: ")
        and f"(cab.py, line {line})" in error
        and "IndexError" in error
    )
    assert hint == "mend the task"


def test_two_files_of_one_name_or_with_one_task_are_refused(file: Path, command: Command) -> None:
    other = file.parent / "other" / "cab.py"
    other.parent.mkdir()
    other.write_text("TASKS = {}")
    assert "another file of that name" in command("tasks", "--tasks", file, "--tasks", other).err
    van = file.with_name("van.py")
    van.write_text(file.read_text())
    assert "there is another task Cab" in command("tasks", "--tasks", file, "--tasks", van).err
    assert command("tasks", "--tasks", file, "--tasks", file, "--json").code == 0
