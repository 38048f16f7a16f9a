"""A method, a task and an environment are one file and one line of registration each, outside the package."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import inline
from contract import CHECKS
from paddlectl import plugins
from paddlectl.cli.options import complete_tasks
from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.resuming import job_of, resume
from paddlectl.experiments.runner import train_source
from paddlectl.methods import catalogue
from paddlectl.methods.base import method_of
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite
from samples import ROOT, Command
from trials.runs import StopAfter, ended, quiet, small

FILES = ROOT / "tests" / "plugin"
ENTRY_POINTS = """\
[paddlectl.tasks]
CoinCorridor = corridor:make_task
ExitCorridor = corridor:make_task
KeyPays = detour:make_task

[paddlectl.methods]
climb = climb:ENTRY
lean = lean:ENTRY
"""
SCENARIO = """\
name: coin
target: CoinCorridor
sources: [ExitCorridor]
method: lean
frames: 2048
"""
FRAMES = 120 * 128  # rounds of climb's


def distribution(folder: Path, entry_points: str, name: str = "toys") -> Path:
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)
    return folder


@pytest.fixture
def toys(tmp_path: Path) -> Path:
    """A folder with the plug-ins, on nobody's path yet."""
    shutil.copytree(FILES, tmp_path / "toys", ignore=shutil.ignore_patterns("__pycache__"))
    return distribution(tmp_path / "toys", ENTRY_POINTS)


