"""Any Gymnasium environment as a task: stepped as it is, told in atoms, found again where it was."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from contract import few
from paddlectl.errors import PaddlectlError
from paddlectl.experiments.checkpointer import Checkpointer
from paddlectl.experiments.jobs import TrainJob
from paddlectl.experiments.resuming import resume
from paddlectl.experiments.runner import INEXACT, train_source
from paddlectl.hybrid.rollout import Outcome
from paddlectl.methods.base import Setup, method_of
from paddlectl.registry.store import Registry
from paddlectl.tasks import suite
from paddlectl.tasks.gymnasium import GymnasiumTask, Subgoal
from paddlectl.tasks.lanes import GymnasiumEnvironment
from paddlectl.tasks.split import belongs
from scripted import learning
from trials.runs import StopAfter, ended, quiet, small

LANES = 6
FILE = Path("lake.py")
SMALL = {"num_envs": 4, "rollout_steps": 16}


def at(env: Any) -> Any:
    return np.eye(16)[env.s]


LAKE = GymnasiumTask(
    env="FrozenLake-v1",
    domain="lake",
    horizon=20,
    predicates={"is_low(agent)": lambda env: env.s >= 8, "is_home(agent)": lambda env: env.s == 0},
    subgoals={
        "gt_low()": Subgoal(lambda env: env.s >= 8, at, distance=lambda env: 2 - env.s // 4),
        "gt_goal()": Subgoal(lambda env: env.s == 15, at, available=lambda env: env.s >= 8),
    },
    success=lambda env: env.s == 15,
    flat=at,
    milestones=("gt_low()",),
    exclusions=(("is_low(agent)", "is_home(agent)"),),
)
PENDULUM = GymnasiumTask(
    env="Pendulum-v1",
    domain="pendulum",
    horizon=30,
    predicates={"is_up(pole)": lambda env: bool(np.cos(env.state[0]) > 0)},
    subgoals={"gt_up()": Subgoal(lambda env: bool(np.cos(env.state[0]) > 0), lambda env: env.state)},
    success=lambda env: bool(np.cos(env.state[0]) > 0.99),
    flat=lambda env: env.state,
    continuous=True,
)
TASKS = {"Lake": LAKE, "Pendulum": PENDULUM}


@pytest.fixture
def added() -> Iterator[None]:
    suite.PLUGINS.add(FILE, TASKS | {"Restless": RESTLESS})
    yield
    suite.PLUGINS._of_files.clear()


class Restless(gymnasium.Env[Any, Any]):
    """A number that nobody can foretell."""

    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0, 1, (1,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.value = 0
        return np.array([0.0]), {}

    def step(self, action: Any) -> Any:
        self.value = int.from_bytes(os.urandom(6), "big")
        return np.array([self.value / 2**48]), 0.0, False, False, {}


gymnasium.register("Restless-v0", Restless)
RESTLESS = GymnasiumTask(
    env="Restless-v0",
    domain="restless",
    horizon=1000,
    predicates={"is_odd(number)": lambda env: env.value % 2 == 1},
    subgoals={"gt_odd()": Subgoal(lambda env: env.value % 2 == 1, lambda env: [env.value / 2**48])},
    success=lambda env: False,
    flat=lambda env: [env.value / 2**48],
)


def environment(task: GymnasiumTask, **given: Any) -> GymnasiumEnvironment:
    return GymnasiumEnvironment(task, "It", **({"num_envs": LANES, "seed": 3} | given))


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_it_steps_as_the_environment_alone_does(task: GymnasiumTask) -> None:
    batch, rng = environment(task), np.random.default_rng(0)
    alone = [gymnasium.make(task.env, max_episode_steps=task.horizon) for _ in range(LANES)]
    begins, over, died = np.ones(LANES, np.bool_), 0, 0
    for _ in range(3 * task.horizon):
        for lane in np.flatnonzero(begins):
            alone[lane].reset(seed=int(batch.seeds[lane]))
        actions = batch.actions.sample(rng, LANES)
        step = batch.step(actions)
        for lane, env in enumerate(alone):
            _, _, terminated, truncated, _ = env.step(2 * actions[lane] if task.continuous else actions[lane])
            solved = task.success(env.unwrapped)
            flat = np.asarray(task.flat(env.unwrapped))
            assert batch.flat_state()[lane, : len(flat)] == pytest.approx(flat, abs=1e-4)
            assert (step.score[lane] > 0) == solved
            assert step.terminated[lane] == (terminated or solved)
            assert step.truncated[lane] == (truncated and not (terminated or solved))
            died += terminated and not solved
        begins = step.terminated | step.truncated
        over += begins.sum()
        batch.reset(begins)
    assert over > LANES and (died > 0 or task.continuous)


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_an_episode_begins_again_by_its_start(task: GymnasiumTask) -> None:
    batch, again, rng = environment(task), environment(task, num_envs=2), np.random.default_rng(0)
    batch.reset(np.arange(LANES) == 3)
    again.step(again.actions.sample(rng, 2))
    again.begin(batch.start(3))
    assert again.t.tolist() == [0, 0] and again.start(1) == batch.start(3)
    for _ in range(task.horizon):
        actions = batch.actions.sample(rng, LANES)
        step, other = batch.step(actions), again.step(actions[[3, 3]])
        assert [each[1] for each in other] == [each[3] for each in step]
        assert (again.flat_state()[1] == batch.flat_state()[3]).all()
    for wrong in ({"seed": -1}, {"seed": 2**31}, {"seed": 0.5}, {"seed": True}, {}):
        with pytest.raises((KeyError, ValueError)):
            again.begin(wrong)


def test_what_it_pays_and_shows() -> None:
    frozen = replace(LAKE, options={"is_slippery": False}, own_reward=10.0)
    batch, way = environment(frozen, num_envs=2), [1, 1, 2, 2, 1, 2]
    assert batch.valuation().tolist() == [[False, True]] * 2
    both = np.array([0, 1])
    assert batch.available(both).tolist() == [True, False]
    assert batch.distance(both).tolist() == [2, 0]
    assert batch.observe(both)[:, -2:].tolist() == [[1, 0], [0, 1]]
    paid = [batch.step(np.array([action, 0])) for action in way]
    rewards, scores = (np.array(each)[:, 0] for each in list(zip(*paid, strict=True))[:2])
    solved = 1 - 0.9 * len(way) / LAKE.horizon
    assert scores == pytest.approx([0, 0, 0, 0, 0, solved])
    assert rewards == pytest.approx([0, 0.1, 0, 0, 0, solved + 10])
    assert paid[-1].terminated.tolist() == [True, False]
    before = batch.flat_state()[0]
    after = batch.step(np.array([0, 0]))
    assert (batch.flat_state()[0] == before).all() and batch.t.tolist() == [6, 7]
    assert not (after.terminated | after.truncated)[0] and after.reward[0] == 0
    batch.reset(np.array([True, False]))
    assert batch.t.tolist() == [0, 7] and batch.valuation()[0].tolist() == [False, True]


def test_to_fall_through_the_ice_ends_a_decision_for_good_and_solves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task = replace(LAKE, milestones=())("Lake")
    method = method_of("hdm")
    made = learning(method, Setup(task, few(method.settings_for(task, None)), 0, 10**6))
    told: list[Outcome] = []
    monkeypatch.setattr(made.agent.credit, "on_decision_end", told.append)
    for _ in range(40):
        next(made)
    terminated, solved, rewards = (
        np.concatenate([getattr(each, name) for each in told]) for name in ("terminated", "solved", "rewards")
    )
    assert (terminated & ~solved).any()
    np.testing.assert_array_equal(solved, rewards > 0)


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_an_action_that_lasts_is_the_same_action_several_times(task: GymnasiumTask) -> None:
    lasting, single = environment(task, action_repeat=3), environment(task)
    rng = np.random.default_rng(1)
    for _ in range(20):
        actions = lasting.actions.sample(rng, LANES)
        whole, parts = lasting.step(actions), [single.step(actions) for _ in range(3)]
        for told, each in zip(whole, zip(*parts, strict=True), strict=True):
            np.testing.assert_allclose(told, np.sum(each, axis=0), rtol=1e-6)
        np.testing.assert_array_equal(lasting.flat_state(), single.flat_state())
        done = whole.terminated | whole.truncated
        lasting.reset(done)
        single.reset(done)


def test_an_eighth_of_all_seeds_is_for_evaluation_alone() -> None:
    drawn = {}
    for split in ("training", "evaluation"):
        batch, drawn[split] = environment(LAKE, split=split), []
        for _ in range(20):
            batch.reset()
            drawn[split] += batch.seeds.tolist()
        assert belongs(np.array(drawn[split])[:, None], split).all()
    assert not set(drawn["training"]) & set(drawn["evaluation"])


@pytest.mark.parametrize("name", TASKS)
def test_a_stopped_run_ends_as_if_it_had_never_been_stopped(added: None, tmp_path: Path, name: str) -> None:
    registry = Registry.open(tmp_path / "registry")
    job = TrainJob(name, 0, 320, SMALL)
    told: list[str] = []
    with small():
        with pytest.raises(KeyboardInterrupt):
            train_source(job, registry, quiet, Checkpointer(0.0, StopAfter(3)))
        resume("run-1", registry, quiet, Checkpointer(tell=told.append))
        row = train_source(job, registry, quiet)
    assert ended(registry, "run-1") == ended(registry, row["run"])
    assert told == []


def test_what_cant_be_found_again_is_said_at_the_start_and_begun_anew(added: None, tmp_path: Path) -> None:
    registry, told = Registry.open(tmp_path / "registry"), list[str]()
    batch = environment(RESTLESS)
    for _ in range(5):
        batch.step(np.zeros(LANES, np.intp))
    kept = batch.snapshot()
    other = environment(RESTLESS)
    other.restore(kept)
    assert other.t.tolist() == [5] * LANES and not other.flat_state()[:, 0].any() and not other.exact
    with small():
        with pytest.raises(KeyboardInterrupt):
            train_source(
                TrainJob("Restless", 0, 320, SMALL),
                registry,
                quiet,
                Checkpointer(0.0, StopAfter(3), tell=told.append),
            )
        assert told == [f"Restless: {INEXACT}"]
        assert resume("run-1", registry, quiet, Checkpointer(tell=told.append))["frames"] == 320
    assert told == [f"Restless: {INEXACT}"] * 2


def fails(env: Any) -> Any:
    return env.nothing


def lowest(env: Any) -> Any:
    return np.array([np.nan] * 16)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"env": "Nowhere-v0"}, "its environment of task It (Nowhere-v0) fails: NameNotFound"),
        ({"env": "Pendulum-v1"}, "actions of Pendulum-v1 are Box"),
        ({"success": fails}, "success of task It (FrozenLake-v1) fails: AttributeError: "),
        ({"success": lambda env: env.s}, "success of task It (FrozenLake-v1) fails: TypeError: it gives int"),
        ({"predicates": {"is_low(agent)": fails}}, "is_low(agent) of task It (FrozenLake-v1) fails"),
        ({"flat": lambda env: env.s}, "flat of task It (FrozenLake-v1) fails: ValueError: it gives numbers"),
        ({"subgoals": {"gt_low()": Subgoal(fails, at)}}, "reached of task It (FrozenLake-v1) fails"),
        ({"subgoals": {"gt_low()": Subgoal(LAKE.success, fails)}}, "sees of gt_low() of task It"),
        (
            {"subgoals": {**LAKE.subgoals, "gt_x()": Subgoal(LAKE.success, lambda env: [env.s])}},
            "it gives 1 numbers, another subgoal 16",
        ),
        ({"subgoals": {"gt_low()": Subgoal(LAKE.success, lowest)}}, "gives a number that isn't finite"),
        (
            {"exclusions": (("is_low(agent)",), ("is_home(agent)",))},
            "is_home(agent) hold together in It",
        ),
    ],
)
def test_what_is_wrong_with_a_task_is_told_in_a_line(changes: dict[str, Any], told: str) -> None:
    changed = {"milestones": (), "exclusions": (), **changes}
    with pytest.raises(PaddlectlError) as caught:
        batch = environment(replace(LAKE, **changed))
        batch.step(np.zeros(LANES, np.intp))
        batch.observe(np.zeros(LANES, np.intp))
        batch.reached(np.zeros(LANES, np.intp))
    assert told in caught.value.message and "\n" not in caught.value.message and caught.value.hint
    if fails in changes.values():
        assert "(test_gymnasium_tasks.py, line " in caught.value.message


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"milestones": ("gt_high()",)}, "milestone gt_high() is none of its subgoals"),
        ({"exclusions": (("nope()",),)}, "exclusion nope() is none of its predicates"),
        ({"domain_subgoals": ("gt_low()",)}, "gt_goal() is none of its domain_subgoals"),
        ({"horizon": 0}, "horizon must be a whole number in 1..1,000,000, not 0"),
        ({"predicates": {"low": LAKE.success}}, "expected"),
        ({"predicates": {"!is_low(agent)": LAKE.success}}, "an atom is written like is_low(agent)"),
        ({"predicates": {f"is_{n}(x)".replace("_", "_n"): LAKE.success for n in range(17)}}, "17 predicates"),
    ],
)
def test_what_cant_be_a_task_is_told_when_it_is_asked_for(changes: dict[str, Any], told: str) -> None:
    suite.PLUGINS.add(FILE, {"Wrong": replace(LAKE, **changes)})
    try:
        with pytest.raises(PaddlectlError) as caught:
            suite.load("Wrong")
    finally:
        suite.PLUGINS._of_files.clear()
    assert caught.value.message.startswith("task Wrong of lake.py can't be used: ")
    assert told in caught.value.message and caught.value.hint == "mend lake.py"
