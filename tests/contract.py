"""What every method promises to whoever runs it: checks by its name and a kind of actions that it chooses.

They are for the method of a plug-in as well.
"""

import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields, is_dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch

from paddlectl.agents.base import ReuseRow
from paddlectl.agents.evaluation import evaluate
from paddlectl.agents.interaction import Learning, Round
from paddlectl.cli.train import train_jobs
from paddlectl.errors import UsageError
from paddlectl.experiments import snapshot
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.methods.base import Setup, Source, method_of
from paddlectl.methods.catalogue import entry_of, teacher_of
from paddlectl.scenario import Scenario, TaskSources
from paddlectl.tasks.suite import load
from scripted import as_source, learning

# target and sources, by kind of actions; and MiniGrid's own
TASKS = {
    "discrete": ("BlockedBoxUnlockPickup", ("BlockedDoor", "GapBall")),
    "continuous": ("CoffeeMailMaze", ("CoffeeMaze", "MailMaze")),
    "stock": ("MiniGrid-ObstructedMaze-1Dlh-v0", ("MiniGrid-UnlockPickup-v0", "MiniGrid-DoorKey-5x5-v0")),
}
ROUNDS = 4
FEW = {
    "num_envs": 2, "rollout_steps": 4, "max_steps": 2, "warm_up": 2, "update_every": 2, "refresh_every": 2,
    "batch": 2, "capacity": 64, "cloning": False, "start": 0.0,
}  # fmt: skip
"""Of whatever settings have these: a few steps, and each learner learns from them."""


def few(settings: Any) -> Any:
    """The settings with `FEW`, also in those within them."""
    values = {each.name: getattr(settings, each.name) for each in fields(settings)}
    inner = {name: few(value) for name, value in values.items() if is_dataclass(value)}
    return replace(settings, **inner, **{name: FEW[name] for name in values.keys() & FEW.keys()})


def setup(name: str, actions: str, seed: int = 0) -> Setup:
    target, given = TASKS[actions]
    task, paired = load(target), TaskSources(tasks=given, seed="paired")
    scenario = Scenario(name="A", target=target, sources=paired)
    method, teacher = method_of(name), teacher_of(name, task)
    sources = (
        [source(f"policy-{n}", name, teacher) for n, name in enumerate(given, start=1)] if teacher else []
    )
    settings = few(method.settings_for(task, scenario))
    return Setup(task, settings, seed, 10**6, sources, scenario, method.rules_for(task))


@cache
def source(identity: str, name: str, teacher: str) -> Source:
    """A policy that has learned nothing."""
    method, task = method_of(teacher), load(name)
    policy = method.policy(task, 0, method.settings_for(task, None))
    program, _ = policy.played_program(np.ones(policy.scene_count, np.intp), 1)
    return as_source(identity, policy, program)


def learned(name: str, actions: str, rounds: int, seed: int = 0) -> tuple[Learning, list[Round]]:
    made = learning(method_of(name), setup(name, actions, seed))
    return made, [next(made) for _ in range(rounds)]


class Unbroken(NamedTuple):
    """All rounds, to be looked at only; how its policy began, and what each optimiser was to change."""

    made: Learning
    rounds: list[Round]
    began: dict[str, torch.Tensor]
    optimisers: list[tuple[torch.optim.Optimizer, dict[str, torch.Tensor]]]


@cache
def unbroken(name: str, actions: str) -> Unbroken:
    given = setup(name, actions)
    made = learning(method_of(name), given)
    policy, seen = made.agent.policy(), set()
    readers = [each for each in held(made.agent, set()) if isinstance(each, ClauseLearner)]
    only_read = [each for each in readers if each is not getattr(policy, "clauses", None)]
    list(held([given.sources, only_read], seen))  # who doesn't learn
    optimisers = [each for each in held(made.agent, seen) if isinstance(each, torch.optim.Optimizer)]
    began = tensors(policy), [(each, weights(each)) for each in optimisers]
    return Unbroken(made, [next(made) for _ in range(ROUNDS)], *began)


