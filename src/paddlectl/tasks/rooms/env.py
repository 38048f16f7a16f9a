"""A task of several rooms as a MiniGrid environment, with MiniGrid's own objects and rules."""

from typing import Any

import numpy as np
from minigrid.core.grid import Grid
from minigrid.core.world_object import Ball, Box, Door, Goal, Key, WorldObj
from minigrid.minigrid_env import MiniGridEnv

from paddlectl.tasks.base import Defined, Split
from paddlectl.tasks.environment import TaskEnv
from paddlectl.tasks.minigrid.mission import Mission
from paddlectl.tasks.rooms.layouts import Ground, Item, Layout
from paddlectl.tasks.rooms.plan import GOAL, Plan
from paddlectl.tasks.stock.tasks import SUBGOALS
from paddlectl.tasks.stock.ways import Map, View

_KINDS: dict[str, Any] = {"key": Key, "ball": Ball, "box": Box}


class RoomsEnv(TaskEnv, MiniGridEnv):
    """A task from a file.

    Args:
        task: What the file says.
        split: Of which the layouts are.
        milestone_reward: What each milestone pays; 0 gives the sparse variant.
        max_steps: Steps after which an episode is truncated; without, the task's.
        **kwargs: MiniGrid's own, `render_mode` and the like.

    Attributes:
        obj: What is to be picked up; None if the goal is to be reached.

    Raises:
        ValueError: If there is no such split, or episodes would have no step.
    """

    def __init__(
        self,
        task: Plan,
        split: Split = "training",
        milestone_reward: float = 0.1,
        max_steps: int | None = None,
        **kwargs: Any,
    ) -> None:
        self.plan = task
        self.configure(split, task.horizon if max_steps is None else max_steps)
        self.milestone_reward = milestone_reward
        self._ground = Ground(task)
        mission: Any = Mission(task.mission)
        width, height = self._ground.width, self._ground.height
        super().__init__(mission, width=width, height=height, max_steps=self.max_steps, **kwargs)
        self.obj: WorldObj | None = None
        self.carrying: Any = None

    @property
    def task(self) -> str:
        return self.plan.name

    @property
    def asked(self) -> Defined:
        return Defined(self.plan)

    def begin(self, start: Any) -> None:
        self.reset(seed=start["seed"])

    def _gen_grid(self, width: int, height: int) -> None:
        self.place(self._ground.drawn_of(self.split, self.np_random))

    def place(self, layout: Layout) -> None:
        """Starts an episode from a given layout."""
        self.begin_episode()
        self._earned: set[str] = set()
        self.grid = Grid(self.width, self.height)
        wall: Any = self.grid.horz_wall
        for y in range(self.height):
            wall(0, y, self.width)
        for cell in range(self.width * self.height):
            if self._ground.floor >> cell & 1:
                self.grid.set(*self._position(cell), None)
        self.obj = None
        for cell, item in layout.items.items():
            made = _object(item)
            self.put_obj(made, *self._position(cell))
            if cell == layout.target and item.what != GOAL:
                self.obj = made
        self.agent_pos = self._position(layout.agent)
        self.agent_dir = layout.facing

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step; `info["score"]` is the final reward alone."""
        seen, score, terminated, truncated, told = super().step(action)
        if self.obj is not None and self.carrying is self.obj:
            score, terminated = self._reward(), True
        truncated = truncated and not terminated
        reward = float(score) + self.milestone_reward * self._newly_earned()
        self.earned += reward
        return seen, reward, terminated, truncated, {**told, "score": float(score)}

    def _newly_earned(self) -> int:
        """How many milestones hold for the first time."""
        if not self.milestone_reward or self._earned.issuperset(self.plan.milestones):
            return 0
        new = self.holding() - self._earned
        self._earned |= new
        return len(new)

    def holding(self) -> set[str]:
        """Milestones that hold now."""
        view = self._view()
        return {each for each in self.plan.milestones if SUBGOALS[each].reached(view)}

    def mirror_in(self, engine: Any) -> None:
        """Brings the one lane of the task's environments into the present state."""
        paid = [each in self._earned for each in self.plan.milestones]
        engine.show(self._view(), self.step_count, np.array([paid], np.bool_))

    def _view(self) -> View:
        known = Map(self)
        x, y = self.agent_pos
        return View(known, int(y) * known.width + int(x), int(self.agent_dir))

    def _position(self, cell: int) -> tuple[int, int]:
        y, x = divmod(cell, self.width)
        return x, y

    def __getstate__(self) -> dict[str, Any]:
        """Without the window, if there is one; a copy opens its own."""
        return {**self.__dict__, "window": None, "clock": None}


def _object(item: Item) -> Any:
    if item.is_door:
        return Door(item.colour, is_open=item.what == "open", is_locked=item.what == "locked")
    if item.what == GOAL:
        return Goal()
    colour, kind = item.what.split()
    made = _KINDS[kind](colour)
    return Box(item.colour, contains=made) if item.colour else made
