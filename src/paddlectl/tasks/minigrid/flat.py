"""The whole state as one vector, the same for all tasks: what a learner without subgoals sees.

Nothing is left out that the hybrid model is told by its clauses and its observations. In order:

- 49: the 7 x 7 cells around the agent, row by row; 1 where it can't walk, also outside the grid
- 70: for each thing (key, box, blockage, ball, goal, yellow tile, red tile): on the grid, dx / 14, dy / 7,
  sign of dx, sign of dy, dx = 0, dy = 0, in the near room; in hand; in front of the agent
- 7: the passage: dx / 14, dy / 7, sign of dx, sign of dy, dy = 0; the agent is in the near room; it is open
- 2: the passage is in front; the cell in front is empty
- 8: facing and what is in hand (nothing, key, blockage, ball), one-hot
- 10: the facts that all body atoms follow from (`symbols.Fact`)
- 10: for each subgoal of the domain: it was paid as a milestone in this episode
- 1: time left, as a share of the horizon

Nothing is mirrored, for there is no target to mirror it by.
"""

import numpy as np

from paddlectl.tasks.base import Floats, Ints
from paddlectl.tasks.minigrid import symbols
from paddlectl.tasks.minigrid.grid import DELTA, WIDTH, Code, Codes, Held, Thing
from paddlectl.tasks.minigrid.layouts import HORIZON
from paddlectl.tasks.minigrid.observe import PASSAGE_IN_WORLD, RELATIVE_IN_WORLD, window_in_world

THINGS = tuple(thing for thing in Thing if thing < Thing.PASSAGE)
_RELATIVE = RELATIVE_IN_WORLD.shape[-1]
_OF_THING = _RELATIVE + 2
_BITS: Ints = np.arange(10)
FLAT_SIZE = 49 + _OF_THING * len(THINGS) + 7 + 2 + 4 + len(Held) + len(_BITS) + len(symbols.SUBGOALS) + 1
_IN_HAND: Ints = np.array([getattr(Held, thing.name, -1) for thing in THINGS])


def flat_state(
    grid: Codes,
    rows: Ints,
    agent: Ints,
    facing: Ints,
    held: Ints,
    where: Ints,
    facts: Ints,
    paid: Ints,
    t: Ints,
) -> Floats:
    """The vector of each state.

    Args:
        grid: Codes of the cells. [B, 120]
        rows: The grid's `observe.obstacle_rows`. [B, 14]
        agent: The agent's cell. [B]
        facing: Its direction. [B]
        held: What is in hand. [B]
        where: Cell of each thing, or ABSENT. [B, 9]
        facts: As `symbols.encode` has them. [B]
        paid: A bit for each subgoal of the domain that was paid as a milestone. [B]
        t: Steps since the start. [B]

    Returns:
        A new array. [B, FLAT_SIZE]
    """
    lanes = np.arange(len(agent))
    front = agent + DELTA.take(facing)
    things, passage = where[:, : len(THINGS)], where[:, Thing.PASSAGE]
    of_things = np.empty((len(agent), len(THINGS), _OF_THING), np.float32)
    of_things[..., :_RELATIVE] = RELATIVE_IN_WORLD[agent[:, None], things]
    of_things[..., _RELATIVE] = held[:, None] == _IN_HAND
    of_things[..., _RELATIVE + 1] = front[:, None] == things
    opened = grid[lanes, passage] == Code.OPEN
    return np.hstack(
        [
            window_in_world(rows, agent),
            of_things.reshape(len(agent), -1),
            PASSAGE_IN_WORLD[agent, passage // WIDTH, opened.astype(np.intp)],
            (front == passage)[:, None],
            (grid[lanes, front] == Code.EMPTY)[:, None],
            np.eye(4)[facing],
            np.eye(len(Held))[held],
            (facts[:, None] >> _BITS) & 1,
            (paid[:, None] >> np.arange(len(symbols.SUBGOALS))) & 1,
            1 - t[:, None] / HORIZON,
        ]
    ).astype(np.float32)
