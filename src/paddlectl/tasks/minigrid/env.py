"""The MiniGrid tasks as MiniGrid environments, registered with Gymnasium as `paddle/BoxDoor-v0`, ...

The rules are written a second time here, on MiniGrid's own objects; only the drawing of layouts is shared
with the engine.
"""

from typing import Any

import gymnasium
import numpy as np
from minigrid.core.grid import Grid
from minigrid.core.world_object import Ball, Box, Door, Floor, Goal, Key, Wall, WorldObj
from minigrid.minigrid_env import MiniGridEnv

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import Defined, Split
from paddlectl.tasks.environment import TaskEnv
from paddlectl.tasks.minigrid.engine import Engine, State
from paddlectl.tasks.minigrid.grid import (
    ABSENT,
    CODE_OF_THING,
    HEIGHT,
    MIDDLE,
    WIDTH,
    Action,
    Code,
    Facing,
    Held,
    Thing,
)
from paddlectl.tasks.minigrid.layouts import HORIZON, SPECS, Layouts, Passage, Spec, draw_layouts, layout_of
from paddlectl.tasks.minigrid.mission import Mission
from paddlectl.tasks.minigrid.symbols import SUBGOALS


class Tile(Floor):
    """A tile that can't be walked on and keeps the one ball that may be put there."""

    contains: Any  # the ball, once it lies here

    def __init__(self, color: str, takes: WorldObj) -> None:
        super().__init__(color)
        self.takes = takes

    def can_overlap(self) -> bool:
        return False

    def encode(self) -> tuple[int, int, int]:
        """MiniGrid's floor; its state is 1 once the ball lies there."""
        kind, color, _ = super().encode()
        return kind, color, int(self.contains is not None)

    def render(self, img: Any) -> None:  # type: ignore[override]  # MiniGrid's hint is wrong
        super().render(img)  # type: ignore[no-untyped-call]
        if self.contains is not None:
            self.contains.render(img)


class Chest(Box):
    """A box that stays where it is."""

    contains: Any

    def can_pickup(self) -> bool:
        return False


