"""What every registered task promises to whoever learns it."""

import copy
import pickle
from functools import cache

import numpy as np
import pytest

from paddlectl.errors import NotFoundError
from paddlectl.hybrid.settings import settings_for
from paddlectl.logic.atoms import Literal
from paddlectl.logic.templates import scenes
from paddlectl.tasks import suite
from paddlectl.tasks.minigrid.layouts import SPECS, Layouts, draw_layouts
from paddlectl.tasks.stock.families import FAMILIES
from planner import World, shortest_plan
from walker import Walker

LANES = 64
LANES_OF = {"minigrid": LANES, "maze2d": 16}
"""Side by side, where layouts and plans aren't given: a step of the maze's physics takes far longer."""
OWN = [name for name in suite.names() if name not in FAMILIES]  # MiniGrid's own: test_stock.py
TASKS = pytest.mark.parametrize("name", OWN)
MINIGRID = pytest.mark.parametrize("name", SPECS)  # those that the planner can plan


@cache
def drawn(name: str) -> Layouts:
    return draw_layouts(SPECS[name], np.random.default_rng(7), 500)


@cache
def plan_of(name: str, lane: int) -> list[int]:
    return shortest_plan(SPECS[name], drawn(name), lane)


def planned(name: str, count: int) -> tuple[Layouts, list[list[int]]]:
    layouts = Layouts(*(values[:count] for values in drawn(name)))
    return layouts, [plan_of(name, lane) for lane in range(count)]


def subgoals_of(env, subgoal: int) -> np.ndarray:
    return np.full(env.num_envs, subgoal)


class AtRandom:
    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def act(self, env) -> np.ndarray:
        return env.actions.sample(self._rng, env.num_envs)


# who plays a domain such that much of it is seen
PLAYERS = {"minigrid": AtRandom, "maze2d": lambda rng: Walker(rng=rng)}


