"""Both faces of the MiniGrid tasks, step by step from the same layouts with the same actions.

Of five episodes one is random, one follows a shortest plan to its end, and three follow one for a part of its
way and go on at random: so open doors, full hands and placed balls are met as often as locked rooms.
"""

import numpy as np
import pytest
from minigrid.core.world_object import Ball, Box, Door, Goal, Key, Wall

from paddlectl.tasks.minigrid import symbols
from paddlectl.tasks.minigrid.engine import Engine
from paddlectl.tasks.minigrid.env import PaddleEnv, Tile
from paddlectl.tasks.minigrid.grid import WIDTH, Code, Held
from paddlectl.tasks.minigrid.layouts import HORIZON, SPECS, Layouts, draw_layouts
from planner import shortest_plan

EPISODES, PLANS = 150, 30
_TILES = {("yellow", False): Code.YELLOW_TILE, ("yellow", True): Code.BLOCKAGE_PLACED}
_TILES |= {("red", False): Code.RED_TILE, ("red", True): Code.BALL_PLACED}
_CODES = {Wall: Code.WALL, Key: Code.KEY, Goal: Code.GOAL}
_BALLS = {"yellow": Code.BLOCKAGE, "green": Code.BALL}


def code_of(cell) -> int:
    """What the engine calls an object of MiniGrid's."""
    if cell is None:
        return Code.EMPTY
    if isinstance(cell, Ball):
        return _BALLS[cell.color]
    if isinstance(cell, Box):
        assert isinstance(cell.contains, Key)
        return Code.BOX
    if isinstance(cell, Tile):
        return _TILES[cell.color, cell.contains is not None]
    if isinstance(cell, Door):
        if cell.is_open:
            return Code.OPEN
        return {("yellow", True): Code.LOCKED, ("yellow", False): Code.CLOSED, ("grey", True): Code.GAP}[
            cell.color, cell.is_locked
        ]
    return _CODES[type(cell)]


def held_by(env: PaddleEnv) -> int:
    if env.carrying is None:
        return Held.NOTHING
    if isinstance(env.carrying, Key):
        return Held.KEY
    return {"yellow": Held.BLOCKAGE, "green": Held.BALL}[env.carrying.color]


class Pair:
    """One MiniGrid environment beside one lane of the engine."""

    def __init__(self, task: str, layouts: Layouts, lane: int) -> None:
        self.env = PaddleEnv(task)
        self.env.place(layouts, lane)
        self.lane = lane
        self._changing = [thing for thing in self.env._objects.values() if isinstance(thing, Tile | Door)]
        self._seen, self._codes = None, b""

    def codes(self) -> bytes:
        """The grid in the engine's codes, worked out anew only if an object moved or changed."""
        seen = [*self.env.grid.grid, *[getattr(thing, "is_open", thing.contains) for thing in self._changing]]
        if seen != self._seen:
            self._seen = seen
            self._codes = bytes(code_of(cell) for cell in self.env.grid.grid)
        return self._codes

    def pose(self) -> tuple[int, int, int, int]:
        x, y = self.env.agent_pos
        return y * WIDTH + x, self.env.agent_dir, held_by(self.env), self.env.step_count


def _episodes(task: str, rng: np.random.Generator) -> tuple[Layouts, np.ndarray]:
    """Layouts, and actions over time and lanes. [320, EPISODES]"""
    spec = SPECS[task]
    drawn = draw_layouts(spec, rng, EPISODES)
    plans = [shortest_plan(spec, drawn, lane) for lane in range(PLANS)]
    chosen = np.arange(EPISODES) % PLANS
    chosen[4::5] = np.arange(EPISODES)[4::5]
    actions = rng.integers(7, size=(HORIZON, EPISODES))
    for lane in range(EPISODES):
        plan = [] if lane % 5 == 4 else plans[chosen[lane]]
        kept = len(plan) if lane % 5 == 0 else rng.integers(len(plan) + 1)
        actions[:kept, lane] = plan[:kept]
    return Layouts(*(values[chosen] for values in drawn)), actions


def _agree(pairs: list[Pair], actions: np.ndarray, engine: Engine) -> list[Pair]:
    """Steps both faces, compares all that there is, and returns the pairs that go on."""
    step, state = engine.step(actions), engine.state
    poses = np.stack([state.agent, state.facing, state.held, engine.t], axis=1).tolist()
    rewards = np.stack([step.reward, step.score], axis=1).tolist()
    ends = np.stack([step.terminated, step.truncated], axis=1).tolist()
    actions = actions.tolist()
    for pair in pairs:
        lane = pair.lane
        reward, score, *end = pair.env.advance(actions[lane])
        assert list(pair.pose()) == poses[lane]
        assert pair.codes() == state.grid[lane].tobytes()
        assert abs(reward - rewards[lane][0]) < 1e-6
        assert abs(score - rewards[lane][1]) < 1e-6
        assert end == ends[lane]
    return [pair for pair in pairs if not any(ends[pair.lane])]


@pytest.mark.parametrize("task", SPECS)
def test_both_faces_agree(task):
    layouts, actions = _episodes(task, np.random.default_rng(sum(map(ord, task))))
    engine = Engine(SPECS[task], EPISODES, 0)
    engine.set_layouts(layouts)
    running = [Pair(task, layouts, lane) for lane in range(EPISODES)]
    for pair in running:
        assert pair.codes() == engine.state.grid[pair.lane].tobytes()
    for row in actions:
        running = _agree(running, row, engine)
    assert not running
    opened = (engine.state.facts & symbols.Fact.OPEN) > 0
    assert (engine.t < HORIZON).sum() >= EPISODES // 5, "hardly any episode was solved"
    assert opened.sum() >= EPISODES // 5, "hardly any passage was opened"