class PaddleEnv(TaskEnv, MiniGridEnv):
    """One of the seven tasks, or one from a file.

    MiniGrid's objects are typed as Any here: its own hints know neither what is carried nor where a thing is.

    Args:
        task: Its name, or what its file defines.
        split: Of which the layouts are.
        milestone_reward: What each milestone pays; 0 gives the sparse variant.
        max_steps: Steps after which an episode is truncated; the final reward falls over as many.
        **kwargs: MiniGrid's own, `render_mode` and the like.

    Raises:
        ValueError: If there is no such split, or episodes would have no step.
    """

    def __init__(
        self,
        task: str | Spec,
        split: Split = "training",
        milestone_reward: float = 0.1,
        max_steps: int = HORIZON,
        **kwargs: Any,
    ) -> None:
        self.spec_of_task = SPECS[task] if isinstance(task, str) else task
        self.configure(split, max_steps)
        self.milestone_reward = milestone_reward
        mission: Any = Mission(self.spec_of_task.mission)
        super().__init__(mission, width=WIDTH, height=HEIGHT, max_steps=self.max_steps, **kwargs)
        self.actions: Any = Action
        self.carrying: Any = None
        self.action_space = gymnasium.spaces.Discrete(len(Action) - 1)

    @property
    def task(self) -> str:
        return self.spec_of_task.name

    @property
    def asked(self) -> str | Defined:
        own = self.spec_of_task
        return own.name if SPECS.get(own.name) is own else Defined(own)

    def _gen_grid(self, width: int, height: int) -> None:
        self.place(draw_layouts(self.spec_of_task, self.np_random, 1, self.split))

    def begin(self, start: Any) -> None:
        self.place(layout_of(self.spec_of_task, start))

    def place(self, layouts: Layouts, index: int = 0) -> None:
        """Starts an episode from one of the given layouts."""
        self.begin_episode()
        self.grid = Grid(WIDTH, HEIGHT)
        self.grid.wall_rect(0, 0, MIDDLE + 1, HEIGHT)
        self.grid.wall_rect(MIDDLE, 0, MIDDLE + 1, HEIGHT)
        self.agent_pos = _position(layouts.agent[index])
        self.agent_dir = int(layouts.facing[index])
        self.carrying = None
        self.step_count = 0
        self._earned: set[int] = set()  # milestones, by place
        self._make_objects()
        for thing, cell in zip(Thing, layouts.where[index], strict=True):
            if cell != ABSENT:
                self.put_obj(self._objects[thing], *_position(cell))

    def _make_objects(self) -> None:
        make_ball: Any = Ball
        key, blockage, ball = Key("yellow"), make_ball("yellow"), make_ball("green")
        passage = self.spec_of_task.passage
        self._objects: dict[Thing, Any] = {
            Thing.KEY: key,
            Thing.BOX: Chest("purple", contains=key),
            Thing.BLOCKAGE: blockage,
            Thing.BALL: ball,
            Thing.GOAL: Goal(),
            Thing.YELLOW_TILE: Tile("yellow", takes=blockage),
            Thing.RED_TILE: Tile("red", takes=ball),
            Thing.PASSAGE: Door(
                color="grey" if passage is Passage.GAP else "yellow",
                is_locked=passage is not Passage.CLOSED,
            ),
        }

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step; `info["score"]` is the final reward alone.

        Raises:
            ValueError: If the action isn't one of the seven.
        """
        reward, score, terminated, truncated = self.advance(action)
        if self.render_mode == "human":
            self.render()  # type: ignore[no-untyped-call]
        return self.gen_obs(), reward, terminated, truncated, {"score": score}  # type: ignore[no-untyped-call]

    def advance(self, action: int) -> tuple[float, float, bool, bool]:
        """One step without its observation: reward, score, terminated, truncated."""
        chosen = Action(int(Engine.actions.checked(action)))
        self.step_count += 1
        self._act(chosen)
        spec = self.spec_of_task
        new = [
            i for i, subgoal in enumerate(spec.milestones) if i not in self._earned and self.holds(subgoal)
        ]
        self._earned.update(new)
        solved = all(self.holds(subgoal) for subgoal in spec.success)
        score = self._reward() if solved else 0.0
        reward = self.milestone_reward * len(new) + score
        self.earned += reward
        return reward, score, solved, self.steps_remaining <= 0 and not solved

    def _act(self, action: Action) -> None:
        if action < Action.PICK_UP:
            self.agent_dir = int(Facing[action.name])
        dx, dy = _VECTORS[self.agent_dir]
        front = (self.agent_pos[0] + dx, self.agent_pos[1] + dy)
        cell = self.grid.get(*front)
        if action < Action.PICK_UP:
            if cell is None or cell.can_overlap():
                self.agent_pos = front
        elif action == Action.PICK_UP:
            self._pick_up(front, cell)
        elif action == Action.DROP:
            self._drop(front, cell)
        elif action == Action.TOGGLE:
            self._toggle(front, cell)

    def _pick_up(self, front: tuple[int, int], cell: Any) -> None:
        if self.carrying is not None or cell is None or not cell.can_pickup():
            return
        self.carrying = cell
        cell.cur_pos = (-1, -1)
        self.grid.set(*front, None)
        if isinstance(cell, Key) and self.spec_of_task.passage is Passage.GAP:
            self.door.is_locked, self.door.is_open = False, True

    def _drop(self, front: tuple[int, int], cell: Any) -> None:
        if self.carrying is None:
            return
        if cell is None:
            self.grid.set(*front, self.carrying)
        elif isinstance(cell, Tile) and cell.takes is self.carrying:
            cell.contains = self.carrying
        else:
            return
        self.carrying.cur_pos = front
        self.carrying = None

    def _toggle(self, front: tuple[int, int], cell: Any) -> None:
        if cell is None or (isinstance(cell, Door) and cell.is_open):
            return
        cell.toggle(self, front)
        if isinstance(cell, Chest):
            cell.contains.cur_pos = front

    def mirror_in(self, engine: Engine) -> None:
        """Brings the one lane of the task's engine into the present state."""
        where = np.full((1, len(Thing)), ABSENT)
        for thing, known in self._objects.items():
            if known.cur_pos is not None and known is not self.carrying:
                where[0, thing] = _cell(known.cur_pos)
        if self._objects[Thing.KEY].cur_pos is not None:
            where[0, Thing.BOX] = ABSENT  # it was opened, or there is none
        state = State(
            np.array([[self._code_of(cell) for cell in self.grid.grid]], np.uint8),
            np.array([_cell(self.agent_pos)]),
            np.array([self.agent_dir]),
            np.array([Held.NOTHING if self.carrying is None else Held[self._name_of(self.carrying).name]]),
            where,
        )
        milestones = self.spec_of_task.milestones
        paid = sum(1 << SUBGOALS.index(milestones[number]) for number in self._earned)
        engine.set_state(state, np.array([self.step_count]), np.array([paid]))

    def _code_of(self, cell: Any) -> int:
        if cell is None:
            return Code.EMPTY
        if isinstance(cell, Wall):
            return Code.WALL
        if cell is self.door:
            return Code.OPEN if cell.is_open else self.spec_of_task.passage.value
        if isinstance(cell, Tile) and cell.contains is not None:
            return Code[f"{self._name_of(cell.contains).name}_PLACED"]
        return int(CODE_OF_THING[self._name_of(cell)])

    def _name_of(self, known: Any) -> Thing:
        return next(thing for thing, other in self._objects.items() if other is known)

    def __getstate__(self) -> dict[str, Any]:
        """Without the window, if there is one; a copy opens its own."""
        return {**self.__dict__, "window": None, "clock": None}

    @property
    def door(self) -> Any:
        return self._objects[Thing.PASSAGE]

    def is_blocked(self) -> bool:
        """Whether an object lies on either side of the passage."""
        x, y = self.door.cur_pos
        return any(isinstance(self.grid.get(x + side, y), Key | Ball | Box) for side in (-1, 1))

    def holds(self, subgoal: Atom) -> bool:
        """Whether a subgoal holds now."""
        things, objects = self.spec_of_task.things, self._objects
        match subgoal.predicate.name:
            case "gt_blockage":
                return self.carrying is objects[Thing.BLOCKAGE]
            case "put_blockage":
                return Thing.BLOCKAGE in things and self._put_down(objects[Thing.BLOCKAGE])
            case "gt_box":
                return Thing.BOX in things and objects[Thing.KEY].cur_pos is not None
            case "gt_key":
                return self.carrying is objects[Thing.KEY]
            case "gt_door":
                return bool(self.door.is_open)
            case "put_key":
                return self._put_down(objects[Thing.KEY])
            case "gt_ball":
                return self.carrying is objects[Thing.BALL]
            case "gt_goal":
                return Thing.GOAL in things and self.agent_pos == objects[Thing.GOAL].cur_pos
            case "place_blockage":
                return objects[Thing.YELLOW_TILE].contains is not None
            case "place_ball":
                return objects[Thing.RED_TILE].contains is not None
        raise ValueError(f"no subgoal of these tasks: {subgoal}")

    def _put_down(self, thing: Any) -> bool:
        return thing.cur_pos is not None and self.carrying is not thing and not self.is_blocked()


_VECTORS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by facing


def _position(cell: int) -> tuple[int, int]:
    y, x = divmod(int(cell), WIDTH)
    return x, y


def _cell(position: Any) -> int:
    x, y = position
    return int(y * WIDTH + x)
