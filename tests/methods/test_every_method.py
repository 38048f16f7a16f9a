"""What every method of the catalogue promises to whoever runs it."""

import json
from dataclasses import asdict
from functools import cache

import numpy as np
import pytest
import torch

from paddlectl.agents.base import ReuseRow
from paddlectl.agents.evaluation import evaluate
from paddlectl.errors import UsageError
from paddlectl.experiments import snapshot
from paddlectl.methods import finetune
from paddlectl.methods.base import Setup, Source, method_of
from paddlectl.methods.catalogue import METHODS, entry_of, require_actions, teacher_of
from paddlectl.scenario import Scenario
from paddlectl.tasks.suite import load
from scripted import learning

# target and sources, by kind of actions
TASKS = {
    "discrete": ("BlockedBoxUnlockPickup", ("BlockedDoor", "GapBall")),
    "continuous": ("CoffeeMailMaze", ("CoffeeMaze", "MailMaze")),
}
FEW = {"num_envs": 2, "rollout_steps": 4}
EACH = pytest.mark.parametrize(
    ("name", "actions"), [(name, kind) for name in METHODS for kind in sorted(METHODS[name].actions)]
)


@pytest.fixture(autouse=True, scope="module")
def few_trials():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finetune, "TRIALS", 2)
        yield


def setup(name, actions, seed=0):
    target, given = TASKS[actions]
    task, scenario = load(target), Scenario(name="A", target=target, sources=given)
    method = method_of(name)
    teacher = teacher_of(name, task)
    sources = (
        [source(f"policy-{n}", name, teacher) for n, name in enumerate(given, start=1)] if teacher else []
    )
    return Setup(
        task,
        method.settings_for(task, scenario, FEW),
        seed,
        10**6,
        sources,
        scenario,
        method.rules_for(task),
    )


@cache
def source(identity, name, teacher):
    """A policy that has learned nothing."""
    method, task = method_of(teacher), load(name)
    policy = method.policy(task, 0, method.settings_for(task, None))
    program, _ = policy.played_program(np.ones(policy.scene_count, np.intp), 1)
    return Source(identity, policy, program)


def learned(name, actions, rounds, seed=0):
    made = learning(method_of(name), setup(name, actions, seed))
    return made, [next(made) for _ in range(rounds)]


@cache
def unbroken(name, actions):
    """Three rounds, to be looked at only."""
    return learned(name, actions, 3)


def tensors(policy):
    return {name: tensor.detach().clone() for name, tensor in policy.state().items()}


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


@EACH
def test_it_acts_observes_updates_and_tells(name, actions):
    made, rounds = learned(name, actions, 2)
    environment = made.interaction.environment
    assert [round_.frames for round_ in rounds] == [made.round * (n + 1) for n in range(2)]
    assert all(np.isfinite(list(round_.figures.values())).all() for round_ in rounds)
    given = made.agent.act(environment)
    assert given.shape == (environment.num_envs, *environment.actions.shape)
    environment.step(given)
    told = [made.agent.record(made.frames, [], 0), made.agent.close(), made.agent.documents()]
    assert all(json.dumps(value) for value in told)
    assert all(isinstance(row, ReuseRow) for row in made.agent.reuse())


@EACH
def test_equal_seeds_learn_equally_and_to_look_changes_nothing(name, actions):
    plain, rounds = unbroken(name, actions)
    torch.manual_seed(99)
    np.random.seed(99)  # neither global generator plays a part
    looked = learning(method_of(name), setup(name, actions))
    again = []
    for _ in rounds:
        again.append(next(looked))
        assert list(looked.agent.reuse()) == list(looked.agent.reuse())
        assert looked.agent.documents() == looked.agent.documents()
    assert again == rounds
    assert same(tensors(plain.agent.policy()), tensors(looked.agent.policy()))
    other, _ = learned(name, actions, 1, seed=1)
    assert not same(tensors(plain.agent.policy()), tensors(other.agent.policy()))


@EACH
def test_what_it_learned_goes_through_its_state_and_its_settings(name, actions):
    policy = unbroken(name, actions)[0].agent.policy()
    method = method_of(name)
    stored = json.loads(json.dumps(policy.settings_document()))
    settings = method.settings_from(policy.task, stored)
    assert json.loads(json.dumps(asdict(settings))) == stored
    revived = method.policy(policy.task, 1, settings)
    assert not same(tensors(revived), tensors(policy))
    revived.load(tensors(policy))
    assert same(tensors(revived), tensors(policy))
    assert revived.action_repeat == policy.action_repeat
    assert evaluate(revived, policy.task, 2, 0) == evaluate(policy, policy.task, 2, 0)


@EACH
def test_to_play_teaches_nothing(name, actions):
    policy = unbroken(name, actions)[0].agent.policy()
    before = tensors(policy)
    found = evaluate(policy, load(TASKS[actions][1][0]), 2, 0)  # on another task of its domain
    assert same(tensors(policy), before)
    assert (found.program is None) == (found.crispness is None) == (policy.scene_count == 0)


@EACH
def test_all_that_changes_is_captured_between_two_rounds(name, actions):
    stopped, _ = learned(name, actions, 2)
    tree, arrays = snapshot.capture({"learning": stopped})
    fresh = learning(method_of(name), setup(name, actions))
    snapshot.restore({"learning": fresh}, json.loads(json.dumps(tree)), arrays)
    next(fresh)
    whole, _ = unbroken(name, actions)
    assert same(tensors(fresh.agent.policy()), tensors(whole.agent.policy()))
    assert fresh.frames == whole.frames


def test_a_method_is_called_as_it_is_listed():
    assert {name: method_of(name).name for name in METHODS} == {name: name for name in METHODS}
    assert all(METHODS.keys() >= set(entry.teaches) for entry in METHODS.values())
    assert all(entry.summary and len(entry.summary) < 100 for entry in METHODS.values())


@pytest.mark.parametrize("typed, hint", [("hdmm", "hdm"), ("", ""), ("TD3", "td3")])
def test_an_unknown_method_is_told_with_those_that_there_are(typed, hint):
    with pytest.raises(UsageError) as told:
        method_of(typed)
    assert "\n" not in told.value.message
    assert told.value.hint.endswith(", ".join(METHODS))
    assert hint in told.value.hint


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("actions", TASKS)
def test_a_task_whose_actions_it_cant_choose_is_refused(name, actions):
    task = load(TASKS[actions][0])
    if actions in entry_of(name).actions:
        require_actions(name, task)
        return
    with pytest.raises(UsageError, match=f"{name} chooses .*; those of {task.name} are {actions}") as told:
        require_actions(name, task)
    assert "\n" not in told.value.message
    assert "hdm" in told.value.hint
