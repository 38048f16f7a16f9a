"""What a command loads, what `--help` costs, and what the shell completes."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest

from paddlectl.cli.app import COMMANDS
from paddlectl.registry.store import Registry
from samples import ROOT, TARGET, add_source, reseal, reuse

HEAVY = {"torch", "gymnasium", "minigrid", "mujoco", "pandas", "matplotlib", "alembic", "pydantic"}
LOADED = """
import atexit, sys
atexit.register(lambda: print(*sys.modules, file=sys.stderr))
from paddlectl.cli.app import main
sys.argv[0] = "paddlectl"
sys.exit(main())
"""

MANY = """
import json, os, sys
from paddlectl.cli import app
app.make_app(())  # Typer, which each of them loads
for line in sys.stdin:
    words, variables, folder, files = json.loads(line)
    if child := os.fork():
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        continue
    code = 1
    try:
        for number, file in enumerate(files, 1):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), number)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(variables)
        sys.argv = ["paddlectl", *words]
        code = app.main()
    except SystemExit as left:
        code = left.code or 0
    finally:
        print(*sys.modules, file=sys.stderr)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
"""

BARE = """
import typer
app = typer.Typer()
def one(): "Does something."
for number in range({count}):
    app.command(f"command{{number}}")(one)
app()
"""


def run(code: str, *arguments: object, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")} | variables
    line = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(line, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done


Ask = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def ask(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ask]:
    """As `run` with `LOADED`, by one process that has loaded Typer and forks for each command line."""
    files = [str(tmp_path_factory.mktemp("asked") / name) for name in ("out", "err")]
    line = [sys.executable, "-c", MANY]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    with subprocess.Popen(
        line, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin and process.stdout

        def asked(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
            for file in files:
                Path(file).write_text("")
            question = [words, dict(os.environ) | variables, str(Path.cwd()), files]
            process.stdin.write(f"{json.dumps(question)}\n")
            process.stdin.flush()
            code = int(process.stdout.readline())
            done = subprocess.CompletedProcess(words, code, *(Path(file).read_text() for file in files))
            assert done.returncode == 0, done.stderr
            return done

        yield asked
        process.stdin.close()


def loaded(done: subprocess.CompletedProcess[str]) -> set[str]:
    return {name.split(".")[0] for name in done.stderr.split()}


def test_help_loads_nothing_heavy() -> None:
    assert not loaded(run(LOADED, "--help")) & (HEAVY | {"numpy", "sqlalchemy", "yaml", "sympy"})


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_loads_nothing_heavy_and_ends_with_an_example(ask: Ask, name: str) -> None:
    done = ask(name, "--help")
    assert not loaded(done) & (HEAVY | {"numpy", "sqlalchemy"})
    assert f"Example: paddlectl {name}" in done.stdout


@pytest.mark.parametrize(
    "line",
    [
        *("runs", "policies", "show GapBall", f"similarity --target {TARGET}", "explain", "tasks --json"),
        *("resume --all", "compare"),
    ],
)
def test_reading_loads_no_torch(ask: Ask, registry: Registry, line: str) -> None:
    rows = [{"order": n, "started": n, "frames": n + 30, "score": 0.9} for n in range(100)]
    registry.files.append_rows("run-3", "episodes", rows)  # for compare
    reseal(registry, "run-3")
    assert not loaded(ask(*line.split(), PADDLECTL_REGISTRY=registry.location)) & HEAVY


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_listed_by_its_own_docstring(name: str) -> None:
    assert getattr(import_module(f"paddlectl.cli.{name}"), name).__doc__ == COMMANDS[name]


def test_help_costs_little_more_than_a_bare_app(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cheapest of several interleaved runs each, by processor time: noise only ever adds."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "src"))
    ours = "import sys; from paddlectl.cli.app import main; sys.exit(main())"
    bare = BARE.format(count=len(COMMANDS))
    costs: dict[str, list[float]] = {ours: [], bare: []}
    for _ in range(2):
        for code in costs:
            run(code, "--help")  # writes the byte code
    ratio = float("inf")
    for _ in range(4):
        for _ in range(6):
            for code, found in costs.items():
                found.append(processor_seconds(code))
        ratio = min(costs[ours]) / min(costs[bare])
        if ratio <= 1.15:
            break
    print(f"--help costs {ratio:.2f} of a bare app's")
    assert ratio <= 1.15


def processor_seconds(code: str) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code, "--help"], stdout=subprocess.DEVNULL, timeout=60, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


Complete = Callable[..., list[str]]


@pytest.fixture
def complete(ask: Ask) -> Complete:
    """What is offered at the end of a line."""

    def offered(line: str, **variables: str) -> list[str]:
        last = str(len(line.split(" ")) - 1)
        words = {"_PADDLECTL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": last}
        done = ask(**words, **variables)
        assert not loaded(done) & HEAVY
        assert "sys" in loaded(done)
        return done.stdout.split()

    return offered


def test_completion_of_commands_tasks_policies_runs(complete: Complete, registry: Registry) -> None:
    where = {"PADDLECTL_REGISTRY": registry.location}
    assert complete("paddlectl tr") == ["train", "transfer"]
    assert complete("paddlectl train Box") == ["BoxDoor"]
    assert complete("paddlectl train BoxDoor Gap") == ["GapBall"]
    assert complete("paddlectl similarity --target BlockedBoxU") == [TARGET]
    assert complete("paddlectl show ", **where) == [
        TARGET,
        "BlockedDoor",
        "GapBall",
        "policy-3",
        "policy-2",
        "policy-1",
        "run-3",
        "run-2",
        "run-1",
    ]
    assert complete("paddlectl explain ", **where) == ["latest", "run-3"]
    assert complete("paddlectl compare --scenario ", **where) == ["A"]
    assert complete("paddlectl compare --figure f") == ["final_score", "frames_to_success"]
    assert complete(f"paddlectl show --registry {registry.location} policy-1") == ["policy-1"]


def test_completion_offers_what_the_command_takes(complete: Complete, registry: Registry) -> None:
    where = {"PADDLECTL_REGISTRY": registry.location}
    add_source(registry, "CoffeeMaze", "", domain="maze2d")
    for method, sources, status in (
        ("hdm", (), "interrupted"),
        ("hdm", (), "failed"),
        ("random", (), "failed"),
        ("paddle", ("elsewhere:policy-1",), "interrupted"),
        ("hdm", (), "running"),
        ("hdm", (), "running"),
    ):
        run = registry.add_run(
            kind="train", method=method, task="GapBall", scenario=None, sources=(), seed=0, settings={},
            versions={},
        )  # fmt: skip
        reuse(registry, run.id, sources)
        if status != "running":
            registry.finish_run(run.id, status=status, frames=1, episodes=0, seconds=1.0, results={})
    with registry.files.hold("run-9"):
        assert complete("paddlectl resume ", **where) == ["run-10", "run-6", "run-5"]
    assert complete("paddlectl registry export run-", **where) == [f"run-{n}" for n in range(8, 0, -1)]
    assert complete("paddlectl registry export l", **where) == []
    assert complete("paddlectl export run-", **where) == [f"run-{n}" for n in range(10, 0, -1)]
    assert complete("paddlectl similarity --target CoffeeMaze --source ", **where) == [
        "CoffeeMaze",
        "policy-4",
    ]
    assert "policy-4" not in complete(f"paddlectl similarity --target {TARGET} --source p", **where)
    add_source(registry, "DoorBall", None, method="ppo")
    add_source(registry, "OpenGoal", "0.9 :: gt_key()", method="random")
    offered = complete(f"paddlectl similarity --target {TARGET} --source ", **where)
    assert set(offered) == {TARGET, "GapBall", "BlockedDoor", "policy-1", "policy-2", "policy-3", "policy-6"}


def test_nothing_is_offered_where_there_is_nothing(complete: Complete, tmp_path: Path) -> None:
    Registry.open(tmp_path / "registry").close()
    for line in ("explain ", "export ", "resume ", "show ", "registry export "):
        assert complete(f"paddlectl {line}", PADDLECTL_REGISTRY=str(tmp_path / "registry")) == []


def test_completion_of_scenario_files(complete: Complete, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("HOME", str(ROOT))
    assert complete("paddlectl transfer ~/scenarios/D") == ["~/scenarios/D-place.yaml", "~/scenarios/D.yaml"]
    assert complete("paddlectl transfer scen") == ["scenarios/"]
    assert complete("paddlectl transfer scenarios/A") == ["scenarios/A-place.yaml", "scenarios/A.yaml"]


def test_completion_of_what_is_shipped(
    complete: Complete, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert complete("paddlectl transfer A") == ["A", "A-place"]
    assert complete("paddlectl transfer minigrid/K") == ["minigrid/KeyCorridor"]
    assert complete("paddlectl transfer paper/") == ["paper/library", "paper/quantity"]
    for name in ("sweep", "compare", "plot"):
        assert complete(f"paddlectl {name} paper/fig6") == ["paper/fig6a", "paper/fig6b"]
        assert complete(f"paddlectl {name} A") == []


def test_completion_of_task_files(
    complete: Complete, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mytasks").mkdir()
    for name in ("KeyGoal.yaml", "notes.txt"):
        (tmp_path / "mytasks" / name).touch()
    monkeypatch.chdir(tmp_path)
    assert complete("paddlectl train my") == ["mytasks/"]
    assert complete("paddlectl train BoxDoor mytasks/K") == ["mytasks/KeyGoal.yaml"]
    assert complete("paddlectl evaluate BoxDoor --task mytasks/") == ["mytasks/KeyGoal.yaml"]
    assert complete("paddlectl similarity --target mytasks/") == ["mytasks/KeyGoal.yaml"]
    assert complete("paddlectl tasks Box") == ["BoxDoor"]


def test_completion_of_what_can_be_drawn(
    complete: Complete, registry: Registry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name in ("study.yaml", "runs.json", "runs.csv", ".hidden.json"):
        (tmp_path / "work" / name).touch()
    where = {"PADDLECTL_REGISTRY": registry.location}
    offered = complete("paddlectl plot ", **where)
    assert offered[:3] == ["run-3", "run-2", "run-1"] and offered[-2:] == ["runs.json", "study.yaml"]
    assert complete("paddlectl plot run", **where) == ["run-3", "run-2", "run-1", "runs.json"]
    assert complete("paddlectl plot st", **where) == ["study.yaml"]
    assert complete("paddlectl plot x --x e", **where) == ["episodes"]


def test_completion_of_methods(complete: Complete) -> None:
    assert complete("paddlectl train BoxDoor --method p") == ["ppo"]
    assert complete("paddlectl transfer A.yaml --method p")[:2] == ["paddle", "ppo"]


def test_completion_is_silent_about_trouble(complete: Complete, tmp_path: Path) -> None:
    assert complete("paddlectl show ", PADDLECTL_REGISTRY=str(tmp_path / "none")) == []


def test_json_is_all_there_is_on_stdout(
    process: Callable[..., subprocess.CompletedProcess[str]], registry: Registry
) -> None:
    done = process("explain", "--json", PADDLECTL_REGISTRY=registry.location)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["run"] == "run-3"


def test_no_arguments_show_the_help(process: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    done = process()
    assert done.returncode == 0
    assert all(name in done.stdout for name in COMMANDS)
