"""The maze tasks as Gymnasium environments over gymnasium-robotics' PointMaze: `paddle/CoffeeMaze-v0`, ...

The rules are written a second time here; only the drawing of starts is shared with the engine. Episodes are
drawn from above by Pillow, without OpenGL.
"""

import io
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import Split
from paddlectl.tasks.environment import TaskEnv
from paddlectl.tasks.maze2d import symbols as s
from paddlectl.tasks.maze2d.engine import Engine
from paddlectl.tasks.maze2d.layouts import (
    COLUMNS,
    HORIZON,
    MAP,
    PLACES,
    RADIUS,
    ROWS,
    SPECS,
    Points,
    draw_starts,
    position_of,
)

try:
    import mujoco

    with redirect_stderr(io.StringIO()):  # it tells of environments that aren't used here
        from gymnasium_robotics.envs.maze.point_maze import PointMazeEnv
except ModuleNotFoundError as error:
    raise DependencyNotInstalled(
        f"the maze needs {error.name}, which isn't installed; run: pip install 'paddlectl[maze]'"
    ) from error

_CELL = 32  # pixels
_COLOURS = {
    s.GT_COFFEE: (121, 72, 32),
    s.GT_COFFEE_OFFICE: (214, 169, 120),
    s.GT_MAIL: (40, 90, 200),
    s.GT_MAIL_OFFICE: (150, 185, 245),
    s.GT_BALL: (210, 40, 40),
}
_THINGS = ((s.GT_COFFEE, s.GT_COFFEE_OFFICE), (s.GT_MAIL, s.GT_MAIL_OFFICE))
_MOST_SPEED = 10.0  # PointMaze cuts it to 5 m/s before each step
_WHOLE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_WALL, _FLOOR, _AGENT = (70, 70, 74), (245, 245, 240), (40, 150, 70)


