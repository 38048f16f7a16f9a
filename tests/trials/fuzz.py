"""Hostile input: scenario files, programs, bundles, index files, command lines (R9, R11-R14).

Whatever comes in is taken, or refused with a documented error, soon and in little memory; nothing is left.
"""

import contextlib
import io
import os
import random
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Clause, Program
from paddlectl.logic.syntax import format_program, parse_program
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.care.repair import repair
from paddlectl.registry.store import Registry
from paddlectl.scenario import load_scenario
from samples import SCENARIO
from trials.killed_writers import write_one

CODES = {0, 1, 2, 3, 4, 5, 6, 7}
SLOWEST = 2.0  # seconds
NASTY = [
    "&a [*a]", "*a", "!!python/object/apply:os.system ['touch canary']", "!!binary aGk=", "!!set {a}",
    "<<: {a: 1}", "1:30", "0100", "0x10", "0b1", "1e999", ".nan", "-.inf", "yes", "no", "on", "~",
    "null", "1_000", "9" * 5000, "[" * 500, "{a: " * 500, "? a", "|\n  x", ">\n  x", "'", '"',
    '"\\uD800"', "\x00", "\x1b[2J", "\u202e", "\ufeff", "---", "...", "%YAML 9.9", "\t", "- - - -",
    "a: b: c", "2026-01-01", "!", "!!", "@", "`", "[a, a]", "1.0", "-1", "true", "../..", "policy-1",
    "[red]x[/red]", "<script>",
]  # fmt: skip


def mutated(data: bytes, dice: random.Random, tokens: list[bytes]) -> bytes:
    """The data with one to a dozen changes: bits, cuts, copies, and tokens that mean something there."""
    changed = bytearray(data)
    for _ in range(dice.choice([1, 1, 1, 2, 4, 12])):
        at = dice.randrange(len(changed) + 1)
        match dice.randrange(6):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << dice.randrange(8)
            case 1:
                del changed[at : at + dice.randrange(1, 20)]
            case 2:
                start = dice.randrange(len(changed) + 1)
                changed[at:at] = changed[start : start + dice.randrange(1, 60)]
            case 3:
                changed[at:at] = dice.randbytes(dice.randrange(1, 5))
            case _:
                token = dice.choice(tokens)
                changed[at : at + dice.choice([0, len(token)])] = token
    return bytes(changed)


@contextlib.contextmanager
def soon() -> Iterator[None]:
    began = time.monotonic()
    yield
    assert time.monotonic() - began <= SLOWEST


def _told(error: PaddlectlError) -> None:
    assert error.exit_code in CODES and len(str(error).splitlines()) <= 2 and len(str(error)) < 2000


