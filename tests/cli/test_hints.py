"""Every hint that names a command: it is provoked, typed as it stands, and leads on."""

import ast
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from entered import entered
from paddlectl.cli.app import COMMANDS
from paddlectl.errors import PaddlectlError
from paddlectl.experiments import policies, processes
from paddlectl.experiments.jobs import Begun, ResumeJob, TrainJob, TransferJob
from paddlectl.experiments.runner import _source
from paddlectl.methods.base import Setup, method_of
from paddlectl.registry.records import PolicyRecord
from paddlectl.registry.store import Registry
from paddlectl.tasks.suite import load, names
from samples import (
    BLOCKED_DOOR,
    ROOT,
    SCENARIO,
    TARGET,
    Command,
    add_policy,
    add_source,
    add_transfer,
    program,
)

SCENARIO_B = ROOT / "scenarios" / "B.yaml"
COMMAND = rf"paddlectl (?:{'|'.join(COMMANDS)}|--help)"
WAY = re.compile(rf"{COMMAND}(?![\w-])(?: [^\s,;()]+(?:,[^\s,;()]+)*)*")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Runs end at once: what they would have learned is made by hand."""

    def run_jobs(jobs: list[Any], registry: str, *_: object, **__: object) -> list[dict[str, Any]]:
        rows = []
        with Registry.open(registry) as opened:
            for job in jobs:
                match job:
                    case TrainJob():
                        assert job.task in names()
                        text = program(job.task, []) or "0.9 :: gt_key()"
                        add_source(opened, job.task, text, method=job.method, seed=job.seed)
                    case TransferJob(sources=()):
                        entered(opened, job)
                    case TransferJob():
                        add_transfer(opened)
                    case ResumeJob():
                        opened.resume_run(job.run)
                        opened.finish_run(
                            job.run, status="finished", frames=1, episodes=0, seconds=1.0, results={}
                        )
                run = opened.runs()[0] if not isinstance(job, ResumeJob) else opened.run(job.run)
                kept = opened.policy(run.policy) if run.policy else None
                rows.append({"run": run.id, "policy": run.policy, "crispness": kept and kept.crispness})
        return rows

    played = policies.evaluate

    def evaluate(registry: Registry, policy: PolicyRecord, *more: Any) -> dict[str, Any]:
        return {"policy": policy.id} if policy.task == TARGET else played(registry, policy, *more)

    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", run_jobs)
    monkeypatch.setattr("paddlectl.experiments.policies.evaluate", evaluate)
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("COLUMNS", "999")


def ways(text: str) -> list[list[str]]:
    """The commands in a text, as a shell takes them apart."""
    return [shlex.split(found)[1:] for line in text.splitlines() for found in WAY.findall(line)]


def damaged(registry: Registry, file: str, data: bytes = b"{}") -> None:
    path = registry.folder / file
    assert path.exists()
    path.write_bytes(data)


def stopped(
    registry: Registry, kind: str = "train", method: str = "hdm", status: str = "interrupted"
) -> None:
    run = registry.add_run(
        kind=kind, method=method, task="BoxDoor", scenario=None, sources=(), seed=0, settings={}, versions={}
    )
    if status != "running":
        registry.finish_run(run.id, status=status, frames=1, episodes=0, seconds=1.0, results={})


def nothing(_: Registry) -> None:
    pass


def gone(registry: Registry) -> None:
    shutil.rmtree(registry.folder)


def only(*tasks: str) -> Callable[[Registry], None]:
    """A registry with sources of these tasks alone."""

    def make(registry: Registry) -> None:
        gone(registry)
        with Registry.open(registry.folder) as fresh:
            for task in tasks:
                add_source(fresh, task, program("BlockedDoor", BLOCKED_DOOR))

    return make


def from_scratch(registry: Registry) -> None:
    run = registry.add_run(
        kind="transfer", method="hdm", task=TARGET, scenario="A", sources=(), seed=0, settings={}, versions={}
    )
    add_policy(registry, run.id, TARGET, program(TARGET, [("EX", "gt_blockage", 0.9)]))
    figures = {"jump_start": 0.1, "final_score": 0.2, "final_success": 0.3}
    registry.finish_run(run.id, status="finished", frames=9, episodes=1, seconds=1.0, results=figures)


def flat(registry: Registry) -> None:
    for task in ("GapBall", "DoorBall"):
        add_source(registry, task, None, method="ppo")


def of_maze(registry: Registry) -> None:
    add_source(registry, "MailMaze", None, domain="maze2d")


def with_sources(sources: str) -> None:
    """A scenario file with these sources."""
    Path("x.yaml").write_text(SCENARIO.replace("[BlockedDoor, GapBall]", sources))


STUDY = f"{{name: x, scenarios: [{ROOT}/scenarios/A.yaml], methods: [hdm], seeds: [0]}}"


def damaged_program(registry: Registry) -> None:
    add_source(registry, "DoorBall", "0.9 :: gt_key( :-")


def lost_row(registry: Registry) -> None:
    digest = registry.policy("policy-3").checkpoint
    (registry.folder / "objects" / f"{digest}.safetensors").unlink()


def lost_object(registry: Registry) -> None:
    for path in (registry.folder / "objects").iterdir():
        path.unlink()


def no_manifest(registry: Registry) -> None:
    (registry.folder / "manifests" / "run-3.json").unlink()


def study(_: Registry) -> None:
    Path("study.yaml").write_text(
        f"name: s\nscenarios: [{ROOT}/scenarios/A.yaml]\nmethods: [hdm]\nseeds: 0\n"
    )


PROVOKED: list[tuple[Callable[[Registry], object], str]] = [
    (nothing, "trian"),
    (lost_row, "registry repair"),
    (nothing, "train"),
    (nothing, "runs --jsn"),
    (nothing, "registry exprt"),
    (nothing, "train BoxDoor --frames 400k"),
    (nothing, "train BoxDoor --frames 2048"),
    (nothing, f"transfer {ROOT}/scenarios/A.yaml --seed 0"),
    (nothing, "show GapBal"),
    (nothing, "show DoorBal"),
    (nothing, "show doorball"),
    (nothing, "show DoorBall"),
    (nothing, "show quaternions"),
    (nothing, "show run-9"),
    (nothing, "show policy-9"),
    (nothing, "evaluate OpenGoa"),
    (nothing, "evaluate GapBall"),
    (nothing, "registry export BoxDor never.zip"),
    (nothing, "registry export run-9 never.zip"),
    (nothing, "registry import nowhere.zip"),
    (nothing, f"similarity --target {TARGET} --source DoorBal"),
    (only(), "similarity --target BoxDoor"),
    (only("BoxDoor"), "similarity --target BoxDoor"),
    (only("BlockedDoor"), "similarity --target BlockedDoor"),
    (only("BlockedDoor"), "explain"),
    (nothing, "compare --method ptf"),
    (only("BlockedDoor"), "compare"),
    (nothing, "compare nothing.json"),
    (lambda _: Path("x.json").write_text("[]"), "compare x.json"),
    (nothing, f"compare {ROOT}/benchmarks/paper/fig4.json --scenario zz"),
    (lambda _: Path("x.yaml").write_text(STUDY), "compare x.yaml"),
    (gone, "runs"),
    (gone, "registry check"),
    (nothing, f"transfer {SCENARIO_B} --seed 0"),
    (gone, f"transfer {SCENARIO_B} --seed 0"),
    (lambda _: with_sources("[policy-1, BoxDoor]"), "transfer x.yaml"),
    (lambda _: with_sources("[policy-11]"), "transfer x.yaml"),
    (lambda r: (flat(r), with_sources("[policy-5]")), "transfer x.yaml"),
    (lambda r: (of_maze(r), with_sources("[policy-4]")), "transfer x.yaml"),
    (lambda _: with_sources("{tasks: [BlockedDoor, BoxDoor], seed: paired}"), "transfer x.yaml"),
    (lambda _: with_sources("{tasks: [GapBall, BoxDoor], seed: paired}"), "transfer x.yaml --seeds 0-1,4"),
    (flat, f"similarity --target {TARGET} --source DoorBall"),
    (nothing, "explain run-1"),
    (nothing, "explain run-77"),
    (nothing, "explain policy-1"),
    (nothing, "explain GapBall"),
    (stopped, "explain run-4"),
    (lambda r: stopped(r, status="failed"), "explain run-4"),
    (lambda r: stopped(r, status="running"), "explain run-4"),
    (lambda r: stopped(r, method="random"), "explain run-4"),
    (lambda r: stopped(r, "transfer"), "explain run-4"),
    (lambda r: stopped(r, "transfer", status="running"), "explain run-4"),
    (from_scratch, "explain run-4"),
    (from_scratch, "resume run-4"),
    (nothing, "plot run-1"),
    (nothing, "plot run-9"),
    (stopped, "watch run-4 --gif run.gif"),
    (lambda r: r.label_runs(["run-1"], name="BoxDoor"), "train BoxDoor"),
    (nothing, "plot fig4.csv"),
    (lambda _: Path("fig4.json").write_text("[]"), "plot fig5.json"),
    (study, "sweep study.yaml --dry-run"),
    (nothing, "transfer paper/fig6a"),
    (nothing, "transfer A --seed 0"),
    (nothing, "sweep A"),
    (nothing, "compare paper/fig6a"),
    (nothing, "plot paper/fig6a"),
    (nothing, "resume"),
    (nothing, "resume run-1"),
    (nothing, "resume run-3"),
    (nothing, "resume run-9"),
    (lambda r: stopped(r, status="running"), "registry check"),
    (damaged_program, "show DoorBall"),
    (damaged_program, f"similarity --target {TARGET} --source DoorBall"),
    (lost_object, "evaluate GapBall"),
    (no_manifest, "explain run-3"),
    (no_manifest, "registry gc"),
    (lambda r: damaged(r, "runs/run-3/trace.json"), "explain run-3"),
    (lambda r: damaged(r, "manifests/run-3.json"), "explain run-3"),
    (lambda r: damaged(r, "registry.db"), "runs"),
    (lambda r: damaged(r, "registry.db"), "registry check"),
    (lambda r: (r.folder / "registry.db").unlink(), "runs"),
    (lambda r: (r.folder / "registry.db").unlink(), "registry check"),
    (lambda r: shutil.rmtree(r.folder / "runs" / "run-3"), "explain run-3"),
]  # fmt: skip


def templates() -> Iterator[tuple[str, str]]:
    """The texts of the package with a command in it: where they stand, and a pattern of what they become."""
    for path in sorted((ROOT / "src").rglob("*.py")):
        tree = ast.parse(path.read_text())
        strings = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
        inner = {id(part) for node in strings for part in node.values}
        for node in ast.walk(tree):
            match node:
                case ast.JoinedStr(values=values):
                    parts = [
                        re.escape(part.value) if isinstance(part, ast.Constant) else ".+" for part in values
                    ]
                case ast.Constant(value=str(text)) if id(node) not in inner:
                    parts = [re.escape(text)]
                case _:
                    continue
            pattern = "".join(parts)
            if re.search(COMMAND, pattern.replace("\\", "")) and not re.match("Example|.*`", pattern):
                yield f"{path.name}:{node.lineno}", pattern


# Where what is stored is damaged in other ways than above, all with `registry check` or `repair`; and the
# card in a bundle, which is no hint.
ALIKE = {"card.py", "checkpoints.py", "documents.py", "manifests.py", "schema.py", "faults.py"}


def stop_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The next command that learns is stopped by ^C once run-4 has begun."""
    usual = processes.run_jobs

    def run_jobs(_: object, __: object, tell: Callable[..., None], *___: object) -> None:
        monkeypatch.setattr(processes, "run_jobs", usual)
        tell(0, Begun("run-4"))
        raise KeyboardInterrupt

    monkeypatch.setattr(processes, "run_jobs", run_jobs)


