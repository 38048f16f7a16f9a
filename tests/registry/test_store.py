import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from paddlectl.errors import IntegrityError, NotFoundError, PaddlectlError, UsageError
from paddlectl.registry.store import Registry

BOTH = ("sqlite", "postgres")


@pytest.fixture(params=BOTH)
def registry(request: pytest.FixtureRequest) -> Registry:
    found: Registry = request.getfixturevalue(f"{request.param}_registry")
    return found


END: dict[str, Any] = {"status": "finished", "frames": 400_000, "episodes": 1200, "seconds": 61.5}


def _add_policy(registry: Registry, run: str) -> None:
    registry.add_policy(
        run=run,
        task="BoxDoor",
        domain="minigrid",
        method="hdm",
        seed=0,
        frames=1,
        program="",
        checkpoint=b"",
        success_rate=1.0,
        mean_score=1.0,
        mean_length=1.0,
        crispness=1.0,
        metadata={},
    )


def test_a_run_from_start_to_end(registry: Registry, add: Any) -> None:
    opened = add.run(kind="transfer", method="paddle", scenario="A", sources=["policy-1", "policy-2"], seed=3)
    assert (opened.id, opened.status, opened.frames, opened.finished) == ("run-1", "running", 0, None)
    assert (opened.scenario, opened.sources, opened.seed) == ("A", ("policy-1", "policy-2"), 3)
    closed = registry.finish_run("run-1", results={"final_success": 0.97}, **END)
    assert closed == replace(opened, results={"final_success": 0.97}, finished=closed.finished, **END)
    assert closed.finished is not None and closed.finished >= closed.created
    assert registry.run("run-1") == closed


def test_runs_and_policies_come_newest_first(registry: Registry, add: Any) -> None:
    first, second = add.run(), add.run()
    older, newer = add.policy(second.id), add.policy(second.id)
    assert [run.id for run in registry.runs()] == ["run-2", "run-1"]
    assert [policy.id for policy in registry.policies()] == [newer.id, older.id]
    assert [run.policy for run in registry.runs()] == [newer.id, None]
    assert registry.run(first.id).policy is None


def test_a_policy_is_what_was_added(registry: Registry, add: Any) -> None:
    add.run()
    policy = add.policy("run-1", metadata={"atoms": ["has_key(agent)"]}, mean_score=-0.25)
    assert (policy.id, policy.run, policy.domain) == ("policy-1", "run-1", "minigrid")
    assert (policy.mean_score, policy.metadata) == (-0.25, {"atoms": ["has_key(agent)"]})
    assert registry.policy("policy-1") == policy
    assert registry.read_checkpoint(policy) == b"weights"


@pytest.mark.parametrize(
    ("figures", "best"),
    [
        ([(0.9, 0.5), (0.8, 0.9)], 1),
        ([(0.9, 0.5), (0.9, 0.6)], 2),
        ([(0.9, 0.6), (0.9, 0.5)], 1),
        ([(0.9, 0.6), (0.9, 0.6)], 2),
    ],
)
def test_the_best_policy_of_a_task(
    registry: Registry, add: Any, figures: list[tuple[float, float]], best: int
) -> None:
    add.run()
    for success, score in figures:
        add.policy("run-1", success_rate=success, mean_score=score)
    add.policy("run-1", task="GapBall", success_rate=1.0)
    assert registry.policy("BoxDoor").id == f"policy-{best}"


@pytest.mark.parametrize(
    ("ask", "what", "next_step"),
    [
        (lambda r: r.run("run-11"), "no run run-11", "did you mean run-1?"),
        (lambda r: r.run("../../etc"), "no run ../../etc", "run: paddlectl runs"),
        (lambda r: r.run("run-١"), "no run run-١", "run: paddlectl runs"),
        (lambda r: r.run("run-1\n"), r"no run 'run-1\n'", "run: paddlectl runs"),
        (lambda r: r.policy("policy-12"), "no policy policy-12", "did you mean policy-1?"),
        (lambda r: r.policy("DoorBall"), "no policy for DoorBall", "run: paddlectl train DoorBall"),
        (
            lambda r: r.policy("BoxDoor", "ppo"),
            "no policy for BoxDoor by ppo",
            "run: paddlectl train BoxDoor",
        ),
        (lambda r: r.policy("BoxDor"), "no policy for BoxDor", "did you mean BoxDoor?"),
        (lambda r: r.policy("boxdoor"), "no policy for boxdoor", "did you mean BoxDoor?"),
        (lambda r: r.finish_run("run-9", results={}, **END), "no run run-9", "did you mean run-1?"),
        (lambda r: _add_policy(r, "run-9"), "no run run-9", "did you mean run-1?"),
        (
            lambda r: r.files.append_rows("run-9", "episodes", [{}]),
            "no folder of a run run-9",
            "paddlectl runs",
        ),
        (
            lambda r: r.files.read_rows("../run-1", "episodes"),
            "no folder of a run ../run-1",
            "paddlectl runs",
        ),
        (lambda r: r.files.read_document("/etc", "passwd"), "no folder of a run /etc", "paddlectl runs"),
    ],
)
def test_what_isnt_there_names_the_nearest(
    registry: Registry, add: Any, ask: Any, what: str, next_step: str
) -> None:
    add.run()
    add.policy("run-1")
    with pytest.raises(NotFoundError) as caught:
        ask(registry)
    assert caught.value.message == what
    assert next_step in caught.value.hint
    assert len(str(caught.value).splitlines()) == 2