def play(name: str, seed: int = 0, steps: int = 400, lanes: int | None = None):
    """A rollout: (environment after the step, actions, step), finished lanes restarted afterwards."""
    task = suite.load(name)
    env = task.make(lanes or LANES_OF[task.domain], seed, settings_for(task).action_repeat)
    player = PLAYERS[task.domain](np.random.default_rng(seed))
    for _ in range(2 * steps // (1 + env.action_repeat)):
        actions = player.act(env)
        step = env.step(actions)
        yield env, actions, step
        env.reset(step.terminated | step.truncated)


@TASKS
def test_spaces(name):
    task = suite.load(name)
    env = task.make(5, 0)
    assert (task.name, env.num_envs) == (name, 5)
    assert set(task.subgoals) <= set(task.domain_subgoals)
    assert len(set(task.vocabulary.atoms)) == len(task.vocabulary.atoms)
    step = env.step(env.actions.sample(np.random.default_rng(0), 5))
    subgoals = subgoals_of(env, 0)
    shapes = {
        "reward": (step.reward, np.float32, (5,)),
        "score": (step.score, np.float32, (5,)),
        "terminated": (step.terminated, np.bool_, (5,)),
        "truncated": (step.truncated, np.bool_, (5,)),
        "valuation": (env.valuation(), np.bool_, (5, len(task.vocabulary.atoms))),
        "observation": (env.observe(subgoals), np.float32, (5, env.observation_size)),
        "t": (env.t, np.intp, (5,)),
        "reached": (env.reached(subgoals), np.bool_, (5,)),
        "available": (env.available(subgoals), np.bool_, (5,)),
    }
    for what, (values, dtype, shape) in shapes.items():
        assert (values.dtype, values.shape) == (dtype, shape), what


def test_one_observation_and_action_space_in_a_domain():
    spaces = {}
    for name in OWN:
        task = suite.load(name)
        env = task.make(1, 0)
        space = (env.observation_size, env.actions, task.domain_subgoals, task.learner)
        spaces.setdefault(task.domain, set()).add(space)
    assert all(len(found) == 1 for found in spaces.values())


@TASKS
def test_observations_are_finite_and_new_each_time_and_the_scenes_consistent(name):
    task = suite.load(name)
    allowed = set(scenes(task.vocabulary.atoms, task.vocabulary.exclusions))
    valuations = set()
    for i, (env, _, _) in enumerate(play(name, lanes=LANES)):
        seen = env.observe(np.arange(env.num_envs) % len(task.domain_subgoals))
        assert np.isfinite(seen).all()
        if i == 0:
            first, kept = seen, seen.copy()
        valuations |= set(map(tuple, env.valuation().tolist()))
    np.testing.assert_array_equal(first, kept)
    bodies = {frozenset(map(Literal, task.vocabulary.atoms, truth)) for truth in valuations}
    assert len(bodies) > 2
    assert bodies <= allowed


@MINIGRID
def test_every_subgoal_can_be_reached(name):
    """A subgoal counts once a step turns `available` into `reached`."""
    task = suite.load(name)
    wanted = {task.domain_subgoals.index(subgoal) for subgoal in task.subgoals}
    layouts, plans = planned(name, LANES)
    env = task.make(LANES, 0)
    env.set_layouts(layouts)
    rng = np.random.default_rng(0)
    last = max(map(len, plans))
    for t in range(last + 2000):
        actions = env.actions.sample(rng, LANES)
        for lane, plan in enumerate(plans):
            actions[lane] = plan[t] if t < len(plan) else actions[lane]
        before = {subgoal: env.available(subgoals_of(env, subgoal)) for subgoal in wanted}
        step = env.step(actions)
        wanted = {
            subgoal
            for subgoal in wanted
            if not (before[subgoal] & env.reached(subgoals_of(env, subgoal))).any()
        }
        if not wanted:
            return
        if t >= last:
            env.reset(None if t == last else step.terminated | step.truncated)
    raise AssertionError([str(task.domain_subgoals[subgoal]) for subgoal in wanted])


@TASKS
def test_time_counts_the_steps_since_the_start(name):
    lived = 0
    for env, _, step in play(name, steps=700):
        lasted = env.t - lived
        done = step.terminated | step.truncated
        assert ((lasted == env.action_repeat) | (done & (lasted > 0) & (lasted < env.action_repeat))).all()
        assert (env.t[step.truncated] == suite.load(name).horizon).all()
        lived = np.where(done, 0, env.t)


@TASKS
def test_a_subgoal_that_holds_is_not_available(name):
    subgoals = range(len(suite.load(name).domain_subgoals))
    for env, _, _ in play(name, steps=200):
        assert not any(
            (env.available(subgoals_of(env, h)) & env.reached(subgoals_of(env, h))).any() for h in subgoals
        )


@MINIGRID
def test_rewards_keep_their_bounds(name):
    task = suite.load(name)
    age, milestones = np.zeros(LANES), np.zeros(LANES)
    most = 0.1 * len(SPECS[name].milestones)
    for _, _, step in play(name, steps=700):
        age += 1
        milestones += step.reward - step.score
        assert not (step.terminated & step.truncated).any()
        np.testing.assert_array_equal(step.score > 0, step.terminated)
        np.testing.assert_allclose(step.score, step.terminated * (1 - 0.9 * age / task.horizon), rtol=1e-5)
        np.testing.assert_array_equal(step.truncated, (age == task.horizon) & ~step.terminated)
        assert (step.reward - step.score >= -1e-6).all()
        assert (milestones <= most + 1e-5).all()
        done = step.terminated | step.truncated
        age[done], milestones[done] = 0, 0


@MINIGRID
def test_a_finished_lane_rests(name):
    layouts, plans = planned(name, LANES)
    env = suite.load(name).make(LANES, 0)
    env.set_layouts(layouts)
    subgoals = np.arange(LANES) % len(suite.load(name).domain_subgoals)
    finished, seen = np.zeros(LANES, dtype=bool), None
    for t in range(max(map(len, plans)) + 5):
        step = env.step(np.array([plan[t] if t < len(plan) else t % 7 for plan in plans]))
        assert not (finished & (step.terminated | step.truncated | (step.reward != 0))).any()
        now = np.concatenate([env.observe(subgoals), env.valuation()], axis=1)
        if seen is not None:
            np.testing.assert_array_equal(now[finished], seen[finished])
        finished |= step.terminated | step.truncated
        seen = now
    assert finished.all()


@TASKS
def test_an_action_that_lasts_is_the_same_action_several_times(name):
    task, rng = suite.load(name), np.random.default_rng(0)
    lanes = LANES_OF[task.domain]
    lasting, single = task.make(lanes, 0, action_repeat=4), task.make(lanes, 0)
    assert (lasting.action_repeat, single.action_repeat) == (4, 1)
    ended = False
    for _ in range(task.horizon // 4 + 20):
        actions = lasting.actions.sample(rng, lanes)
        whole, parts = lasting.step(actions), [single.step(actions) for _ in range(4)]
        for told, each in zip(whole, zip(*parts, strict=True), strict=True):
            np.testing.assert_allclose(told, np.sum(each, axis=0), rtol=1e-6)
        np.testing.assert_array_equal(lasting.t, single.t)
        np.testing.assert_array_equal(lasting.valuation(), single.valuation())
        done = whole.terminated | whole.truncated
        ended |= bool(done.any())
        lasting.reset(done)
        single.reset(done)
    assert ended


@TASKS
def test_equal_seeds_give_equal_trajectories(name):
    def trace(seed: int, actions_seed: int) -> bytes:
        task = suite.load(name)
        env = task.make(LANES_OF[task.domain], seed, settings_for(task).action_repeat)
        rng = np.random.default_rng(actions_seed)
        trace = []
        for _ in range(660 // (1 + env.action_repeat)):
            step = env.step(env.actions.sample(rng, env.num_envs))
            env.reset(step.terminated | step.truncated)
            trace += [
                step.reward.tobytes(),
                env.observe(subgoals_of(env, 0)).tobytes(),
                env.valuation().tobytes(),
            ]
        return b"".join(trace)

    assert trace(3, 0) == trace(3, 0)
    assert trace(3, 0) != trace(4, 0)


@TASKS
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_as_the_original_does(name, copied):
    rng, one = np.random.default_rng(0), suite.load(name).make(3, 0)

    def seen(env, actions: np.ndarray) -> list[np.ndarray]:
        step = env.step(actions)
        env.reset(np.array([True, False, False]))
        return [*step, env.observe(np.zeros(3, np.intp)), env.valuation(), env.t]

    for _ in range(30):
        seen(one, one.actions.sample(rng, 3))
    other = copied(one)
    for _ in range(60):
        actions = one.actions.sample(rng, 3)
        for ours, theirs in zip(seen(one, actions), seen(other, actions), strict=True):
            np.testing.assert_array_equal(ours, theirs)


@MINIGRID
def test_every_drawn_layout_can_be_solved(name):
    """64 shortest plans, each of which the engine confirms: solved in its last step, not before."""
    layouts, plans = planned(name, LANES)
    lengths = np.array([len(plan) for plan in plans])
    print(f"{name}: shortest plans take {lengths.mean():.2f} steps on average, {lengths.max()} at most")
    env = suite.load(name).make(len(plans), 0)
    env.set_layouts(layouts)
    ends = np.zeros(len(plans), dtype=int)
    for t in range(lengths.max()):
        step = env.step(np.array([plan[t] if t < len(plan) else 0 for plan in plans]))
        ends[step.terminated] = t + 1
    np.testing.assert_array_equal(ends, lengths)


@pytest.mark.parametrize("name", ["OpenGoal", "BoxDoor"])
def test_plans_are_as_short_as_breadth_first_search_finds(name):
    layouts, plans = planned(name, LANES)
    for lane in range(4):
        world = World(SPECS[name], layouts, lane)
        frontier, seen, depth = {world.start}, {world.start}, 0
        while not any(map(world.solved, frontier)):
            frontier = {after for state in frontier for _, after in world.successors(state)} - seen
            seen |= frontier
            depth += 1
        assert len(plans[lane]) == depth


@MINIGRID
def test_starts_are_spread_over_the_rooms(name):
    where = draw_layouts(SPECS[name], np.random.default_rng(0), 4000)
    passages, counts = np.unique(where.where[:, 7], return_counts=True)
    assert len(passages) == 6
    assert counts.min() > 500
    assert set(np.unique(where.agent % 15)) == {1, 2, 3}
    assert len(np.unique(where.agent)) == 18
    assert np.unique(where.facing, return_counts=True)[1].min() > 800


@pytest.mark.parametrize(
    ("typed", "hint"),
    [
        ("BoxDor", "did you mean BoxDoor?"),
        ("doorball", "did you mean DoorBall"),
        ("./Chess", "a task file ends in .yaml"),
        ("Chess", "run: paddlectl tasks"),
    ],
)
def test_a_task_that_isn_t_there(typed, hint):
    with pytest.raises(NotFoundError, match="no task") as error:
        suite.load(typed)
    assert error.value.exit_code == 4
    assert error.value.hint.startswith(hint)