class PaddleMazeEnv(TaskEnv):
    """One of the three tasks.

    Observations are position and velocity, then 0 or 1 for has_coffee, coffee_delivered, has_mail and
    mail_delivered. Actions are forces in [-1, 1] along x and y.

    Args:
        task: Its name.
        split: Of which the starts are.
        max_steps: Steps after which an episode is truncated; the final reward falls over as many.
        render_mode: `rgb_array` or None.

    Raises:
        ValueError: If there is no such split, or episodes would have no step.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012  # Gymnasium's own way

    def __init__(
        self,
        task: str,
        split: Split = "training",
        max_steps: int = HORIZON,
        render_mode: str | None = None,
    ) -> None:
        self.spec_of_task = SPECS[task]
        self.configure(split, max_steps)
        self.render_mode = render_mode
        self._point = _point()
        most = np.array([COLUMNS / 2, ROWS / 2, _MOST_SPEED, _MOST_SPEED, 1, 1, 1, 1])
        self.observation_space = gymnasium.spaces.Box(np.where(most > 1, -most, 0), most, dtype=np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._things = [thing for thing in _THINGS if thing[0] in self.spec_of_task.subgoals]

    @property
    def task(self) -> str:
        return self.spec_of_task.name

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Starts an episode where `draw_starts` puts it."""
        super().reset(seed=seed)
        self._point.reset()
        self.place(draw_starts(self.np_random, 1, self.split)[0])
        return self.observation(), {}

    def begin(self, start: Any) -> None:
        self._point.reset()
        self.place(position_of(start))

    def place(self, start: Points) -> None:
        """Starts an episode from a given position. [2]"""
        self.begin_episode()
        self._point.set_state(start, np.zeros(2))
        self.t = 0
        self.held: set[Atom] = set()
        self.delivered: set[Atom] = set()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """One step of 0.01 s; `info["score"]` is the final reward alone.

        Raises:
            ValueError: If a force isn't in [-1, 1].
        """
        reward, score, terminated, truncated = self.advance(action)
        return self.observation(), reward, terminated, truncated, {"score": score}

    def advance(self, action: NDArray[Any]) -> tuple[float, float, bool, bool]:
        """One step without its observation: reward, score, terminated, truncated."""
        self._point.step(Engine.actions.checked(action).astype(np.float64))
        self.t += 1
        reward = 0.0
        for get, deliver in self._things:
            if self.at(get) and get not in self.held | self.delivered:
                self.held.add(get)
                reward += 10.0
            elif self.at(deliver) and get in self.held:
                self.held.remove(get)
                self.delivered.add(get)
                reward += 10.0
        solved = self.at(s.GT_BALL) and len(self.delivered) == len(self._things)
        score = 100 * (1 - 0.9 * self.t / self.max_steps) if solved else 0.0
        self.earned += reward + score
        return reward + score, score, solved, self.t >= self.max_steps and not solved

    def at(self, subgoal: Atom) -> bool:
        """Whether the ball touches a subgoal's place."""
        return bool(np.linalg.norm(self.position - PLACES[s.SUBGOALS.index(subgoal)]) <= RADIUS)

    @property
    def position(self) -> Points:
        """In metres. [2]"""
        position: Points = self._point.data.qpos.copy()
        return position

    def observation(self) -> NDArray[np.float64]:
        """Position, velocity, and what is carried and delivered. [8]"""
        return np.concatenate([self.position, self._point.data.qvel, self._facts()])

    def _facts(self) -> list[bool]:
        return [get in had for get, _ in _THINGS for had in (self.held, self.delivered)]

    def mirror_in(self, engine: Engine) -> None:
        """Brings the one lane of the task's engine into the present state."""
        facts = sum(int(holds) << bit for bit, holds in enumerate(self._facts()))
        velocity = self._point.data.qvel.copy()
        engine.set_state(self.position[None], velocity[None], np.array([facts]), np.array([self.t]))

    def render(self) -> NDArray[np.uint8] | None:
        """The maze from above; a thing in hand is drawn on the ball. [288, 384, 3]"""
        if self.render_mode is None:
            return None
        image = Image.new("RGB", (COLUMNS * _CELL, ROWS * _CELL), _FLOOR)
        draw = ImageDraw.Draw(image)
        for row, line in enumerate(MAP):
            for column, cell in enumerate(line):
                if cell == "#":
                    x, y = column * _CELL, row * _CELL
                    draw.rectangle((x, y, x + _CELL - 1, y + _CELL - 1), _WALL)
        for get, deliver in self._things:
            _disc(draw, PLACES[s.SUBGOALS.index(deliver)], RADIUS, _COLOURS[deliver])
            if get not in self.held | self.delivered:
                _disc(draw, PLACES[s.SUBGOALS.index(get)], 0.25, _COLOURS[get])
            if get in self.delivered:
                _disc(draw, PLACES[s.SUBGOALS.index(deliver)], 0.2, _COLOURS[get])
        _disc(draw, PLACES[s.SUBGOALS.index(s.GT_BALL)], RADIUS, _COLOURS[s.GT_BALL])
        _disc(draw, self.position, 0.2, _AGENT)
        for number, get in enumerate(sorted(self.held)):
            _disc(draw, self.position + np.array([0.12 * number - 0.06, 0.0]), 0.1, _COLOURS[get])
        return np.array(image)

    def close(self) -> None:
        self._point.close()

    def __getstate__(self) -> dict[str, Any]:
        """With MuJoCo's own state in the place of what can't be copied."""
        state = np.empty(mujoco.mj_stateSize(self._point.model, _WHOLE))
        mujoco.mj_getState(self._point.model, self._point.data, state, _WHOLE)
        return {**self.__dict__, "_point": state}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _point=_point())
        mujoco.mj_setState(self._point.model, self._point.data, state["_point"], _WHOLE)


def _point() -> Any:
    """PointMaze's ball among our walls."""
    maze_map = [[int(cell == "#") for cell in line] for line in MAP]
    maze = PointMazeEnv(maze_map=maze_map, continuing_task=True)
    Path(maze.tmp_xml_file_path).unlink()  # read already; nobody else would remove it
    return maze.point_env


def _disc(draw: ImageDraw.ImageDraw, centre: Points, radius: float, colour: tuple[int, int, int]) -> None:
    """A disc of this radius in metres around a place of the map."""
    x, y = (centre[0] + COLUMNS / 2) * _CELL, (ROWS / 2 - centre[1]) * _CELL
    r = radius * _CELL
    draw.ellipse((x - r, y - r, x + r, y + r), colour)
