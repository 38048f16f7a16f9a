"""One definition of what a field may hold: what a command takes is stored, exported and taken in again."""

import dataclasses
import json
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from filler import ARRAYS, Filler
from paddlectl.cli.completion import stopped_names, transfer_names
from paddlectl.errors import IntegrityError, UsageError
from paddlectl.experiments.jobs import TransferJob
from paddlectl.experiments.resuming import job_of
from paddlectl.hybrid.settings import settings_for
from paddlectl.methods.catalogue import METHODS
from paddlectl.registry import fields
from paddlectl.registry.bundles import bundles
from paddlectl.registry.care.check import check
from paddlectl.registry.store import Registry
from paddlectl.scenario import Scenario, load_scenario
from paddlectl.tasks.suite import load, names
from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.whole import seeds as parse_seeds
from samples import SCENARIO
from soak import memory_folder

TARGET = "BlockedBoxUnlockPickup"
ANY_NAME = st.text(max_size=90) | st.from_regex(r"[A-Za-z0-9][A-Za-z0-9 _.,+-]{0,90}\n?", fullmatch=True)
NAME = st.from_regex(fields.SCENARIO, fullmatch=True)
COUNT = st.sampled_from([0, 1, 10**12, 2**63 - 1]) | st.integers(0, 2**63 - 1)
FLOAT = st.floats(allow_nan=False, allow_infinity=False)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | FLOAT | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
DOCUMENT = st.dictionaries(st.text(max_size=20), JSON, max_size=4)
RUN = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(["train", "transfer"]),
        "method": st.sampled_from([*METHODS, "random"]) | st.from_regex(fields.METHOD, fullmatch=True),
        "task": st.sampled_from(names()) | st.from_regex(fields.TASK, fullmatch=True),
        "scenario": st.none() | NAME,
        "sources": st.lists(st.from_regex(fields.POLICY_ID, fullmatch=True), max_size=5),
        "seed": st.sampled_from([0, 2**32 - 1]) | st.integers(0, 2**32 - 1),
        "settings": DOCUMENT,
        "versions": DOCUMENT,
    }
)
END = st.fixed_dictionaries(
    {
        "status": st.sampled_from(["finished", "failed", "interrupted"]),
        "frames": COUNT,
        "episodes": COUNT,
        "seconds": st.floats(0.0, allow_infinity=False) | st.just(-0.0),
        "results": st.dictionaries(
            st.from_regex(fields.FIGURE, fullmatch=True).filter(lambda name: name not in fields.FIGURES),
            st.none() | st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**9), 10**9),
            max_size=4,
        ),
    }
)
POLICY = st.fixed_dictionaries(
    {
        "task": st.sampled_from(names()) | st.from_regex(fields.TASK, fullmatch=True),
        "domain": st.from_regex(fields.TASK, fullmatch=True),
        "success_rate": st.floats(0.0, 1.0),
        "crispness": st.floats(0.0, 1.0) | st.just(-0.0),
        "mean_score": FLOAT,
        "mean_length": FLOAT,
        "metadata": DOCUMENT,
    }
)


def scenario(name: str) -> Scenario:
    told = {"name": name, "target": TARGET, "sources": ["BlockedDoor"]}
    return Scenario.model_validate_json(json.dumps(told))


@settings(max_examples=300, deadline=None)
@given(name=ANY_NAME)
def test_a_scenario_may_be_called_what_the_registry_can_store(name: str) -> None:
    try:
        taken = scenario(name).name == name
    except (ValidationError, UnicodeEncodeError):
        taken = False
    assert taken == (fields.misfit({"scenario": name}, fields.RUN) is None)


@settings(max_examples=20, deadline=None)
@given(run=RUN, end=END, policy=st.none() | POLICY, row=DOCUMENT)
def test_whatever_is_stored_can_be_exported_and_taken_in_again(
    new: Path, run: dict[str, Any], end: dict[str, Any], policy: dict[str, Any] | None, row: dict[str, Any]
) -> None:
    with tempfile.TemporaryDirectory(dir=memory_folder()) as folder:
        here, there, bundle = Path(folder, "here"), Path(folder, "there"), Path(folder, "x.zip")
        registry = Registry.open(here)
        add = Filler(registry)
        add.run(**run)
        registry.files.append_rows("run-1", "episodes", [row])
        registry.files.write_document("run-1", "mapping", row)
        if policy is not None:
            add.policy("run-1", checkpoint=ARRAYS, method=run["method"], **policy)
        registry.finish_run("run-1", **end)
        bundles.export(registry, "run-1", bundle)
        told = bundles.import_(lambda: Registry.open(there), bundle)
        other = Registry.open(there)
        one, two = registry.run("run-1"), other.run(told["run"])
        assert dataclasses.replace(two, sources=one.sources) == one
        assert (told["policy"] is None) == (policy is None)
        if policy is not None:
            assert other.policy("policy-1") == registry.policy("policy-1")
        bundles.export(other, "run-1", Path(folder, "again.zip"))
        assert Path(folder, "again.zip").read_bytes() == bundle.read_bytes()
        assert not {f.kind for f in check(there, read_data=True).faults} - {"missing source"}
        explained = [name for name, _ in transfer_names(str(there))]
        assert explained == (["latest", "run-1"] if one.kind == "transfer" else [])
        goes_on = one.status != "finished" and one.method != "random" and not one.sources
        assert [name for name, _ in stopped_names(str(there))] == ["run-1"] * goes_on


