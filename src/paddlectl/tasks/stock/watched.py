"""MiniGrid's environments, watched for what a task of theirs is told in."""

from typing import Any

import gymnasium

from paddlectl.tasks.stock.ways import Map, View

_PICK_UP = 3  # the first action that may change the grid


class Watched(gymnasium.Wrapper[Any, Any, Any, Any]):
    """MiniGrid without its own view, which takes most of its time; its grid is read when it has changed."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self._inner: Any = env.unwrapped
        self._map: Map | None = None
        nothing = {"image": None, "direction": 0, "mission": ""}
        setattr(self._inner, "gen_obs", lambda: nothing)  # noqa: B010

    def reset(self, **given: Any) -> Any:
        self._map = None
        return self.env.reset(**given)

    def step(self, action: Any) -> Any:
        if action < _PICK_UP:
            return self.env.step(action)
        before = self._front()
        stepped = self.env.step(action)
        if self._front() != before:
            self._map = None
        return stepped

    def _front(self) -> tuple[Any, ...]:
        """What an action may change."""
        cell = self._inner.grid.get(*self._inner.front_pos)
        return id(cell), getattr(cell, "is_open", None), id(self._inner.carrying)

    def view(self) -> View:
        """The present state."""
        if self._map is None:
            self._map = Map(self._inner)
        x, y = self._inner.agent_pos
        return View(self._map, int(y) * self._map.width + int(x), int(self._inner.agent_dir))
