"""States of the MiniGrid tasks drawn as eight lines of text, for tables worked by hand."""

import numpy as np

from paddlectl.tasks.minigrid.engine import State
from paddlectl.tasks.minigrid.grid import ABSENT, CELLS, Code, Held, Thing

_CODES = {
    ".": Code.EMPTY,
    "#": Code.WALL,
    "k": Code.KEY,
    "x": Code.BOX,
    "b": Code.BLOCKAGE,
    "g": Code.BALL,
    "G": Code.GOAL,
    "y": Code.YELLOW_TILE,
    "r": Code.RED_TILE,
    "Y": Code.BLOCKAGE_PLACED,
    "R": Code.BALL_PLACED,
    "L": Code.LOCKED,
    "C": Code.CLOSED,
    "|": Code.GAP,
    "/": Code.OPEN,
}
_THINGS = {
    "k": [Thing.KEY],
    "x": [Thing.BOX],
    "b": [Thing.BLOCKAGE],
    "g": [Thing.BALL],
    "G": [Thing.GOAL],
    "y": [Thing.YELLOW_TILE],
    "r": [Thing.RED_TILE],
    "Y": [Thing.BLOCKAGE, Thing.YELLOW_TILE],
    "R": [Thing.BALL, Thing.RED_TILE],
    **{char: [Thing.PASSAGE] for char in "LC|/"},
}
_AGENT = ">v<^"


def parse(picture: str, held: Held = Held.NOTHING, on: str = ".") -> State:
    """One state; the agent is one of `>v<^`, and `on` is what it stands on."""
    text = "".join(picture.split())
    assert len(text) == CELLS
    agent = next(i for i, char in enumerate(text) if char in _AGENT)
    facing = _AGENT.index(text[agent])
    text = text[:agent] + on + text[agent + 1 :]
    where = np.full((1, len(Thing)), ABSENT)
    for cell, char in enumerate(text):
        where[0, _THINGS.get(char, [])] = cell
    grid = np.array([[_CODES[char] for char in text]], dtype=np.uint8)
    return State(grid, np.array([agent]), np.array([facing]), np.array([int(held)]), where)


def draw(state: State, lane: int = 0) -> str:
    """The picture of a lane; what the agent stands on is lost."""
    chars = {int(code): char for char, code in _CODES.items()}
    text = [chars[int(code)] for code in state.grid[lane]]
    text[int(state.agent[lane])] = _AGENT[int(state.facing[lane])]
    return "\n".join("".join(text[i : i + 15]) for i in range(0, CELLS, 15))
