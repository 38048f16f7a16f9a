"""Every mistake and fault: its exit code, one or two lines on stderr, nothing on stdout, no traceback."""

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from paddlectl.cli import app
from paddlectl.registry.store import Registry
from samples import BLOCKED_DOOR, ROOT, TARGET, Answer, Command, add_source, program, reseal

Process = Callable[..., subprocess.CompletedProcess[str]]


def expect(answer: Answer, code: int, *lines: str) -> None:
    assert (answer.code, answer.out) == (code, "")
    told = answer.err.splitlines()
    assert 1 <= len(told) <= 2
    assert told[0].startswith("error: ")
    for line in lines:
        assert line in answer.err


USAGE = [
    ("trian", "Did you mean 'train'"),
    ("runs --jsn", "--jsn; did you mean --json?"),
    ("show", "Missing argument 'POLICY|RUN'"),
    ("train BoxDoor --seed x", "'x' is no whole number; write it in digits"),
    ("train BoxDoor --seed -1", "-1 is not in the range 0 to 4294967295"),
    ("train BoxDoor --frames 400k", "'400k' is no whole number; write 400000"),
    ("train BoxDoor --frames 400,000", "'400,000' is no whole number; write 400000"),
    ("train BoxDoor --seeds 0..5", "write 0-5"),
    ("evaluate BoxDoor --episodes 1.5", "'1.5' is no whole number"),
    ("train BoxDoor --seeds 5-0", "the lower one first"),
    ("train BoxDoor --seeds 0,0", "a seed stands twice"),
    ("train BoxDoor --seeds 0-99999999", "more than 1000 seeds"),
    ("train BoxDoor --seeds 1,,2", "write 1,2"),
    ("train BoxDoor --seeds x", "write them as 0-5 or 0,3,7"),
    ("train BoxDoor --seed 1 --seeds 0-5", "exclude each other"),
    ("train BoxDoor --frames 0", "0 is not in the range 1 to 1000000000000"),
    ("train BoxDoor --frames 1000000000001", "not in the range"),
    ("transfer scenarios/A.yaml --frames 1000000000001", "not in the range"),
    ("runs --limit 0", "0 is not in the range 1<=x<=2147483647"),
    ("policies --all --limit 5", "--all and --limit exclude each other"),
    ("evaluate BoxDoor --episodes 0", "not in the range"),
    (f"similarity --target {TARGET} --body-weight 1.5", "a weight lies in [0, 1]"),
    (f"similarity --target {TARGET} --body-weight nan", "a weight lies in [0, 1]"),
    (f"similarity --target {TARGET} --body-weight 0.5 --head-weight 0.4", "must add up to 1"),
    (
        f"transfer {ROOT}/scenarios/A.yaml --method padle",
        "unknown method padle\ndid you mean paddle? or one of: ",
    ),
]


@pytest.mark.parametrize("line, told", USAGE, ids=[line for line, _ in USAGE])
def test_usage(registry: Registry, command: Command, line: str, told: str) -> None:
    expect(command(*line.split()), 2, told)


MISSING = [
    ("train BoxDor", "did you mean BoxDoor"),
    ("train BoxDoor --preset paper", "it has none: leave out --preset"),
    ("train MailMaze --preset papr", "hdm has no preset papr for MailMaze"),
    ("train MailMaze --preset papr", "its presets: paper"),
    ("train MailMaze --preset guided", "its presets: paper"),
    ("train BoxDoor MailMaze --preset paper", "hdm has no preset paper for BoxDoor"),
    ("train BoxDoor --method ppo --preset paper", "ppo has no preset paper for BoxDoor"),
    ("train MailMaze --method td3 --preset paper", "or take another method: hdm, hdqn"),
    ("train MailMaze --method td3 --preset papr", "it has none: leave out --preset"),
    ("similarity --target BoxDor", "did you mean BoxDoor"),
    ("show policy-9", "no policy policy-9"),
    ("show DoorBall", "run: paddlectl train DoorBall"),
    ("show GapBal", "did you mean GapBall? or run: paddlectl policies"),
    ("show run-9", "run: paddlectl runs"),
    ("evaluate OpenGoal", "run: paddlectl train OpenGoal"),
    ("evaluate GapBall --task BoxDor", "did you mean BoxDoor"),
    (f"similarity --target {TARGET} --source DoorBall", "run: paddlectl train DoorBall"),
    ("explain run-77", "no run run-77"),
    ("explain run-1", "run: paddlectl show policy-1"),
    ("transfer nowhere.yaml", "no file nowhere.yaml"),
    (f"transfer {ROOT}/scenarios/a.yaml", "scenarios/A.yaml?"),
    (f"transfer {ROOT}/scenarios/B.yaml", "run: paddlectl train DoorBall"),
]


