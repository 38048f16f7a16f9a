"""How short a policy can be that takes its subgoals one after another, each by a shortest way.

The lower bound of a mean length is the planner's. A program's low level minds one subgoal at a time, so it
ends above that bound even when it wastes no step; this prints by how much, for the sensible orders of
subgoals. Of the ends of equally short ways one is drawn at random.

    python benchmarks/greedy_lengths.py --layouts 200
"""

import argparse
import random
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from paddlectl.experiments.policies import EVALUATION_SEED
from paddlectl.tasks import suite
from paddlectl.tasks.minigrid.grid import ABSENT, Held
from paddlectl.tasks.minigrid.layouts import SPECS, Layouts

sys.path.append(str(Path(__file__).parent.parent / "tests"))
from planner import State, World, shortest_plan

ORDERS = {
    "BlockedDoor": ["gt_blockage put_blockage gt_key gt_door"],
    "GapBall": ["gt_box gt_key put_key gt_ball"],
    "DoorBall": ["gt_key gt_door put_key gt_ball"],
    "OpenGoal": ["gt_door gt_goal"],
    "BoxDoor": ["gt_box gt_key gt_door"],
    "BlockedBoxUnlockPickup": [
        "gt_box gt_blockage put_blockage gt_key gt_door put_key gt_ball",
        "gt_blockage put_blockage gt_box gt_key gt_door put_key gt_ball",
    ],
}


def reached(world: World, state: State, subgoal: str) -> bool:
    things = {state.key, state.box, state.blockage, state.ball}
    clear = things.isdisjoint({world.passage - 1, world.passage + 1})
    return {
        "gt_blockage": state.held == Held.BLOCKAGE,
        "put_blockage": state.held != Held.BLOCKAGE and clear,
        "gt_box": state.box == ABSENT,
        "gt_key": state.held == Held.KEY,
        "gt_door": state.opened,
        "put_key": state.held != Held.KEY and state.key != ABSENT and clear,
        "gt_ball": state.held == Held.BALL,
        "gt_goal": state.agent == world.goal,
    }[subgoal]


def shortest_way(world: World, start: State, subgoal: str, rng: random.Random) -> tuple[int, State]:
    """Steps to the subgoal with nothing else picked up, put down or opened, and where they end."""
    front, seen, steps = [start], {start}, 0
    while True:
        ends = [state for state in front if reached(world, state, subgoal)]
        if ends:
            return steps, rng.choice(ends)
        front = list(_walked(world, front, subgoal, seen))
        steps += 1


def _walked(world: World, front: list[State], subgoal: str, seen: set[State]) -> Iterator[State]:
    for state in front:
        for _, successor in world.successors(state):
            kept = (successor.held, successor.opened, successor.box) == (state.held, state.opened, state.box)
            if successor not in seen and (kept or reached(world, successor, subgoal)):
                seen.add(successor)
                yield successor


def greedy_length(world: World, subgoals: list[str], rng: random.Random) -> int:
    state, total = world.start, 0
    for subgoal in subgoals:
        steps, state = shortest_way(world, state, subgoal, rng)
        total += steps
    return total


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--layouts", type=int, default=200, help="how many of those of an evaluation")
    count = parser.parse_args().layouts
    rng = random.Random(0)
    for task, orders in ORDERS.items():
        state = suite.load(task).make(count, EVALUATION_SEED, 1, "evaluation").state
        layouts = Layouts(state.agent, state.facing, state.where)
        shortest = np.mean([len(shortest_plan(SPECS[task], layouts, lane)) for lane in range(count)])
        for order in orders:
            worlds = (World(SPECS[task], layouts, lane) for lane in range(count))
            length = np.mean([greedy_length(world, order.split(), rng) for world in worlds])
            ratio = length / shortest
            print(f"{task}: shortest {shortest:.2f}, one by one {length:.2f}, {ratio:.2f} x: {order}")


if __name__ == "__main__":
    main()
