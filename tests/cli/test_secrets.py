"""A secret in the environment, in an address or in a scenario file comes out nowhere (R20)."""

import os
from collections.abc import Iterator
from pathlib import Path
from unittest import mock
from urllib.parse import quote

import psycopg
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import inline
from paddlectl.cli import app
from paddlectl.cli.texts import without_secrets
from paddlectl.errors import PaddlectlError
from paddlectl.registry.index import connecting
from paddlectl.registry.schema import metadata
from paddlectl.registry.store import Registry
from postgres import server
from samples import BLOCKED_DOOR, GAP_BALL, SCENARIO, Answer, Command, add_source, add_transfer, program

CANARY = "canary%2Fs3cret"
"""As it stands in an address; it is found in either spelling."""
SPELLINGS = ("canary/s3cret", CANARY)
LINES = (
    "tasks", "runs", "policies", "show policy-3", "similarity --target OpenGoal", "explain latest",
    "registry check --read-data", "registry repair", "registry gc", "registry upgrade",
    "registry export run-3 {folder}/x.zip", "registry import {folder}/x.zip --registry {folder}/other",
    "registry check --registry {folder}/other", "explain run-1 --registry {folder}/other",
)  # fmt: skip
REFUSED = (
    "show policy-77", "evaluate policy-3 --task Nowhere", "registry export run-77 {folder}/y.zip",
    "runs --registry postgresql://me:{canary}@localhost:1/x?files={folder}/files",
    "train BoxDoor --registry mysql://me:{canary}@localhost/x",
    "runs --registry postgresql://me:{canary}@[/x?files=y", "runs --registry http://me:{canary}@x/y",
    "registry import postgresql://me:{canary}@x/y",
)  # fmt: skip
FILES = (
    "password: {canary}\n", "frames: {canary}\n", "similarity: {{token: {canary}}}\n",
    "seeds: [{canary}]\n", "guidance: {{mode: default}}\ntoken: [{canary}\n", "other: &a {canary}\n",
)  # fmt: skip


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    with server() as running:
        yield running.new(tmp_path / "files", CANARY)


def stored(registry: Registry) -> str:
    """Every row of the index."""
    with registry.index.writing() as connection:
        return str([connection.execute(table.select()).all() for table in metadata.sorted_tables])


def test_a_secret_comes_out_nowhere(
    address: str, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"PADDLECTL_REGISTRY": address, "CLOUD_SECRET_KEY": SPELLINGS[0]}.items():
        monkeypatch.setenv(name, value)
    registry = Registry.open(address)
    for task, clauses in (("BlockedDoor", BLOCKED_DOOR), ("GapBall", GAP_BALL)):
        add_source(registry, task, program(task, clauses))
    add_transfer(registry)
    monkeypatch.setattr("paddlectl.experiments.processes.run_jobs", inline.run_jobs)
    told = [command("train", "BoxDoor", "--frames", 1)]
    for line in LINES:
        words = line.format(folder=tmp_path).split()
        told += [command(*words)] + [command(*words, "--json")] * ("export" not in words)
    assert [answer for answer in told if answer.code] == []
    for line in REFUSED:
        told.append(command(*line.format(folder=tmp_path, canary=CANARY).split()))
        assert told[-1].code not in (0, 130), line
    scenario = tmp_path / "secret.yaml"
    for text in FILES:
        scenario.write_text(f"# token: {CANARY}\n{SCENARIO}{text.format(canary=CANARY)}")
        told.append(command("transfer", scenario))
        assert told[-1].code == 3 and "secret.yaml:" in told[-1].err, text
    scenario.unlink()
    told.append(unforeseen(address, command, tmp_path, monkeypatch))
    kept = {str(path): path.read_bytes().decode("latin-1") for path in tmp_path.rglob("*") if path.is_file()}
    assert len(kept) > 10
    kept |= {"PostgreSQL": stored(registry), "SQLite": stored(Registry.open(tmp_path / "other"))}
    kept |= {str(number): answer.out + answer.err for number, answer in enumerate(told)}
    assert [(place, text) for place, text in kept.items() if any(s in text for s in SPELLINGS)] == []