def yaml_files(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Scenario files."""
    dice, taken, path = random.Random(seed), 0, folder / "x.yaml"
    tokens = [text.encode("utf-8", "surrogatepass") for text in NASTY]
    for _ in range(count):
        path.write_bytes(mutated(SCENARIO.encode(), dice, tokens))
        with soon():
            try:
                scenario = load_scenario(path)
            except PaddlectlError as error:
                _told(error)
            else:
                taken += 1
                again = scenario.model_validate_json(scenario.model_dump_json())
                assert again == scenario
    assert [entry.name for entry in folder.iterdir()] == ["x.yaml"]
    return {"files": count, "taken": taken, "nasties": len(NASTY), "megabytes": megabytes(300)}


def programs(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Clause text; and half as many generated programs, which must survive their text."""
    dice, taken = random.Random(seed), 0
    tokens = [
        b":-",
        b"::",
        b"!",
        b"(",
        b")",
        b",",
        b"%",
        b"\n",
        b"1e999",
        b"nan",
        b"-0",
        b"0." + b"1" * 400,
        b"A",
    ]
    tokens += [b"gt_key()", b"0.5 :: ", "é".encode(), b"\x00", b"\x1b[2J", b"[red]"]
    text = format_program(_program(dice)).encode()
    for number in range(count):
        if number % 50 == 0:
            text = format_program(_program(dice)).encode()
        with soon():
            try:
                program = parse_program(mutated(text, dice, tokens).decode("utf-8", "replace"))
            except PaddlectlError as error:
                _told(error)
            else:
                taken += 1
                assert parse_program(format_program(program)) == program
    for _ in range(count // 2):
        program = _program(dice)
        assert parse_program(format_program(program)) == program
    return {"texts": count, "taken": taken, "round_trips": count // 2, "megabytes": megabytes(300)}


def _program(dice: random.Random) -> Program:
    atoms = [Predicate(f"p{n}", n % 3)(*["agent", "env"][: n % 3]) for n in range(dice.randrange(1, 6))]
    heads = [Predicate(f"gt_{n}", 0)() for n in range(3)]
    found = {
        Clause(dice.choice(heads), frozenset(Literal(atom, dice.random() < 0.5) for atom in atoms))
        for _ in range(dice.randrange(8))
    }
    return Program(tuple(found), tuple(dice.choice([dice.random(), 1e-300, 0.0, 1.0]) for _ in found))


def bundle_files(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Bundles: any change at all is refused, and no registry is made for it."""
    dice, place = random.Random(seed), folder / "other"
    registry = Registry.open(folder / "registry")
    write_one(registry, 0)
    bundles.export(registry, "run-1", folder / "x.zip")
    data = (folder / "x.zip").read_bytes()
    tokens = [
        b"../",
        b"\x00",
        b"PK\x01\x02",
        b"PK\x03\x04",
        b"PK\x05\x06",
        b'"',
        b"{",
        b"[",
        b"1e999",
        b"\xff" * 8,
    ]
    for _ in range(count):
        changed = mutated(data, dice, tokens)
        if changed == data:
            continue
        (folder / "x.zip").write_bytes(changed)
        with soon():
            try:
                bundles.import_(lambda: Registry.open(place), folder / "x.zip")
            except IntegrityError as error:
                _told(error)
            else:
                raise AssertionError("a changed bundle was taken in")
    assert not place.exists()
    return {"bundles": count, "taken": 0, "megabytes": megabytes(500)}


def index_files(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Damaged index files: told by `check`, and mended with nothing lost by `repair`."""
    dice, place = random.Random(seed), folder / "registry"
    registry = Registry.open(place)
    for number in range(4):
        write_one(registry, number)
    data = (place / "registry.db").read_bytes()
    wanted = registry.runs(), registry.policies()
    found = 0
    for _ in range(count):
        changed = bytearray(data)
        for _ in range(dice.choice([1, 4, 64])):
            changed[dice.randrange(len(changed))] = dice.randrange(256)
        cut = dice.choice([len(changed), len(changed), dice.randrange(len(changed) + 1)])
        foreign = dice.random() < 0.05
        (place / "registry.db").write_bytes(dice.randbytes(5000) if foreign else bytes(changed[:cut]))
        try:
            found += bool(check(place).faults)
            repair(place)
            assert (registry.runs(), registry.policies()) == wanted
        except PaddlectlError as error:
            _told(error)  # a stamp that seems to be of a newer version: nothing is touched then
            assert error.exit_code == 7, error
        for leftover in place.glob("registry.db?*"):
            leftover.unlink()
        if (place / "aside").exists():
            shutil.rmtree(place / "aside")
    return {"files": count, "found": found, "lost": 0}


WORDS = [
    "tasks", "train", "evaluate", "policies", "runs", "show", "similarity", "transfer", "explain",
    "resume", "registry", "check", "repair", "gc", "export", "import", "upgrade", "--json",
    "--registry", "--seed", "--seeds", "--frames", "--episodes", "--task", "--target", "--source",
    "--method", "--all", "--read-data", "--dry-run", "--older-than", "--checkpoint-every", "-h",
    "--help", "--", "-", "-1", "0", "1e9", "nan", "0-5", "5-0", "latest", "BoxDoor", "GapBall",
    "BlockedBoxUnlockPickup", "BoxDor", "policy-1", "run-1", "run-99", "policy-0", "../..", "",
    "/dev/null", "/proc/self/mem", "\x1b[2J", "[red]x[/red]", "é", "\u202e", "a" * 5000, "%s", "{}",
    "$(touch canary)", "\udcff", "postgresql://me:s3cret@nowhere/x", "sqlite:///", "http://x", "x.zip",
    "A.yaml", "9" * 40, "\n", "--x=y",
]  # fmt: skip
VARIABLES = ["PADDLECTL_REGISTRY", "COLUMNS", "NO_COLOR", "TERM", "LANG", "FORCE_COLOR"]


def command_lines(count: int, seed: int, folder: Path) -> dict[str, Any]:
    """Arguments and environments, run in this process; what would train is only asked for."""
    from paddlectl.cli import app
    from paddlectl.experiments import processes

    dice, codes = random.Random(seed), dict.fromkeys(sorted(CODES), 0)
    registry = Registry.open(folder / "registry")
    write_one(registry, 0)
    (folder / "A.yaml").write_text(SCENARIO)
    os.chdir(folder)
    before = {path for path in folder.rglob("*") if not path.is_relative_to(folder / "registry")}

    def asked(*_: Any, **__: Any) -> Any:
        raise PaddlectlError("nothing is learned here")

    for _ in range(count):
        line = [dice.choice(WORDS[:11]), *dice.choices(WORDS, k=dice.randrange(6))]
        named = {
            name: dice.choice([*WORDS, str(folder / "registry")]) for name in VARIABLES if dice.random() < 0.2
        }
        named = {"PADDLECTL_REGISTRY": "registry"} | named
        out, err = io.StringIO(), io.StringIO()
        with (
            soon_enough(line),
            mock.patch.dict(os.environ, named),
            mock.patch.object(sys, "argv", ["paddlectl", *line]),
            mock.patch.object(processes, "run_jobs", asked),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            code = app.main()
        told = out.getvalue() + err.getvalue()
        assert code in CODES, (line, named, code)
        assert "Traceback" not in told and "the details are in" not in told, (line, named, told)
        assert "s3cret" not in told, (line, named)
        assert "\x1b[2J" not in told and "\u202e" not in told, (line, named)
        codes[code] += 1
    left = {path for path in folder.rglob("*") if not path.is_relative_to(folder / "registry")} - before
    strange = {path for path in left if "canary" in path.name}
    assert not strange, strange
    return {"lines": count, "codes": {str(code): n for code, n in codes.items()}, "megabytes": megabytes(600)}


@contextlib.contextmanager
def soon_enough(line: list[str]) -> Iterator[None]:
    began = time.monotonic()
    yield
    assert time.monotonic() - began <= 30.0, line


def megabytes(most: int) -> int:
    """Most memory that this process had, which mustn't be more than `most`.

    `ru_maxrss` would count what its parent had when it was started.
    """
    told = Path("/proc/self/status").read_text()
    found = int(re.search(r"VmHWM:\s+(\d+) kB", told)[1]) // 1024
    assert found <= most, f"{found} megabytes"
    return found