def test_no_did_you_mean_for_another_task(registry: Registry, add: Any) -> None:
    add.run()
    add.policy("run-1", task="GapBall")
    with pytest.raises(NotFoundError) as caught:
        registry.policy("DoorBall")
    assert caught.value.hint == "run: paddlectl train DoorBall"


def test_a_missing_registry_isnt_made_by_looking(location: Path) -> None:
    with pytest.raises(NotFoundError, match="no registry at") as caught:
        Registry.open(location, create=False)
    assert caught.value.hint == "run: paddlectl train BoxDoor"
    assert not location.exists()


def test_locations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    strange = tmp_path / "a b%20?mode=memory#é"
    assert Registry.open(strange).location == str(strange)
    assert (strange / "registry.db").stat().st_size > 0
    assert Registry.open("sqlite:///here").location == "here"
    assert Registry.open(tmp_path / "here", create=False).runs() == []
    for wrong in ("", "postgresql://user:secret@host/db", "a\0b"):
        with pytest.raises(UsageError) as caught:
            Registry.open(wrong)
        assert "secret" not in str(caught.value)


def test_no_file_stays_open(registry: Registry, add: Any) -> None:
    add.run()
    with registry:
        registry.runs()
        with pytest.raises(NotFoundError):
            registry.run("run-5")
        held = [str(entry.readlink()) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()]
    assert not [path for path in held if path.startswith(registry.location)]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_numbers_that_arent_finite_are_refused_and_nothing_changes(
    registry: Registry, add: Any, value: float
) -> None:
    run = add.run()
    registry.files.append_rows("run-1", "episodes", [{"score": 1.0}])
    for refused in (
        lambda: add.run(settings={"rate": [value]}),
        lambda: registry.finish_run("run-1", results={"mean_score": value}, **END),
        lambda: registry.finish_run("run-1", results={}, **END | {"seconds": value}),
        lambda: add.policy("run-1", mean_score=value),
        lambda: add.policy("run-1", metadata={"x": value}),
        lambda: registry.files.append_rows("run-1", "episodes", [{"score": 2.0}, {"score": value}]),
        lambda: registry.files.write_document("run-1", "mapping", {"x": value}),
    ):
        with pytest.raises(PaddlectlError, match="can't be stored"):
            refused()
    assert registry.runs() == [run]
    assert registry.policies() == []
    assert registry.files.read_rows("run-1", "episodes") == [{"score": 1.0}]
    assert registry.files.read_document("run-1", "mapping") is None


def test_a_seed_that_no_column_holds(registry: Registry, add: Any) -> None:
    assert add.run(seed=2**32 - 1).seed == 2**32 - 1
    with pytest.raises(UsageError, match="seed can't be"):
        add.run(seed=2**32)


def test_a_run_ends_in_a_known_state(registry: Registry, add: Any) -> None:
    add.run()
    for status in ("running", "done"):
        with pytest.raises(ValueError, match="doesn't end"):
            registry.finish_run("run-1", results={}, **END | {"status": status})


# The run's folder


def test_an_older_transfers_success_rate_is_of_its_last_episodes(registry: Registry, add: Any) -> None:
    """`success_rate` of a transfer's results was over the last 100 episodes of training once."""
    ends = {"status": "finished", "frames": 10, "episodes": 2, "seconds": 1.0}
    old, figures = add.run(kind="transfer").id, {"jump_start": 0.1, "success_rate": 0.75, "mean_length": 30.0}
    assert registry.finish_run(old, **ends, results=figures).results == {
        "jump_start": 0.1, "final_success": 0.75, "mean_length": 30.0,
    }  # fmt: skip
    assert registry.run(old).results.get("success_rate") is None
    assert add.policy(old).success_rate == registry.run(old).results["success_rate"] == 0.5
    told = {"final_success": 0.75, "success_rate": 0.5}
    assert registry.finish_run(add.run(kind="transfer").id, **ends, results=told).results == told
    assert registry.finish_run(add.run().id, **ends, results={"success_rate": 0.5}).results == {
        "success_rate": 0.5
    }