@pytest.mark.parametrize("name", ["A, with GapBall, v2", "x" * 70, "x" * 80, "1", "a ", "A+B, C_d.e-f"])
def test_a_transfer_goes_the_whole_way_under_any_name(registry: Registry, tmp_path: Path, name: str) -> None:
    (tmp_path / "x.yaml").write_text(SCENARIO.replace("name: A", f"name: {json.dumps(name)}"))
    read = load_scenario(tmp_path / "x.yaml")
    learning = dataclasses.asdict(settings_for(load(TARGET)))
    job = TransferJob(read, ("policy-1",), "paddle", 2**32 - 1, 10**12, GuidanceSettings(), learning)
    told = {"scenario": read.model_dump(), "rules": dataclasses.asdict(GuidanceSettings())}
    add = Filler(registry)
    given_ = {"kind": "transfer", "method": "paddle", "task": TARGET, "scenario": read.name, "seed": job.seed}
    run = add.run(
        **given_, sources=["policy-1"], settings={**told, "frames": job.frames, "learning": learning}
    )
    registry.finish_run(run.id, status="interrupted", frames=0, episodes=0, seconds=0.0, results={})
    assert job_of(registry.run(run.id)) == job
    bundles.export(registry, run.id, tmp_path / "x.zip")
    bundles.import_(lambda: Registry.open(tmp_path / "other"), tmp_path / "x.zip")
    taken = Registry.open(tmp_path / "other").run("run-1")
    assert (taken.scenario, job_of(taken).seed) == (name, job.seed)


@pytest.mark.parametrize("wrong", [{"frames": "x"}, {"frames": 0}, {"preset": ["a"]}, {"preset": "none"}])
def test_settings_that_no_command_wrote_arent_resumed(add: Any, wrong: dict[str, Any]) -> None:
    learning = dataclasses.asdict(settings_for(load("BoxDoor")))
    run = add.run(settings={"frames": 1000, "preset": None, "learning": learning})
    assert job_of(run).frames == 1000
    with pytest.raises(IntegrityError, match="aren't what this version writes"):
        job_of(dataclasses.replace(run, settings=run.settings | wrong))


def test_names_and_limits_of_the_commands_fit() -> None:
    for task in map(load, names()):
        assert re.fullmatch(fields.TASK, task.name) and re.fullmatch(fields.TASK, task.domain)
    assert all(re.fullmatch(fields.METHOD, method) for method in METHODS)
    assert parse_seeds(f"{fields.SEEDS - 1}") == (fields.SEEDS - 1,)
    with pytest.raises(UsageError):
        parse_seeds(f"{fields.SEEDS}")


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1}, {"seed": 2**32}, {"scenario": "x" * 81}, {"scenario": "é"}, {"scenario": ""},
        {"task": "../x"}, {"method": "HDM"}, {"kind": "x"}, {"sources": ["BoxDoor"]},
        {"sources": ["policy-1"] * 101},
    ],
)  # fmt: skip
def test_what_no_bundle_could_hold_isnt_stored(registry: Registry, add: Any, wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(wrong))} can't be"):
        add.run(**wrong)
    assert registry.runs() == []


@pytest.mark.parametrize(
    "wrong", [{"success_rate": 1.5}, {"crispness": -0.1}, {"frames": -1}, {"domain": ""}]
)
def test_what_no_bundle_could_hold_of_a_policy(registry: Registry, add: Any, wrong: dict[str, Any]) -> None:
    add.run()
    with pytest.raises(UsageError, match=f"the policy can't be stored: {next(iter(wrong))} can't be"):
        add.policy("run-1", **wrong)
    assert registry.policies() == []
    for end in ({"frames": -1}, {"episodes": 2**63}, {"seconds": -0.5}):
        whole = {"status": "failed", "frames": 0, "episodes": 0, "seconds": 0.0, "results": {}}
        with pytest.raises(UsageError, match="can't be stored"):
            registry.finish_run("run-1", **whole | end)


def test_nothing_is_exported_that_import_would_refuse(registry: Registry, add: Any, tmp_path: Path) -> None:
    for given_ in ({"checkpoint": b"no tensors"}, {"checkpoint": ARRAYS, "metadata": {"x": "y" * 1_100_000}}):
        run = add.run().id
        add.policy(run, **given_)
        registry.finish_run(run, status="finished", frames=0, episodes=0, seconds=0.0, results={})
        with pytest.raises(IntegrityError, match=f"{run} can't be exported"):
            bundles.export(registry, run, tmp_path / "x.zip")
    assert not (tmp_path / "x.zip").exists()