Tried = Callable[[Callable[[Registry], object], str], str]


@pytest.fixture
def tried(
    registry: Registry, command: Command, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Tried:
    """Types a line and each command that it names, and gives all that was told; if asked, by --registry."""
    whole = registry.folder.with_name("whole")
    shutil.copytree(registry.folder, whole)

    def typed(made: Callable[[Registry], object], line: str) -> str:
        shutil.rmtree(registry.folder, ignore_errors=True)
        shutil.copytree(whole, registry.folder)
        made(registry)
        words = line.split()
        if request.param and words[0] in COMMANDS and line != "train":
            monkeypatch.delenv("PADDLECTL_REGISTRY", raising=False)
            words += ["--registry", str(registry.folder)]
        answer = command(*words)
        found = ways(answer.out + answer.err)
        assert found, (line, answer)
        return answer.out + answer.err + "".join(followed(command, way) for way in found)

    return typed


def followed(command: Command, way: list[str]) -> str:
    answer = command(*way)
    faults = way[:2] == ["registry", "check"] and "faults" in answer.out
    assert answer.code == 0 or (answer.code == 5 and faults), (way, answer)
    return answer.out + answer.err


@pytest.mark.parametrize("tried", [True], ids=["elsewhere"], indirect=True)
def test_the_command_in_a_hint_names_the_registry_that_was_named(tried: Tried) -> None:
    for made, line in PROVOKED[::3]:
        tried(made, line)


@pytest.mark.parametrize("tried", [False], ids=["here"], indirect=True)
def test_the_command_in_a_hint_works_and_no_hint_is_left_out(
    tried: Tried, registry: Registry, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = [tried(made, line) for made, line in PROVOKED]
    told.append(tried(lambda r: (stopped(r), stop_once(monkeypatch)), "train BoxDoor"))
    told.append(tried(lambda r: (study(r), stop_once(monkeypatch)), "sweep study.yaml"))
    with monkeypatch.context() as patched:
        for shortest in ("explained.SHORTEST", "summary.MOST"):
            patched.setattr(f"paddlectl.report.{shortest}", 1)
        told += [tried(nothing, f"explain run-3{full}") for full in ("", " --full")]
    damaged_program(registry)
    with pytest.raises(PaddlectlError) as caught:
        _source(registry, registry.policy("DoorBall").id)
    told += [caught.value.hint, *(followed(command, way) for way in ways(caught.value.hint))]
    for task, name in [(TARGET, "componet"), *product((TARGET, "MailMaze"), ("finetune", "cup", "ptf"))]:
        method = method_of(name)
        with pytest.raises(PaddlectlError) as caught:
            method.make(Setup(load(task), method.settings_for(load(task), None), 0, 1))
        told += [caught.value.hint, *(followed(command, way) for way in ways(caught.value.hint))]
    everything = "\n".join(told)
    left = [
        where
        for where, pattern in templates()
        if where.partition(":")[0] not in ALIKE and not re.search(pattern, everything)
    ]
    assert left == []


def test_what_is_no_run_or_policy_is_told_with_what_may_have_been_meant(
    registry: Registry, command: Command
) -> None:
    for line in ("show RUN-1", "watch run-11 --gif x.gif", "evaluate run_1"):
        answer = command(*line.split())
        assert answer.code == 4 and "no run" in answer.err and "did you mean run-" in answer.err, line
    for line in ("explain policy-1", "resume policy-1"):
        answer = command(*line.split())
        assert answer.err == "error: policy-1 is a policy; run-1 learned it\nrun: paddlectl runs\n", line


def test_a_run_that_goes_on_is_told_so_far(registry: Registry, command: Command) -> None:
    run = registry.add_run(
        kind="transfer", method="paddle", task=TARGET, scenario="A", sources=["policy-1"], seed=0,
        settings={"frames": 9000}, versions={},
    ).id  # fmt: skip
    registry.files.append_rows(run, "progress", [{"frames": 4096, "episodes": 12, "seconds": 1.0}])
    assert "4,096 of 9,000 frames, 12 episodes" in command("show", run).out
    assert "4,096 frames, running" in command("explain", run).out
    assert command("runs", "--json").json["runs"][0]["episodes"] == 12
