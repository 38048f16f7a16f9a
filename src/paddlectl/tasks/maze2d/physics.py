"""A point mass in the maze, many at once: MuJoCo's own step on one data structure a lane.

The body is gymnasium-robotics' own; its walls are added here as its `PointMaze` does. MuJoCo is imported
when the first of them is made: tasks are listed and compared without it.
"""

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from paddlectl.errors import NotFoundError
from paddlectl.tasks.base import Ints
from paddlectl.tasks.maze2d.layouts import MAP, Points, centre

MOST_SPEED = 5.0
"""A component of the velocity is cut to this before each step, in m/s."""

_WALL_HEIGHT = 0.4
_HINT = "run: pip install 'paddlectl[maze]'"


def _mujoco() -> Any:
    """The package.

    Raises:
        NotFoundError: If what the maze needs isn't installed.
    """
    try:
        import mujoco
    except ModuleNotFoundError as error:
        raise NotFoundError(f"the maze needs {error.name}, which isn't installed", _HINT) from error
    return mujoco


@cache
def maze_model() -> Any:
    """MuJoCo's model of the point mass among the walls of `MAP`."""
    package = find_spec("gymnasium_robotics")
    if package is None or not package.submodule_search_locations:
        raise NotFoundError("the maze needs gymnasium_robotics, which isn't installed", _HINT)
    body = Path(package.submodule_search_locations[0]) / "envs/assets/point/point.xml"
    tree = ElementTree.parse(body)  # noqa: S314  # a file of an installed package
    world = tree.find("worldbody")
    assert world is not None
    for row, line in enumerate(MAP):
        for column, cell in enumerate(line):
            if cell == "#":
                x, y = centre(row, column)
                ElementTree.SubElement(
                    world,
                    "geom",
                    type="box",
                    pos=f"{x} {y} {_WALL_HEIGHT / 2}",
                    size=f"0.5 0.5 {_WALL_HEIGHT / 2}",
                    contype="1",
                    conaffinity="1",
                )
    return _mujoco().MjModel.from_xml_string(ElementTree.tostring(tree.getroot(), encoding="unicode"))


class PointMasses:
    """B independent point masses.

    Attributes:
        position: In metres. [B, 2]
        velocity: In m/s. [B, 2]
    """

    def __init__(self, num_envs: int) -> None:
        self._make(num_envs)

    def _make(self, num_envs: int) -> None:
        self._mujoco = mujoco = _mujoco()
        self._model = maze_model()
        self._whole = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        self._data = [mujoco.MjData(self._model) for _ in range(num_envs)]
        self._force = [data.ctrl for data in self._data]
        self._place = [data.qpos for data in self._data]
        self._speed = [data.qvel for data in self._data]
        self.position: Points = np.zeros((num_envs, 2))
        self.velocity: Points = np.zeros((num_envs, 2))

    def put(self, lanes: Ints, positions: Points, velocities: Points | None = None) -> None:
        """Puts these lanes there, at rest without velocities. [n], [n, 2], [n, 2]"""
        velocities = np.zeros_like(positions) if velocities is None else velocities
        for lane, position, velocity in zip(lanes, positions, velocities, strict=True):
            self._mujoco.mj_resetData(self._model, self._data[lane])
            self._place[lane][:], self._speed[lane][:] = position, velocity
            self._mujoco.mj_forward(self._model, self._data[lane])
        self.position[lanes] = positions
        self.velocity[lanes] = velocities

    def push(self, lanes: Ints, forces: Points) -> None:
        """Sets the forces of these lanes, in [-1, 1]. [n], [n, 2]"""
        for lane, force in zip(lanes, forces, strict=True):
            self._force[lane][:] = force

    def step(self, lanes: Ints) -> None:
        """Moves these lanes on by 0.01 s. [n]"""
        mj_step, model = self._mujoco.mj_step, self._model
        fast = np.abs(self.velocity[lanes]).max(-1, initial=0.0) > MOST_SPEED
        for lane in lanes[fast]:
            self._speed[lane][:] = self.velocity[lane].clip(-MOST_SPEED, MOST_SPEED)
        for lane in lanes.tolist():
            mj_step(model, self._data[lane])
            self.position[lane] = self._place[lane]
            self.velocity[lane] = self._speed[lane]

    def snapshot(self) -> dict[str, Any]:
        """All that the next steps depend on: MuJoCo's own state of each lane, and what was read off it."""
        return {"states": self._states(), "position": self.position, "velocity": self.velocity}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Goes back to where a snapshot was taken."""
        for data, state in zip(self._data, snapshot["states"], strict=True):
            self._mujoco.mj_setState(self._model, data, state, self._whole)
        self.position[:] = snapshot["position"]
        self.velocity[:] = snapshot["velocity"]

    def __getstate__(self) -> dict[str, Any]:
        """A copy has data of its own, and what reads it off."""
        return self.snapshot()

    def __setstate__(self, snapshot: dict[str, Any]) -> None:
        self._make(len(snapshot["position"]))
        self.restore(snapshot)

    def _states(self) -> Points:
        states = np.empty((len(self._data), self._mujoco.mj_stateSize(self._model, self._whole)))
        for data, state in zip(self._data, states, strict=True):
            self._mujoco.mj_getState(self._model, data, state, self._whole)
        return states