def tensors(policy: Any) -> dict[str, torch.Tensor]:
    return {name: tensor.detach().clone() for name, tensor in policy.state().items()}


def same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def weights(optimiser: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    """What it changes."""
    found = [tensor for group in optimiser.param_groups for tensor in group["params"]]
    return {str(n): tensor.detach().clone() for n, tensor in enumerate(found)}


def held(value: Any, seen: set[int]) -> Iterator[Any]:
    """All that is held by a value, and isn't seen yet."""
    if id(value) in seen or isinstance(value, type | torch.Tensor):
        return
    seen.add(id(value))
    yield value
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    for each in (*inner, *getattr(value, "__dict__", {}).values()):
        yield from held(each, seen)


def it_acts_observes_updates_and_tells(name: str, actions: str) -> None:
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


def all_that_learns_has_learned(name: str, actions: str) -> None:
    """Each optimiser of its own has changed something, and its policy isn't what it was."""
    run = unbroken(name, actions)
    assert not any(same(before, weights(optimiser)) for optimiser, before in run.optimisers)
    assert not same(run.began, tensors(run.made.agent.policy()))


def equal_seeds_learn_equally_and_to_look_changes_nothing(name: str, actions: str) -> None:
    plain, rounds, *_ = unbroken(name, actions)
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


def what_it_learned_goes_through_its_state_and_its_settings(name: str, actions: str) -> None:
    policy = unbroken(name, actions).made.agent.policy()
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


def to_play_teaches_nothing(name: str, actions: str) -> None:
    policy = unbroken(name, actions).made.agent.policy()
    before = tensors(policy)
    found = evaluate(policy, load(TASKS[actions][1][0]), 2, 0)  # on another task of its domain
    assert same(tensors(policy), before)
    assert (found.program is None) == (found.crispness is None) == (policy.scene_count == 0)


def all_that_changes_is_captured_between_two_rounds(name: str, actions: str) -> None:
    stopped, _ = learned(name, actions, ROUNDS - 1)
    tree, arrays = snapshot.capture({"learning": stopped})
    fresh = learning(method_of(name), setup(name, actions))
    snapshot.restore({"learning": fresh}, json.loads(json.dumps(tree)), arrays)
    next(fresh)
    whole = unbroken(name, actions).made
    assert same(tensors(fresh.agent.policy()), tensors(whole.agent.policy()))
    assert fresh.frames == whole.frames


def its_presets_are_those_that_are_told(name: str, actions: str) -> None:
    """Without them, `train --preset` and `tasks` tell what isn't there."""
    task = load(TASKS[actions][0])
    presets = method_of(name).presets(task)
    assert (*presets,) == entry_of(name).presets.get(task.domain, ())
    assert all(type(other) is type(setup(name, actions).settings) for other in presets.values())


def its_budget_is_among_its_settings(name: str, actions: str) -> None:
    given = setup(name, actions)
    for settings in (given.settings, *method_of(name).presets(given.task).values()):
        assert settings.frames == math.floor(settings.frames) > 0


def without_sources_it_begins_or_tells_how_to(name: str, actions: str) -> None:
    given = setup(name, actions)._replace(sources=())
    try:
        method_of(name).make(given)
    except UsageError as error:
        assert error.message.startswith(f"{name} ") and "\n" not in error.message
        command = re.fullmatch(r"learn it alone: paddlectl train (\S+) --method (\S+)", error.hint)
        assert command
        assert train_jobs([command[1]], [0], method=command[2])


CHECKS: tuple[Callable[[str, str], None], ...] = (
    it_acts_observes_updates_and_tells,
    all_that_learns_has_learned,
    equal_seeds_learn_equally_and_to_look_changes_nothing,
    what_it_learned_goes_through_its_state_and_its_settings,
    to_play_teaches_nothing,
    all_that_changes_is_captured_between_two_rounds,
    its_presets_are_those_that_are_told,
    its_budget_is_among_its_settings,
    without_sources_it_begins_or_tells_how_to,
)