@pytest.fixture
def installed(toys: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(toys)
    return toys


class Shell:
    """The command line with the plug-ins on its path."""

    def __init__(self, toys: Path, registry: Path) -> None:
        self._toys, self.registry = toys, registry

    def begin(self, *arguments: object) -> subprocess.Popen[str]:
        path = os.pathsep.join([str(ROOT / "src"), str(self._toys)])
        return subprocess.Popen(
            [sys.executable, "-m", "paddlectl", *map(str, arguments)],
            env=os.environ | {"PYTHONPATH": path, "PADDLECTL_REGISTRY": str(self.registry)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


def wait_for(found: Callable[[], object]) -> None:
    patience = time.monotonic() + 120
    while not found():
        assert time.monotonic() < patience
        time.sleep(0.05)


def has_checkpoint(place: Path, method: str) -> bool:
    if not place.exists():
        return False
    runs = [run.id for run in Registry.open(place).runs() if run.method == method]
    return any(list((place / "runs" / run / "checkpoints").glob("*.json")) for run in runs)


def test_from_training_to_another_registry(
    installed: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shell = Shell(installed, tmp_path / "registry")
    (tmp_path / "coin.yaml").write_text(SCENARIO)
    learning = shell.begin(*f"train KeyPays --method climb --frames {FRAMES} --checkpoint-every 0".split())
    wait_for(lambda: has_checkpoint(shell.registry, "climb"))
    learning.send_signal(signal.SIGINT)
    _, err = learning.communicate(timeout=120)
    opened = Registry.open(shell.registry)
    (stopped,) = (run.id for run in opened.runs() if run.method == "climb")
    assert learning.returncode == 130 and f"go on with: paddlectl resume {stopped}" in err
    whole = Registry.open(tmp_path / "whole")
    with small():
        source = train_source(TrainJob("ExitCorridor", 0, 2048, method="ppo"), opened, quiet)["policy"]
        train_source(TrainJob("KeyPays", 0, FRAMES, method="climb"), whole, quiet)
    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", inline.run_jobs)
    for line in (f"transfer {tmp_path / 'coin.yaml'}", f"resume {stopped}"):
        assert command(*line.split()).code == 0
    listed = command("tasks", "--json").json["tasks"]
    assert {"CoinCorridor", "ExitCorridor", "KeyPays"} < {task["name"] for task in listed}
    moved = command(*["evaluate", "ExitCorridor", "--task", "CoinCorridor", "--episodes", "5", "--json"]).json
    assert (moved["policy"], moved["task"]) == (source, "CoinCorridor")

    transfer = opened.newest_transfer()
    assert transfer is not None and (transfer.method, transfer.status) == ("lean", "finished")
    assert transfer.versions["toys"] == "1.0"
    rows = opened.files.read_rows(transfer.id, "reuse")
    assert {row["source"] for row in rows} == {"target", *transfer.sources}
    told = command("explain", transfer.id, "--json").json
    assert command("registry", "export", transfer.policy, tmp_path / "x.zip").code == 0
    assert (told["method"], told["target"]) == ("lean", "CoinCorridor")
    reused = {(row["source"], *row["terms"]) for row in told["reuse"]}
    assert reused == {("target", "value"), (source, "value")}
    taken = command("registry", "import", tmp_path / "x.zip", "--registry", tmp_path / "other")
    assert taken.code == 0
    assert Registry.open(tmp_path / "other").policy("CoinCorridor").method == "lean"
    assert ended(opened, stopped) == ended(whole, "run-1")


def test_its_plain_classes_are_captured(installed: Path, tmp_path: Path) -> None:
    job = TrainJob("CoinCorridor", 0, 1024, method="climb")
    registry = Registry.open(tmp_path / "registry")
    with pytest.raises(KeyboardInterrupt):
        train_source(job, registry, quiet, Checkpointer(0.0, StopAfter(3)))
    resume("run-1", registry, quiet, Checkpointer())
    row = train_source(job, registry, quiet)
    assert ended(registry, "run-1") == ended(registry, row["run"])


@pytest.mark.parametrize("name", ["climb", "lean"])
def test_its_methods_keep_what_every_method_promises(installed: Path, name: str) -> None:
    for check in CHECKS:
        check(name, "discrete")


@pytest.mark.parametrize("line", ["tasks --json", "similarity --target CoinCorridor", "transfer A"])
def test_what_is_only_looked_at_loads_no_torch(toys: Path, tmp_path: Path, line: str) -> None:
    code = "import sys; from paddlectl.cli.app import main; main(); sys.exit('torch' in sys.modules)"
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(toys)]),
        "PADDLECTL_REGISTRY": str(tmp_path / "registry"),
    }
    Registry.open(tmp_path / "registry").close()
    done = subprocess.run(
        [sys.executable, "-c", code, *line.split()], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "CoinCorridor" in done.stdout or "run: paddlectl train " in done.stderr


def test_no_built_in_name_is_looked_for_elsewhere(installed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distribution(installed, "[paddlectl.tasks]\nGapBall = none:x\n[paddlectl.methods]\nhdm = none:x\n", "b")
    assert suite.names().count("GapBall") == catalogue.names().count("hdm") == 1
    monkeypatch.setattr(plugins, "_points", None)
    assert suite.load("GapBall").domain == "minigrid" and suite.known("GapBall")
    assert method_of("hdm").name == "hdm" and catalogue.known("hdm")


def test_names_of_plug_ins_are_offered_and_corrected(
    installed: Path, command: Command, tmp_path: Path
) -> None:
    assert "did you mean CoinCorridor or ExitCorridor?" in command("train", "coincorridor").err
    assert "did you mean climb?" in command("train", "GapBall", "--method", "climp").err
    assert "one of: " in (told := command("train", "GapBall", "--method", "lean")).err and "climb" in told.err
    assert "climb chooses discrete" in command("train", "CoffeeMaze", "--method", "climb").err
    Registry.open(tmp_path / "registry").close()
    assert "run: paddlectl train ExitCorridor" in command("show", "ExitCorridor").err
    (tmp_path / "coin.yaml").write_text(SCENARIO)
    assert "train ExitCorridor --method ppo" in command("transfer", tmp_path / "coin.yaml").err
    for wrong, right in (("[ExitCorridor]", "ExitCorridor"), ("lean", "lean")):
        (tmp_path / "bad.yaml").write_text(SCENARIO.replace(wrong, wrong.replace("n", "m").replace("x", "s")))
        assert f"did you mean {right!r}?" in command("transfer", tmp_path / "bad.yaml").err
    (tmp_path / "far.yaml").write_text(SCENARIO.replace("[ExitCorridor]", "[GapBall]"))
    assert (
        "GapBall is a task of minigrid, the target CoinCorridor of corridor"
        in command("transfer", tmp_path / "far.yaml").err
    )
    assert "CoinCorridor" in complete_tasks("Coin")
    assert command("similarity", "--target", "KeyPays").err.endswith("run: paddlectl train BlockedDoor\n")


def test_the_only_task_of_a_domain_has_no_other_to_compare(
    installed: Path, command: Command, tmp_path: Path
) -> None:
    (installed / "alone.py").write_text(
        "from dataclasses import replace\nimport corridor\n"
        "def make(name):\n    return replace(corridor.make_task(name), domain='alone')\n"
    )
    distribution(installed, "[paddlectl.tasks]\nAlone = alone:make\n", "alone")
    Registry.open(tmp_path / "registry").close()
    told = command("similarity", "--target", "Alone")
    assert told.code == 4 and told.err.endswith("Alone is the only one of its domain\n")


def test_the_hybrid_model_learns_a_plug_ins_environment(installed: Path, tmp_path: Path) -> None:
    registry = Registry.open(tmp_path / "registry")
    few = {"num_envs": 2, "rollout_steps": 8}
    row = train_source(TrainJob("CoinCorridor", 0, 1, few), registry, quiet)
    assert "has_coin(agent)" in str(registry.policy(row["policy"]).program)


@pytest.fixture
def left_behind(toys: Path, tmp_path: Path) -> Registry:
    """run-1 and policy-1, and the interrupted run-2, of plug-ins that aren't installed any more."""
    registry = Registry.open(tmp_path / "registry")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(toys)
        train_source(TrainJob("CoinCorridor", 0, 256, method="climb"), registry, quiet)
        with pytest.raises(KeyboardInterrupt):
            train_source(
                TrainJob("CoinCorridor", 0, 256, method="climb"),
                registry,
                quiet,
                Checkpointer(0.0, StopAfter(1)),
            )
    return registry


def test_what_a_plug_in_left_can_be_kept_without_it(
    left_behind: Registry, command: Command, tmp_path: Path
) -> None:
    kept = ("policies", "runs", "show CoinCorridor", "registry check", "registry export policy-1 x.zip")
    for line in kept:
        assert command(*line.replace("x.zip", str(tmp_path / "x.zip")).split()).code == 0
    told = command("registry", "import", tmp_path / "x.zip", "--registry", tmp_path / "other")
    assert told.code == 0
    told = command("evaluate", "CoinCorridor")
    assert (told.code, told.err) == (
        5,
        "error: policy-1 was learned on CoinCorridor, which this version doesn't have\n"
        "use the version of paddlectl that learned it, install the plug-in, "
        "or name its file: --tasks FILE.py, in Python paddlectl.add_tasks(FILE)\n",
    )
    with pytest.raises(IntegrityError, match="run-2 was learned on CoinCorridor, which"):
        job_of(left_behind.run("run-2"))


def test_a_method_that_is_gone_is_told_like_a_task(left_behind: Registry, toys: Path) -> None:
    text = (toys / "toys-1.0.dist-info" / "entry_points.txt").read_text()
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(distribution(toys / "rest", text.partition("[paddlectl.methods]")[0], "rest"))
        with pytest.raises(IntegrityError, match="run-2 was learned by climb, which"):
            job_of(left_behind.run("run-2"))


@pytest.mark.parametrize(
    ("where", "code", "told"),
    [
        ("absent_module:make", "", "ModuleNotFoundError: No module named 'absent_module'"),
        ("{}:mak", "", "AttributeError: module '{}' has no attribute 'mak'"),
        ("{}", "", "AttributeError"),
        ("{}:make", "import absent", "ModuleNotFoundError: No module named 'absent' ({}.py, line 1)"),
        ("{}:make", "make = = 1", "SyntaxError: invalid syntax ({}.py, line 1)"),
        ("{}:make", "\nraise SystemExit(0)", "SystemExit: 0 ({}.py, line 2)"),
        ("{}:make", "make = 3", "TypeError: 'int' object is not callable"),
        ("{}:make", "make = str", "it gives str instead of paddlectl.tasks.base.Task"),
        (
            "{}:make",
            "def make(name):\n    return 1 / 0",
            "ZeroDivisionError: division by zero ({}.py, line 2)",
        ),
        ("corridor:make", "", "AttributeError"),
    ],
)
def test_a_task_that_cant_be_made_is_its_plug_ins_fault(
    installed: Path, command: Command, request: pytest.FixtureRequest, where: str, code: str, told: str
) -> None:
    module = f"broken{request.node.nodeid.__hash__() % 10**9}"
    (installed / f"{module}.py").write_text(code)
    where = where.format(module)
    distribution(installed, f"[paddlectl.tasks]\nBroken = {where}\n", "bad")
    for line in ("train Broken", "similarity --target Broken", "evaluate GapBall --task Broken"):
        code, _, err = command(*line.split())
        assert code == 1 and len(err.splitlines()) == 2, err
        assert err.startswith(f"error: task Broken of bad ({where}) can't be used: ")
        assert told.format(module) in err and err.endswith("\nmend or uninstall bad\n")
    listed = command("tasks", "--json")
    assert listed.code == 0 and listed.err.startswith("note: task Broken of bad")
    assert "CoinCorridor" in {task["name"] for task in listed.json["tasks"]}
    assert "no registry" in command("show", "GapBall").err


@pytest.mark.parametrize("name", ["../x", "My Task", "policy-7", "x" * 65, "é", "1Door"])
def test_a_name_that_no_registry_keeps_is_no_tasks(installed: Path, name: str) -> None:
    distribution(installed, f"[paddlectl.tasks]\n{name} = corridor:make_task\n", "bad")
    assert name not in suite.names()
    with pytest.raises(PaddlectlError, match="no task can have that name"):
        suite.load(name)


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("ENTRY = 3", "it gives int instead of paddlectl.methods.catalogue.Entry"),
        ("ENTRY = Entry('climb:METHOD', '', 'ppo', DISCRETE)", "it gives str instead of builtins.tuple"),
        (
            "ENTRY = Entry('climb:METHOD', '', ('pdo',), DISCRETE)",
            "it reuses what 'pdo' learned, which is no",
        ),
        ("ENTRY = Entry('climb:METHOD', '', (), frozenset())", "actions can't be frozenset()"),
        ("ENTRY = Entry('climb:METHOD', '', (), frozenset({'x'}))", "actions can't be"),
        ("ENTRY = Entry('climb:METHOD', '', (), DISCRETE, ['x'])", "it gives list instead of"),
        ("ENTRY = Entry('climb:METHOD', '', (), DISCRETE, {'x': 'y'})", "it gives str instead of builtins.t"),
        ("ENTRY = Entry('climb:METHOD', '', (), DISCRETE)", "its method is called 'climb'"),
        ("ENTRY = Entry('climb:make', '', (), DISCRETE)", "it gives function instead of"),
        ("ENTRY = Entry('climb:none', '', (), DISCRETE)", "has no attribute 'none'"),
    ],
)
def test_a_method_that_cant_be_used_is_its_plug_ins_fault(
    installed: Path, request: pytest.FixtureRequest, code: str, told: str
) -> None:
    module = f"broken{request.node.nodeid.__hash__() % 10**9}"
    first = "from paddlectl.methods.catalogue import Entry\nDISCRETE = frozenset({'discrete'})\n"
    (installed / f"{module}.py").write_text(first + code)
    distribution(installed, f"[paddlectl.methods]\nbad = {module}:ENTRY\n", "bad")
    with pytest.raises(PaddlectlError) as caught:
        method_of("bad")
    assert caught.value.message.startswith(f"method bad of bad ({module}:ENTRY) can't be used: ")
    assert told in caught.value.message and caught.value.hint == "mend or uninstall bad"


@pytest.mark.parametrize("name", ["random", "Upper", "two words", "x" * 33])
def test_a_name_that_no_registry_keeps_is_no_methods(installed: Path, name: str) -> None:
    distribution(installed, f"[paddlectl.methods]\n{name} = climb:ENTRY\n", "bad")
    assert name not in catalogue.names()
    with pytest.raises(PaddlectlError, match="no method can have that name"):
        catalogue.entry_of(name)


def test_a_task_that_lies_about_itself(installed: Path) -> None:
    (installed / "liar.py").write_text(
        "from dataclasses import replace\nimport corridor\n"
        "def make(name):\n    return replace(corridor.make_task(name), domain='a b')\n"
        "def other(name):\n    return corridor.make_task('Other')\n"
    )
    distribution(installed, "[paddlectl.tasks]\nLiar = liar:make\nOther2 = liar:other\n", "liar")
    with pytest.raises(PaddlectlError, match="domain can't be 'a b'"):
        suite.load("Liar")
    with pytest.raises(PaddlectlError, match="its task is called 'Other'"):
        suite.load("Other2")


def test_two_that_have_one_name_are_both_told(installed: Path) -> None:
    distribution(installed, "[paddlectl.tasks]\nCoinCorridor = corridor:make_task\n", "again")
    with pytest.raises(PaddlectlError, match=r"task CoinCorridor of again and toys .* the same name"):
        suite.load("CoinCorridor")
    assert suite.load("ExitCorridor").name == "ExitCorridor"


def test_a_damaged_distribution_is_nobodys_affair(installed: Path) -> None:
    distribution(installed, "[paddlectl.tasks]\nno value\n", "torn")
    (distribution(installed, "", "binary") / "binary-1.0.dist-info" / "entry_points.txt").write_bytes(b"\xff")
    assert "CoinCorridor" in suite.names()


def test_what_a_plug_in_prints_is_no_part_of_the_answer(installed: Path, command: Command) -> None:
    (installed / "loud.py").write_text("print('hello')\nfrom corridor import make_task\n")
    distribution(installed, "[paddlectl.tasks]\nLoud = loud:make_task\n", "loud")
    answer = command("tasks", "--json")
    assert "Loud" in {task["name"] for task in answer.json["tasks"]} and answer.err == "hello\n"
