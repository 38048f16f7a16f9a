"""MiniGrid's own environments that are tasks as they are, by their ids, and what each is told in.

Nothing but names is here, so looking for one imports no environment.
"""

from typing import NamedTuple

_UNLOCK = ("has_key(agent)", "is_open(door)")
_DOOR_KEY = ("gt_key()", "gt_door()", "gt_goal()")
_PICK_UP = ("gt_key()", "gt_door()", "put_key()", "gt_target()")
_MOVE = ("gt_blockage()", "put_blockage()")
_HELD, _BLOCKED, _SEEN, _WAY = (
    ("has_blockage(agent)",),
    ("is_blocked(door)",),
    ("has_key(env)",),
    ("is_open(way)",),
)


class Family(NamedTuple):
    """What the environments of a kind have in common.

    Attributes:
        summary: One line for a reader.
        atoms: The body atoms.
        subgoals: The subgoals.
    """

    summary: str
    atoms: tuple[str, ...]
    subgoals: tuple[str, ...]


DOOR_KEY = Family("Take the key, open the door, go to the green square.", _UNLOCK, _DOOR_KEY)
UNLOCK = Family("Take the key, open the door, pick up the box behind it.", _UNLOCK, _PICK_UP)
BLOCKED = Family(
    "Move the ball away, take the key, open the door, pick up the box behind it.",
    _UNLOCK + _HELD + _BLOCKED,
    _PICK_UP + _MOVE,
)
CORRIDOR = Family(
    "Find the key in another room, open the locked door, pick up the ball behind it.",
    _UNLOCK + _WAY,
    ("gt_passage()", *_PICK_UP),
)
MAZE_LOCKED = Family("Take the key, open the door, pick up the blue ball behind it.", _UNLOCK, _PICK_UP)
MAZE_TWO_KEYS = Family(
    "Take the right key of two, open its door, pick up the blue ball behind it.",
    _UNLOCK + _HELD,
    (*_PICK_UP, "put_blockage()"),
)
MAZE_HIDDEN = Family(
    "Open the box, take the key, open the door, pick up the blue ball behind it.",
    _UNLOCK + _HELD + _SEEN,
    ("gt_box()", *_PICK_UP, "put_blockage()"),
)
MAZE_BLOCKED = Family(
    "Move the ball away, open the box, take the key, open the door, pick up the blue ball behind it.",
    _UNLOCK + _HELD + _SEEN + _BLOCKED,
    ("gt_box()", *_PICK_UP, *_MOVE),
)

FAMILIES: dict[str, tuple[Family, int]] = {
    **{f"MiniGrid-DoorKey-{n}x{n}-v0": (DOOR_KEY, 10 * n * n) for n in (5, 6, 8, 16)},
    "MiniGrid-UnlockPickup-v0": (UNLOCK, 288),
    "MiniGrid-BlockedUnlockPickup-v0": (BLOCKED, 576),
    **{f"MiniGrid-KeyCorridorS3R{rows}-v0": (CORRIDOR, 270) for rows in (1, 2, 3)},
    "MiniGrid-KeyCorridorS4R3-v0": (CORRIDOR, 480),
    "MiniGrid-ObstructedMaze-1Dl-v0": (MAZE_LOCKED, 288),
    "MiniGrid-ObstructedMaze-1Dlh-v0": (MAZE_HIDDEN, 288),
    "MiniGrid-ObstructedMaze-1Dlhb-v0": (MAZE_BLOCKED, 288),
    "MiniGrid-ObstructedMaze-2Dl-v0": (MAZE_TWO_KEYS, 576),
    "MiniGrid-ObstructedMaze-2Dlh-v0": (MAZE_HIDDEN, 576),
    "MiniGrid-ObstructedMaze-2Dlhb-v1": (MAZE_BLOCKED, 576),
}
"""The environment's id -> its family, and the steps after which MiniGrid itself truncates its episodes."""
