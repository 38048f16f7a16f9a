"""MiniGrid's own environments: stepped as they are, and told in facts by which a plain plan solves them."""

import copy
import hashlib
from pathlib import Path
from typing import Any

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest

from contract import CHECKS
from paddlectl.hybrid.settings import settings_for
from paddlectl.scenario import load_scenario
from paddlectl.tasks import suite
from paddlectl.tasks.stock.families import FAMILIES
from paddlectl.tasks.stock.tasks import SUBGOALS
from paddlectl.tasks.stock.watched import Watched
from paddlectl.tasks.stock.ways import NOWHERE, View
from samples import ROOT
from wayfarer import follow_plan

SEEN = {
    "MiniGrid-DoorKey-6x6-v0": "032999004ec6d24c",
    "MiniGrid-KeyCorridorS3R3-v0": "074cd6aa4827b0b6",
    "MiniGrid-ObstructedMaze-2Dlhb-v1": "b5b045e27257b0c8",
}
"""Of some hundred states, by the version that made the tasks known."""
EACH = pytest.mark.parametrize("name", FAMILIES)
SOME = pytest.mark.parametrize(
    "name", ["MiniGrid-DoorKey-6x6-v0", "MiniGrid-KeyCorridorS3R3-v0", "MiniGrid-ObstructedMaze-2Dlhb-v1"]
)


@EACH
def test_its_facts_lead_a_plan_to_success(name: str) -> None:
    assert follow_plan(suite.load(name), lanes=8, seed=5) >= 7


@EACH
def test_its_horizon_is_minigrids(name: str) -> None:
    assert gymnasium.make(name).unwrapped.max_steps == FAMILIES[name][1]  # type: ignore[attr-defined]


@SOME
def test_it_steps_and_pays_as_minigrid_does(name: str) -> None:
    lanes, rng = 3, np.random.default_rng(0)
    batch = suite.load(name).make(lanes, 7)
    alone = [gymnasium.make(name, disable_env_checker=True) for _ in range(lanes)]
    for lane, env in enumerate(alone):
        env.reset(seed=int(batch.seeds[lane]))
    for _ in range(150):
        actions = rng.choice(7, p=[0.1, 0.15, 0.3, 0.15, 0.1, 0.15, 0.05], size=lanes)
        step = batch.step(actions)
        for lane, env in enumerate(alone):
            _, reward, terminated, truncated, _ = env.step(int(actions[lane]))
            ours: Any = batch._lanes[lane].env.unwrapped
            theirs: Any = env.unwrapped
            assert (ours.grid.encode() == theirs.grid.encode()).all()
            assert (*ours.agent_pos, ours.agent_dir) == (*theirs.agent_pos, theirs.agent_dir)
            assert (ours.carrying is None) == (theirs.carrying is None)
            assert (step.terminated[lane], step.truncated[lane]) == (terminated, truncated)
            assert step.score[lane] == step.reward[lane] == pytest.approx(reward)
        done = step.terminated | step.truncated
        batch.reset(done)
        for lane in np.flatnonzero(done):
            alone[lane].reset(seed=int(batch.seeds[lane]))


@SOME
def test_what_is_kept_of_a_grid_is_what_would_be_read_anew(name: str) -> None:
    batch, rng = suite.load(name).make(4, 1), np.random.default_rng(3)
    subgoals = rng.integers(len(SUBGOALS), size=4)
    for _ in range(120):
        batch.step(rng.choice(7, p=[0.1, 0.15, 0.3, 0.15, 0.1, 0.15, 0.05], size=4))
        kept = batch.observe(subgoals), batch.flat_state(), batch.valuation()
        for lane in batch._lanes:
            assert isinstance(lane.env, Watched)
            lane.env._map = None
        batch._changed()
        for ours, anew in zip(
            kept, (batch.observe(subgoals), batch.flat_state(), batch.valuation()), strict=True
        ):
            np.testing.assert_array_equal(ours, anew)


@pytest.mark.parametrize(("name", "released"), SEEN.items())
def test_policies_see_what_they_learned_from(name: str, released: str) -> None:
    batch, rng, digest = suite.load(name).make(4, 2), np.random.default_rng(5), hashlib.sha256()
    for _ in range(300):
        step = batch.step(rng.choice(7, p=[0.1, 0.15, 0.3, 0.15, 0.1, 0.15, 0.05], size=4))
        for seen in (batch.valuation(), batch.flat_state(), batch.observe(rng.integers(9, size=4))):
            digest.update(np.ascontiguousarray(seen).tobytes())
        batch.reset(step.terminated | step.truncated)
    assert digest.hexdigest()[:16] == released


@SOME
def test_it_goes_on_from_what_was_kept(name: str) -> None:
    task, rng = suite.load(name), np.random.default_rng(0)
    one, other = task.make(3, 0), task.make(3, 0)
    for _ in range(40):
        done = one.step(rng.integers(7, size=3))
        one.reset(done.terminated | done.truncated)
    other.restore(copy.deepcopy(one.snapshot()))
    assert other.exact
    for _ in range(300):
        actions = rng.integers(7, size=3)
        for ours, theirs in zip(one.step(actions), other.step(actions), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(one.flat_state(), other.flat_state())
        for batch in (one, other):
            batch.reset(batch._finished.copy())


@pytest.mark.parametrize("method", ["paddle", "ppo"])
def test_methods_keep_their_promises_on_it(method: str) -> None:
    for check in CHECKS:
        check(method, "stock")


@pytest.mark.parametrize(
    "path", [*(ROOT / "scenarios" / "minigrid").glob("*.yaml")], ids=lambda path: path.stem
)
def test_its_scenarios_can_be_run(path: Path) -> None:
    scenario = load_scenario(path)
    assert {scenario.target, *scenario.source_names} <= FAMILIES.keys() and len(scenario.seeds) == 3


def test_all_tasks_share_what_a_domain_shares() -> None:
    shared = set()
    for name in FAMILIES:
        task = suite.load(name)
        batch = task.make(1, 0)
        shared.add(
            (task.domain, batch.observation_size, batch.flat_size, batch.actions, task.domain_subgoals)
        )
        assert settings_for(task).decisions.shaping > 0
    assert len(shared) == 1


def test_all_is_seen_in_the_agents_own_frame() -> None:
    """The same place, seen in four directions: what is ahead in one is to the right in the one before."""
    env: Any = Watched(gymnasium.make("MiniGrid-DoorKey-8x8-v0", disable_env_checker=True))
    env.reset(seed=0)
    view: View = env.view()
    seen = [SUBGOALS["gt_key()"].sees(View(view.map, view.agent, facing)) for facing in range(4)]
    forward, right = [each[50] for each in seen], [each[51] for each in seen]
    assert right == forward[1:] + forward[:1]
    windows = [np.asarray(each[:49]).reshape(7, 7) for each in seen]
    for before, after in zip(windows, windows[1:] + windows[:1], strict=True):
        np.testing.assert_array_equal(np.rot90(before), after)
    assert view.facts.key != NOWHERE and windows[0][3, 3] == 0