@pytest.mark.parametrize("line, told", MISSING, ids=[line for line, _ in MISSING])
def test_what_is_not_there(registry: Registry, command: Command, line: str, told: str) -> None:
    expect(command(*line.split()), 4, told)


@pytest.mark.parametrize(
    "line",
    ["policies", "runs", "show BoxDoor", "explain", f"similarity --target {TARGET}", "evaluate BoxDoor"],
)
def test_no_registry(command: Command, tmp_path: Path, line: str) -> None:
    expect(
        command(*line.split(), "--registry", tmp_path / "none"), 4, "no registry at", "run: paddlectl train"
    )
    assert not (tmp_path / "none").exists()


def test_no_transfer_yet(command: Command, tmp_path: Path) -> None:
    add_source(Registry.open(tmp_path / "registry"), "BlockedDoor", program("BlockedDoor", BLOCKED_DOOR))
    expect(command("explain"), 4, "no transfer in", "run: paddlectl transfer")


def test_a_bad_scenario_is_told_with_its_place(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("name: A\ntargt: BoxDoor\nsources: [GapBall]\n")
    expect(command("transfer", path), 3, f"{path}:2:1: unknown key 'targt'; did you mean 'target'?")


def test_a_source_of_another_domain(registry: Registry, command: Command) -> None:
    add_source(registry, "CoffeeMaze", "", domain="maze2d")
    expect(command("similarity", "--target", TARGET, "--source", "CoffeeMaze"), 2, "CoffeeMaze of maze2d")


def test_a_damaged_program_is_refused(registry: Registry, command: Command) -> None:
    add_source(registry, "DoorBall", "0.9 :: gt_key( :-")
    for line in ("show DoorBall", f"similarity --target {TARGET} --source DoorBall"):
        expect(command(*line.split()), 5, "the program of policy-4 is damaged", "run: paddlectl train"[5:])


@pytest.mark.parametrize("name", ["mapping.json", "trace.json", "weights.jsonl"])
@pytest.mark.parametrize(
    "text", ["[1]\n", '{"scenes": 3, "early": 3}\n', "not json\n", '{"early": [{"step": 1}]}\n']
)
def test_damaged_files_of_a_run_are_refused(
    registry: Registry, command: Command, name: str, text: str
) -> None:
    (Path(registry.location) / "runs" / "run-3" / name).write_text(text)
    expect(command("explain", "run-3"), 5)
    expect(command("explain", "run-3", "--json"), 5)


WRONG = [
    ("mapping.json", '"self_similarity": ', '"self_similarity": "x", "": '),
    ("mapping.json", '"body": [', '"body": [3, '),
    ("mapping.json", '"policy": ', '"policy": [1], "": '),
    ("weights.jsonl", '"decisions": ', '"decisions": null, "": '),
    ("weights.jsonl", '"chosen": ', '"chosen": "1", "": '),
    ("weights.jsonl", '"weight": ', '"weight": "x", "": '),
    ("trace.json", '"score_early": ', '"score_early": [], "": '),
    ("trace.json", '"guide": ', '"guide": {}, "": '),
    ("trace.json", '"similarity": ', '"similarity": true, "": '),
]


@pytest.mark.parametrize("name, sound, wrong", WRONG, ids=[wrong for *_, wrong in WRONG])
def test_values_of_another_type_in_files_of_a_run_are_refused(
    registry: Registry, command: Command, name: str, sound: str, wrong: str
) -> None:
    path = Path(registry.location) / "runs" / "run-3" / name
    text = path.read_text()
    assert sound in text
    path.write_text(text.replace(sound, wrong, 1))
    reseal(registry, "run-3")
    expect(command("explain", "run-3"), 5, f"{name} of run-3 isn't what a run writes")
    expect(command("explain", "run-3", "--json"), 5)


def test_a_registry_of_a_newer_version(registry: Registry, command: Command) -> None:
    file = Path(registry.location) / "registry.db"
    with sqlite3.connect(file) as connection:
        connection.execute("update alembic_version set version_num = '9999'")
    connection.close()
    before = file.read_bytes()
    for line in ("runs", "train BoxDoor", "show GapBall"):
        expect(command(*line.split()), 7)
    assert file.read_bytes() == before


def test_a_registry_that_is_none(command: Command, tmp_path: Path) -> None:
    (tmp_path / "registry").mkdir()
    (tmp_path / "registry" / "registry.db").write_bytes(os.urandom(5000))
    expect(command("runs"), 5)


def test_a_place_where_no_registry_can_be(command: Command) -> None:
    place = "/proc/nowhere/registry"
    expect(command("train", "BoxDoor", "--registry", place), 1, place)


def test_a_full_disk_behind_stdout(registry: Registry) -> None:
    line = f"{sys.executable} -m paddlectl runs --json > /dev/full"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "PADDLECTL_REGISTRY": registry.location}
    done = subprocess.run(
        line, shell=True, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    what = "the answer can't be written to standard output: No space left on device"
    assert done.stderr == f"error: {what}; what was asked for is done\n"


def test_a_fault_of_the_disk_is_one_line(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: object) -> None:
        raise OSError(28, "No space left on device", "/there/registry.db")

    monkeypatch.setattr(app, "make_app", full)
    expect(command("runs"), 1, "error: No space left on device: /there/registry.db")


def test_the_unexpected_is_one_line_and_a_log(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(_: object) -> None:
        raise RuntimeError("a\x1b[2Jb\nc")

    monkeypatch.setattr(app, "make_app", wrong)
    monkeypatch.delenv("PADDLECTL_DEBUG", raising=False)
    answer = command("runs")
    expect(answer, 1, r"unexpected RuntimeError: a\x1b[2Jb c")
    log = Path(answer.err.splitlines()[1].removeprefix("the details are in "))
    assert "RuntimeError" in log.read_text()
    log.unlink()


def test_names_given_by_a_user_steer_no_terminal(registry: Registry, command: Command) -> None:
    answer = command("show", "x\x1b[2J\ny[red]")
    expect(answer, 4)
    assert "\x1b" not in answer.err


def test_a_reader_that_leaves_is_no_error(registry: Registry) -> None:
    line = f"{sys.executable} -m paddlectl explain --json | head -c 10"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "PADDLECTL_REGISTRY": registry.location}
    done = subprocess.run(line, shell=True, env=environment, capture_output=True, timeout=60, check=False)
    assert done.stderr == b""
    assert len(done.stdout) == 10


@pytest.mark.parametrize(
    "closed, code", [("runs >&-", 0), ("runs --json 1>&- 2>&-", 0), ("runs <&-", 0), ("trian 2>&-", 2)]
)
def test_closed_streams_are_no_fault(registry: Registry, closed: str, code: int) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "PADDLECTL_REGISTRY": registry.location}
    line = f"{sys.executable} -m paddlectl {closed}"
    done = subprocess.run(line, shell=True, env=environment, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (code, b"")
    assert (done.stdout == b"") == (closed != "runs <&-")


SLOW = """
import atexit, sys, time
from paddlectl.cli import app
def wait(**_):
    print("ready", flush=True)
    try:
        time.sleep(60)
    finally:
        print("clean-up", flush=True)
        time.sleep(0.3)
        print("done", flush=True)
def leave():
    print("leaving", flush=True)
    time.sleep(0.3)
atexit.register(leave)
app.make_app = lambda loaded: wait
sys.argv = ["paddlectl", "runs"]
sys.exit(app.main())
"""


@pytest.mark.parametrize("number, code", [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupt_has_its_own_exit_code(number: signal.Signals, code: int) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    with subprocess.Popen(
        [sys.executable, "-c", SLOW],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # also where nohup asked otherwise
    ) as child:
        assert child.stdout is not None and child.stderr is not None
        assert child.stdout.readline() == "ready\n"
        time.sleep(0.1)
        child.send_signal(number)
        assert child.wait(10) == code
        assert child.stderr.read().splitlines() in ([], ["interrupted"])


def stormed(line: str | tuple[str, ...], at: str, wait: float, **variables: str) -> tuple[int, str, str]:
    """A process that gets four ^C within half a second, from so long after it printed a line."""
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")} | variables
    child = subprocess.Popen(
        [sys.executable, "-c", *((line,) if isinstance(line, str) else line)],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    assert child.stdout is not None
    while child.stdout.readline() not in (f"{at}\n", ""):
        pass
    time.sleep(wait)
    for _ in range(4):
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGINT)
        time.sleep(0.1)
    out, err = child.communicate(timeout=60)
    return child.returncode, out, err


@pytest.mark.parametrize("at", ["ready", "clean-up", "leaving"])
def test_interrupts_in_a_row_count_as_one_and_let_it_clean_up(at: str) -> None:
    if at != "ready":
        script = SLOW.replace("time.sleep(60)", "pass")
        assert stormed(script, at, 0.0) == (
            (130, "leaving\n", "interrupted\n") if at == "clean-up" else (0, "", "")
        )
    else:
        assert stormed(SLOW, at, 0.1) == (130, "clean-up\ndone\nleaving\n", "interrupted\n")


BEGIN = """
import sys
from paddlectl.cli.app import main
print("begin", flush=True)
sys.exit(main())
"""


@pytest.mark.parametrize(
    "line, wait",
    [
        ("--help", 0.0),
        ("runs", 0.05),
        ("explain", 0.1),
        (f"similarity --target {TARGET}", 0.2),
        ("train BoxDoor --frames 2048", 0.7),
        ("train BoxDoor", 2.5),
    ],
)
def test_interrupts_at_any_moment_leave_no_traceback(registry: Registry, line: str, wait: float) -> None:
    code, _, err = stormed((BEGIN, *line.split()), "begin", wait, PADDLECTL_REGISTRY=registry.location)
    assert code in (0, 130)
    assert err.splitlines()[-1:] in ([], ["interrupted"]) and "Traceback" not in err


def test_an_interrupt_that_is_lost_can_be_given_again(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Deaf:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def make(_: object) -> object:
        def run(**_: object) -> None:
            Deaf()
            signal.raise_signal(signal.SIGINT)
            raise AssertionError("it goes on")

        return run

    monkeypatch.setattr(app, "make_app", make)
    answer = command("runs")
    assert (answer.code, answer.err) == (130, "interrupted\n")


def test_what_an_interrupt_breaks_is_not_told(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise SyntaxError("can't load unicodedata module")

    for place in ("make_app", "_mend_streams"):
        with monkeypatch.context() as patched:
            patched.setattr(app, place, lambda *_: broken())
            patched.setattr(signal, "default_int_handler", signal.getsignal(signal.SIGINT))
            answer = command("runs")
        assert (answer.code, answer.out, answer.err) == (130, "", "interrupted\n")


def test_an_interrupt_while_the_command_line_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "typing.py").write_text(
        "import os, signal\nfor _ in range(2): os.kill(os.getpid(), signal.SIGINT)\n"
    )
    line = f"{sys.executable} -S -c 'import sys; from paddlectl.__main__ import main; sys.exit(main())'"
    environment = {"PYTHONPATH": f"{tmp_path}:{ROOT / 'src'}"}
    done = subprocess.run(line, shell=True, env=environment, capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")


@pytest.mark.parametrize("kind", ["file", "dangling link", "loop"])
def test_a_place_that_is_no_folder(command: Command, tmp_path: Path, kind: str) -> None:
    place = tmp_path / "place"
    if kind == "file":
        place.write_text("")
    else:
        place.symlink_to("place" if kind == "loop" else "nowhere")
    for line in ("runs", "train BoxDoor --frames 1", "registry check", "registry repair"):
        answer = command(*line.split(), "--registry", place)
        expect(answer, 2, "is no folder", "give a folder")
