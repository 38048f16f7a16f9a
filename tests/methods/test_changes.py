"""A user's own numbers: which can be set, what they may be, and that they are what a run learns by."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import make_dataclass, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given
from hypothesis import settings as of_test
from hypothesis import strategies as st

from contract import TASKS
from paddlectl.agents.settings import changed, leaves, restored, with_defaults
from paddlectl.errors import UsageError
from paddlectl.experiments import policies, runner
from paddlectl.experiments.jobs import TrainJob, TransferJob
from paddlectl.experiments.policies import keep, revive
from paddlectl.experiments.resuming import job_of
from paddlectl.experiments.runner import rules_of, run_transfer, settings_of, train_source
from paddlectl.learners.dqn import DQN, DQNSettings
from paddlectl.learners.ppo import PPO, PPOSettings
from paddlectl.methods import finetune
from paddlectl.methods.base import Method, method_of
from paddlectl.methods.catalogue import entry_of, usable
from paddlectl.methods.changes import Changes, misfits, require_fit, typed, unfit
from paddlectl.ranges import Many, Range
from paddlectl.registry.store import Registry
from paddlectl.report.settings import numbers
from paddlectl.scenario import Scenario
from paddlectl.tasks.suite import load
from trials.runs import quiet

EACH = [(name, kind) for name, entry in usable().items() for kind in sorted(entry.actions)]
OTHERWISE: dict[str, Any] = {"goal_size": 2, "grid": [3, 3], "hidden": [5], "width": 6}


def scenario_for(actions: str, **more: Any) -> Scenario:
    target, sources = TASKS[actions]
    return Scenario(name="A", target=target, sources=sources, **more)


def other(value: Any, kind: Any) -> Any:
    """Another value that a setting may have."""
    if get_origin(kind) is Literal:
        return next(each for each in get_args(kind) if each != value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, tuple):
        return [5]
    limits = [each for each in getattr(kind, "__metadata__", ()) if isinstance(each, Range)]
    near = (value + 1, value - 1, value / 2, 0.5)
    return next(each for each in near if type(each) is type(value) and all(each in limit for limit in limits))


def kinds(settings: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """The type of each setting, by its name."""
    inner = {name for name, _ in leaves(settings)}
    for name, kind in get_type_hints(type(settings), include_extras=True).items():
        if name in inner:
            yield before + name, kind
        else:
            yield from kinds(getattr(settings, name), f"{before}{name}.")


def all_others(settings: Any) -> dict[str, Any]:
    types = dict(kinds(settings)) if settings else {}
    return {
        name: OTHERWISE.get(name.rpartition(".")[2], other(value, types[name]))
        for name, value in leaves(settings)
    }


def as_typed(named: Mapping[str, Any], before: str = "") -> list[str]:
    return [f"{before}{name}={json.dumps(value)}" for name, value in named.items()]


@pytest.fixture
def unlearned(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> Iterator[Registry]:
    """A registry; runs keep what they begin with."""

    def learned(registry: Any, run: Any, method: Method, setup: Any, log: Any, *_: Any) -> Any:
        return keep(registry, run, method.policy(setup.task, setup.seed, setup.settings), log)

    monkeypatch.setattr(runner, "_learned", learned)
    monkeypatch.setattr(policies, "EVALUATION_EPISODES", 1)
    monkeypatch.setattr(finetune, "TRIALS", 1)
    with Registry.open(tmp_path / "registry") as registry:
        yield registry


@pytest.mark.parametrize(("name", "actions"), EACH)
def test_every_number_can_be_set_and_is_what_a_run_stores_and_a_policy_has(
    name: str, actions: str, unlearned: Registry
) -> None:
    method, scenario = method_of(name), scenario_for(actions)
    task = load(scenario.target)
    teaches = entry_of(name).teaches
    of_transfer = scenario if teaches else None
    named = all_others(method.settings_for(task, of_transfer))
    fixed = {"frames", "learner.modules"} if teaches else set()
    wanted = {key: value for key, value in named.items() if key not in fixed}
    rules = all_others(method.rules_for(task)) if teaches else {}
    changes = typed(as_typed(wanted) + as_typed(rules, "rules."))
    require_fit(method, task, of_transfer, changes)
    for key in fixed & named.keys():
        with pytest.raises(UsageError):
            require_fit(method, task, of_transfer, typed(as_typed({key: named[key]})))
    if teaches:
        job = TransferJob(scenario, (), name, 0, 1, changes=changes.settings)
        job = replace(job, rules=changed(rules_of(job), changes.rules) if rules else None)
        row = run_transfer(job, unlearned, quiet)
    else:
        row = train_source(TrainJob(task.name, 0, changes=changes.settings, method=name), unlearned, quiet)
    run, policy = unlearned.run(row["run"]), unlearned.policy(row["policy"])
    told = {each["name"]: each["value"] for each in numbers(run)["unusual"]}
    usual = dict(leaves(method.settings_for(task, of_transfer)))
    asked = {key: value for key, value in wanted.items() if as_stored(usual[key]) != value}
    assert told == asked | {f"rules.{key}": value for key, value in rules.items()}
    revived: Any = revive(unlearned, policy).settings  # type: ignore[attr-defined]
    assert {key: as_stored(value) for key, value in leaves(revived) if key in wanted} == wanted
    again = job_of(run)
    assert settings_of(again) == revived
    assert not isinstance(again, TransferJob) or as_stored(dict(leaves(rules_of(again)))) == rules


def as_stored(value: Any) -> Any:
    return json.loads(json.dumps(value))


@pytest.mark.parametrize(("name", "actions"), EACH)
def test_what_cant_be_is_refused_for_every_number(name: str, actions: str) -> None:
    method, scenario = method_of(name), scenario_for(actions)
    task = load(scenario.target)
    for part, usual in (
        ("settings", method.settings_for(task, scenario)),
        ("rules", method.rules_for(task)),
    ):
        types = dict(kinds(usual)) if usual else {}
        for key, value in leaves(usual):
            limits = [
                each for each in getattr(types[key], "__metadata__", ()) if isinstance(each, Range | Many)
            ]
            assert isinstance(value, bool) or get_origin(types[key]) is Literal or limits, (
                f"{key} has no range"
            )
            wrong = [None, "x", {"x": 1}, [], [0], ["x"], -1, 10**13, 1.5, True, "nan"]
            for refused in [each for each in wrong if not may_be(each, value, limits)]:
                asked = nested(key, refused)
                changes = Changes(asked, {}) if part == "settings" else Changes({}, asked)
                (found,) = unfit(method, task, scenario, changes)
                assert found.place[0] == part and ".".join(found.place[1:]).startswith(key)
                assert "usually" in found.message and "\n" not in found.message


def may_be(given: Any, usual: Any, limits: list[Any]) -> bool:
    if isinstance(usual, bool | str):
        return type(given) is type(usual) and isinstance(given, bool)
    if type(given) is bool or (type(usual) is int and type(given) is float):
        return False
    return all(given in limit for limit in limits)


def nested(key: str, value: Any) -> dict[str, Any]:
    first, _, rest = key.partition(".")
    return {first: nested(rest, value) if rest else value}


NAMES = st.text("abcdefghij_", min_size=1, max_size=8)
SCALARS = st.booleans() | st.integers(-(10**9), 10**9) | st.floats(-1e9, 1e9)
VALUES = SCALARS | st.lists(SCALARS, max_size=4)
TREES = st.recursive(
    st.dictionaries(NAMES, VALUES, min_size=1, max_size=4),
    lambda inner: st.dictionaries(NAMES, VALUES | inner, min_size=1, max_size=4),
    max_leaves=8,
)


def flat(tree: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        else:
            yield before + name, value


@of_test(max_examples=50)
@given(TREES, st.booleans())
def test_what_is_typed_is_what_a_file_would_say(tree: dict[str, Any], whole: bool) -> None:
    leaf_by_leaf = [f"{name}={json.dumps(value)}" for name, value in flat(tree)]
    by_mapping = [f" {name} = {json.dumps(value)} " for name, value in tree.items()]
    found = typed(by_mapping if whole else leaf_by_leaf)
    assert found == Changes({k: v for k, v in tree.items() if k != "rules"}, tree.get("rules", {}))


@of_test(max_examples=50)
@given(
    st.lists(
        st.text(st.characters(exclude_categories=()), max_size=30) | st.from_regex(r"[a.]+=.{0,9}"),
        max_size=3,
    )
)
def test_whatever_is_typed_is_read_or_refused_in_a_line_or_two(given_: list[str]) -> None:
    try:
        changes = typed(given_)
    except UsageError as error:
        assert error.message and "\n" not in error.message + error.hint
    else:
        assert not list(misfits(PPOSettings(), changes.settings)) or changes.settings


TWICE = [("a=1", "a=2"), ("a=1", "a.b=2"), ("a.b=2", "a=1"), ("a={b: 1}", "a.b=1"), ("a.b.c=1", "a={b: 1}")]


@pytest.mark.parametrize("given_", TWICE, ids=str)
def test_a_number_is_set_once(given_: tuple[str, str]) -> None:
    with pytest.raises(UsageError, match="another value"):
        typed(given_)


@pytest.mark.parametrize("given_", ["", "=1", "a", "a=", "a= ", ".a=1", "a..b=1", "x." * 40 + "y=1"])
def test_what_is_no_name_with_a_value_is_told(given_: str) -> None:
    with pytest.raises(UsageError, match="not NAME=VALUE"):
        typed([given_])


NEAR = {
    "num_env=3": "did you mean num_envs?",
    "learning_rate=1": "did you mean clauses.learning_rate or low_level.learning_rate?",
    "low_level.learnin_rate=1": "did you mean learning_rate?",
    "low_level.num_envs=1": "did you mean num_envs?",
    "zzz=1": "there are: action_repeat, ",
}


@pytest.mark.parametrize("given_", NEAR)
def test_the_nearest_name_is_told(given_: str) -> None:
    with pytest.raises(UsageError) as told:
        require_fit(method_of("hdm"), load("GapBall"), None, typed([given_]))
    assert told.value.hint.startswith(NEAR[given_])


def test_rules_are_of_what_reuses_and_of_the_guidance_that_has_them() -> None:
    target, rules = load(TASKS["discrete"][0]), Changes({}, {"inheritance": 0})
    for name, refused in (("paddle", False), ("finetune", False), ("hdm", True), ("cup", True)):
        assert bool([*unfit(method_of(name), target, scenario_for("discrete"), rules)]) == refused
    paper = Scenario.model_validate_json(
        scenario_for("discrete").model_copy().model_dump_json().replace('"mode":"default"', '"mode":"paper"')
    )
    assert paper.guidance.mode == "paper"
    (found,) = unfit(method_of("paddle"), target, paper, rules)
    assert found.message == "rules are of guidance: default, not of paper"
    (found, *_) = unfit(method_of("hdm"), target, None, rules)
    assert "reuses nothing" in found.message


def test_a_plug_ins_numbers_that_every_run_reads_have_ranges() -> None:
    plain = make_dataclass("Plain", [("num_envs", int, 8), ("noise", float, 0.5)], frozen=True)()
    assert [why for _, why in misfits(plain, {"num_envs": 0})] == ["num_envs is from 1 to 4096, usually 8"]
    assert not list(misfits(plain, {"num_envs": 3, "noise": -1}))


def test_whole_numbers_stand_for_numbers() -> None:
    settings = changed(PPOSettings(), {"clip": 1, "hidden": [64, 64]})
    assert settings == PPOSettings(clip=1.0, hidden=(64, 64)) and type(settings.clip) is float
    assert type(restored(PPOSettings(), {"clip": 1}, "low_level").clip) is float
    assert with_defaults(settings) == PPOSettings()


def test_networks_have_the_layers_that_are_set() -> None:
    ppo = PPO(7, 3, 0, PPOSettings(hidden=(5, 4)))
    assert {tuple(t.shape) for n, t in ppo.state().items() if n.endswith("weight")} == {
        (5, 7), (4, 5), (3, 4), (1, 4),
    }  # fmt: skip
    dqn = DQN(7, 3, 0, DQNSettings(hidden=(5,)))
    assert [tuple(t.shape) for n, t in dqn.state().items() if n.endswith("weight")] == [(5, 7), (3, 5)]