def unforeseen(address: str, command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Answer:
    """An error that nobody foresaw, with the address in its message, and so in its log."""

    def wrong(_: object) -> None:
        raise RuntimeError(f"no answer from {address}")

    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.setattr(app, "make_app", wrong)
    answer = command("runs")
    assert answer.code == 1 and list(folder.glob("paddlectl-*.log"))
    return answer


# Passwords with every odd character, and addresses with every slip

MARKS = ("c4n4ry", "s3cret")
PASSWORDS = st.text("@/:?#[]%&=+ \t\n'\"\\;,.<>{}|^`~!$*()-é\u202e\x1b", max_size=4).map(
    lambda odd: MARKS[0] + odd + MARKS[1]
)
REST = "127.0.0.1:1/db?files={folder}/files"
ADDRESSES = (
    "postgresql://me:{secret}@" + REST, "postgres://me:{secret}@" + REST, "postgre://me:{secret}@" + REST,
    "POSTGRESQL://me:{secret}@" + REST, "mysql://me:{secret}@" + REST, "postgresql:/me:{secret}@" + REST,
    "postgresql//me:{secret}@" + REST, "postgresql:me:{secret}@" + REST, " postgresql://me:{secret}@" + REST,
    "'postgresql://me:{secret}@" + REST, "postgresql+psycopg2://me:{secret}@" + REST, "me:{secret}@" + REST,
    "postgresql//{secret}@" + REST, "postgresql://{secret}:me@" + REST, "postgresql://{secret}@" + REST,
    "postgresql://me:{secret}@nowhere.invalid/db?files={folder}/files", "sqlite:///me:{secret}@x",
    "postgresql://me:{secret}@[/db?files={folder}/files", "postgresql://me:{secret}@h:port/db?files=y",
    "postgresql://me:{secret}@h", "postgresql://me:{secret}", "postgresql://me@h:1/db?password={secret}",
    "postgresqlh/db?files={folder}/files&password={secret}", "http://me:{secret}@h/db?files={folder}/x@y",
)  # fmt: skip


def expect_nothing_of(text: str) -> None:
    assert not [mark for mark in MARKS if mark in text], text


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(password=PASSWORDS, quoted=st.booleans(), line=st.sampled_from(["runs", "train BoxDoor"]))
def test_no_part_of_a_login_comes_out_of_any_address(
    command: Command, tmp_path: Path, password: str, quoted: bool, line: str
) -> None:
    secret = quote(password, safe="") if quoted else password
    for number, address in enumerate(ADDRESSES):
        place = address.replace("{secret}", secret).replace("{folder}", str(tmp_path))
        if number % 2:
            with mock.patch.dict(os.environ, PADDLECTL_REGISTRY=place):
                answer = command(*line.split())
        else:
            answer = command(*line.split(), "--registry", place)
        assert answer.code in (1, 2), (place, answer)
        expect_nothing_of(answer.out + answer.err)
    assert not [path for path in tmp_path.rglob("*") if path.name != "registry"]


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(password=PASSWORDS)
def test_no_part_of_a_login_comes_out_of_what_a_driver_says(
    command: Command, tmp_path: Path, password: str
) -> None:
    address = f"postgresql://l0gin:{quote(password, safe='')}@localhost/db?files={tmp_path}/files"
    says = f'no {address}, no {password}, no {password!r}, FATAL: no user "l0gin", no {quote(password)}'
    for error in (psycopg.OperationalError, psycopg.errors.InvalidPassword):
        with mock.patch.object(connecting._Connection, "connect", side_effect=error(says)):
            with pytest.raises(PaddlectlError) as caught:
                Registry.open(address)
            answer = command("runs", "--registry", address)
        for text in (str(caught.value), answer.err):
            expect_nothing_of(text)
            assert "l0gin" not in text and "FATAL: no user" in text


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(password=PASSWORDS)
def test_no_part_of_a_login_comes_out_where_an_address_is_given_by_mistake(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, password: str
) -> None:
    password *= 9  # so long that a message may cut it
    address = f"postgresql://me:{password}@localhost/db"
    for line in ("show", "explain", "train", "registry import", "resume", "runs --frames", "evaluate --seed"):
        answer = command(*line.split(), address)
        assert answer.code not in (0, 130)
        expect_nothing_of(answer.out + answer.err)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for debug in ("", "1"):
        given = mock.patch.dict(os.environ, PADDLECTL_REGISTRY=address, PADDLECTL_DEBUG=debug)
        wrong = RuntimeError(f"no {address}\n{password!r}")
        with given, mock.patch.object(app, "make_app", side_effect=wrong):
            answer = command_or_traceback(command)
        expect_nothing_of(answer)
    for log in tmp_path.glob("paddlectl-*.log"):
        expect_nothing_of(log.read_text())
        log.unlink()


def command_or_traceback(command: Command) -> str:
    try:
        answer = command("runs")
    except AssertionError as error:  # it lets no traceback pass, but this one was asked for
        return str(error)
    return answer.out + answer.err


@pytest.mark.parametrize(
    "text",
    ["no file x:/y", "run: paddlectl train BoxDoor", "postgresql://host/db didn't answer", "me@host is away"],
)
def test_what_is_no_secret_is_told(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["paddlectl", "runs"])
    assert without_secrets(text) == text