def test_rows_and_documents(registry: Registry, add: Any, location: Path) -> None:
    add.run()
    assert registry.files.read_rows("run-1", "episodes") == []
    assert registry.files.read_document("run-1", "mapping") is None
    registry.files.append_rows("run-1", "episodes", [{"order": 0}, {"order": 1}])
    registry.files.append_rows("run-1", "episodes", [])
    registry.files.append_rows("run-1", "episodes", iter([{"order": 2, "text": "a\u2028b\n"}]))
    registry.files.write_document("run-1", "mapping", {"target": "A"})
    registry.files.write_document("run-1", "mapping", {"target": "B"})
    assert registry.files.read_rows("run-1", "episodes")[1:] == [
        {"order": 1},
        {"order": 2, "text": "a\u2028b\n"},
    ]
    assert registry.files.read_document("run-1", "mapping") == {"target": "B"}
    assert {p.name for p in (location / "runs/run-1").iterdir()} == {"episodes.jsonl", "mapping.json"}


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(document=JSON, row=st.dictionaries(st.text(), JSON, max_size=4))
def test_json_comes_back_as_it_was(registry: Registry, add: Any, document: Any, row: dict[str, Any]) -> None:
    run = add.run(settings=row).id
    registry.files.append_rows(run, "rows", [row, row])
    registry.files.write_document(run, "document", document)
    assert registry.files.read_rows(run, "rows") == [row, row]
    assert registry.files.read_document(run, "document") == document
    assert registry.run(run).settings == row


@pytest.mark.parametrize("name", ["", "..", "../x", "a/b", "A", "a.b", "a\0", "a\n", "x" * 65])
def test_no_name_leaves_the_folder(registry: Registry, add: Any, location: Path, name: str) -> None:
    add.run()
    for use in (
        lambda: registry.files.append_rows("run-1", name, [{}]),
        lambda: registry.files.read_rows("run-1", name),
        lambda: registry.files.write_document("run-1", name, {}),
        lambda: registry.files.read_document("run-1", name),
    ):
        with pytest.raises(ValueError, match="not a name"):
            use()
    assert list((location / "runs/run-1").iterdir()) == []


def test_a_row_torn_at_any_byte_is_dropped_and_then_cut_off(
    registry: Registry, add: Any, location: Path
) -> None:
    add.run()
    path = location / "runs/run-1/episodes.jsonl"
    torn = json.dumps({"order": 1, "long": "x" * 70_000})
    for length in (1, 5, len(torn) // 2, len(torn)):
        path.write_text('{"order": 0}\n' + torn[:length])
        assert registry.files.read_rows("run-1", "episodes") == [{"order": 0}]
        registry.files.append_rows("run-1", "episodes", [{"order": 2}])
        assert path.read_text() == '{"order": 0}\n{"order": 2}\n'


def test_a_damaged_line_is_told_with_its_place(registry: Registry, add: Any, location: Path) -> None:
    add.run()
    path = location / "runs/run-1/episodes.jsonl"
    for damage in (b"{\n", b"[1]\n", b"\xff\n", b'{"a": NaN}\n', b"[" * 100_000 + b"\n", b"9" * 5000 + b"\n"):
        path.write_bytes(b'{"order": 0}\n' + damage)
        with pytest.raises(IntegrityError, match=r"episodes\.jsonl:2 is damaged"):
            registry.files.read_rows("run-1", "episodes")


def test_a_run_doesnt_write_into_a_folder_that_is_there(registry: Registry, add: Any, location: Path) -> None:
    foreign = location / "runs/run-1"
    foreign.mkdir(parents=True)
    (foreign / "episodes.jsonl").write_text("{}\n")
    with pytest.raises(IntegrityError, match="older copy"):
        add.run()
    assert registry.runs() == []
    assert (foreign / "episodes.jsonl").read_text() == "{}\n"


def test_reading_loads_neither_alembic_nor_torch_nor_numpy(registry: Registry, add: Any) -> None:
    add.run()
    add.policy("run-1")
    code = (
        "import sys; from paddlectl.registry.store import Registry\n"
        f"r = Registry.open({registry.location!r}, create=False)\n"
        "r.runs(), r.policies(), r.run('run-1'), r.read_checkpoint(r.policy('BoxDoor'))\n"
        "r.files.read_rows('run-1', 'episodes')\n"
        "print([m for m in ('alembic', 'torch', 'numpy', 'sqlalchemy.orm') if m in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=_with_source())
    assert told.stdout == "[]\n", told.stderr


def _with_source() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
