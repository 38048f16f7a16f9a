"""The three maze tasks as data: the map, who waits where, and how starts are drawn.

A fourth task of the same kind is one more entry in SPECS.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paddlectl.logic.atoms import Atom
from paddlectl.tasks.base import FRAMES, Bools, Ints, Split
from paddlectl.tasks.maze2d import symbols as s
from paddlectl.tasks.split import belongs

Points = NDArray[np.float64]

HORIZON = 1000

MAP = (
    "############",
    "#    #     #",
    "# ## # # ###",
    "#      #   #",
    "# ## #  ## #",
    "#  # #     #",
    "## ### # # #",
    "#  #   #   #",
    "############",
)
ROWS, COLUMNS = len(MAP), len(MAP[0])
RADIUS = 0.4
"""A place is touched within this distance of its cell's centre, in metres; a cell is 1 m wide."""

START = (1, 1)
NOISE = 0.25
"""A start lies this far from its cell's centre at most, in x and in y."""

_ROUNDED = 1e-9  # metres

SQUARE = 2 * NOISE / 8
"""Starts of one square of this side, in metres, are of one split. Evaluation begins in squares where no
training begins; they may lie side by side."""


def centre(row: int, column: int) -> tuple[float, float]:
    """Where a cell's centre is, in metres: x to the right, y upward, the middle of the map at (0, 0)."""
    return column + 0.5 - COLUMNS / 2, ROWS / 2 - row - 0.5


PLACES: Points = np.array([centre(*cell) for cell in ((6, 2), (7, 4), (4, 7), (7, 6), (7, 9))])
"""Where each subgoal of `symbols.SUBGOALS` is reached. [5, 2]"""


STEPS = 20
"""A metre takes the ball about so many steps."""


def ways() -> Points:
    """Length of the shortest way from each cell's centre to each place, in cells; inf in walls. [R, C, 5]"""
    lengths = np.full((ROWS, COLUMNS, len(PLACES)), np.inf)
    for place, (x, y) in enumerate(PLACES):
        front = [(round(ROWS / 2 - y - 0.5), round(x + COLUMNS / 2 - 0.5))]
        length = 0
        while front:
            for cell in front:
                lengths[*cell, place] = length
            length += 1
            beside = {
                (row + down, column + right)
                for row, column in front
                for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0))
            }
            front = [
                cell for cell in beside if MAP[cell[0]][cell[1]] == " " and np.isinf(lengths[*cell, place])
            ]
    return lengths


WAYS = ways()
_AROUND = np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)])


def distances(position: Points, places: Ints) -> Points:
    """Metres from each ball to its place: to the centre of a cell beside it, then cell by cell. [n]"""
    column = np.floor(position[:, 0] + COLUMNS / 2).astype(np.intp)
    row = np.floor(ROWS / 2 - position[:, 1]).astype(np.intp)
    rows, columns = row[:, None] + _AROUND[:, 0], column[:, None] + _AROUND[:, 1]
    centres = np.stack([columns + 0.5 - COLUMNS / 2, ROWS / 2 - rows - 0.5], -1)
    straight = np.linalg.norm(position[:, None] - centres, axis=-1)
    nearest: Points = (straight + WAYS[rows, columns, places[:, None]]).min(-1)
    return nearest


@dataclass(frozen=True)
class Spec:
    """A task.

    Attributes:
        name: As typed on the command line.
        summary: One line for a reader.
        delivered: Facts that solve the task once the ball is touched.
        atoms: The vocabulary, in order.
        subgoals: The subgoals that programs may name.
        frames: The usual budget of learning it.
    """

    name: str
    summary: str
    delivered: s.Fact
    atoms: tuple[Atom, ...]
    subgoals: tuple[Atom, ...]
    frames: int = FRAMES


SPECS = {
    spec.name: spec
    for spec in (
        Spec(
            name="CoffeeMaze",
            summary="Get the coffee, bring it to its office, go to the ball.",
            delivered=s.Fact.COFFEE_DELIVERED,
            atoms=(s.COFFEE_IN_HAND, s.COFFEE_DELIVERED),
            subgoals=(s.GT_COFFEE, s.GT_COFFEE_OFFICE, s.GT_BALL),
            frames=4_000_000,
        ),
        Spec(
            name="MailMaze",
            summary="Get the mail, bring it to its office, go to the ball.",
            delivered=s.Fact.MAIL_DELIVERED,
            atoms=(s.MAIL_IN_HAND, s.MAIL_DELIVERED),
            subgoals=(s.GT_MAIL, s.GT_MAIL_OFFICE, s.GT_BALL),
            frames=2_000_000,
        ),
        Spec(
            name="CoffeeMailMaze",
            summary="Bring coffee and mail to their offices in any order, go to the ball.",
            delivered=s.Fact.COFFEE_DELIVERED | s.Fact.MAIL_DELIVERED,
            atoms=s.ATOMS,
            subgoals=s.SUBGOALS,
            frames=4_000_000,
        ),
    )
}


def draw_starts(rng: np.random.Generator, count: int, split: Split = "training") -> Points:
    """Where episodes of a split begin, at rest. [n, 2]"""
    drawn, missing = [np.zeros((0, 2))], count
    while missing:
        starts = np.array(centre(*START)) + rng.uniform(-NOISE, NOISE, (missing, 2))
        drawn.append(starts[starts_of(starts, split)])
        missing -= len(drawn[-1])
    return np.concatenate(drawn)


def start_of(position: Points) -> dict[str, list[float]]:
    """A start as JSON. [2]"""
    return {"position": position.tolist()}


def position_of(start: Mapping[str, Any]) -> Points:
    """The position that `start_of` told. [2]

    Raises:
        KeyError, TypeError or ValueError: If no episode begins there.
    """
    position: Points = np.array(start["position"], np.float64)
    if position.shape != (2,) or not (np.abs(position - centre(*START)) <= NOISE + _ROUNDED).all():
        raise ValueError("no start of a maze")
    return position


def starts_of(starts: Points, split: Split) -> Bools:
    """Whether starts belong to a split, by the square of side `SQUARE` that each lies in. [n, 2] -> [n]"""
    corner = np.array(centre(*START)) - NOISE
    return belongs(((starts - corner) // SQUARE).astype(np.intp), split)
