"""A task of several rooms as data, and the facts and subgoals that it allows."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

COLOURS = ("blue", "green", "grey", "purple", "red", "yellow")
"""MiniGrid's."""

UNLOCKED = "grey"
"""The colour of all doors that aren't locked."""

BLOCKING = "green ball"
"""What stands before a blocked door."""

GOAL = "goal"
THINGS = (*(f"{colour} {kind}" for kind in ("key", "ball", "box") for colour in COLOURS), GOAL)
PASSAGES = ("locked", "closed", "open")


@dataclass(frozen=True)
class Door:
    """A door between two rooms that lie side by side; where there are several such pairs, one is drawn.

    Attributes:
        near: Rooms that it may lead from.
        far: Rooms that it may lead to.
        passage: One of PASSAGES.
        colour: Of a locked one, that of its key.
        blocked: A ball stands before it, in the near room.
    """

    near: tuple[str, ...]
    far: tuple[str, ...]
    passage: str
    colour: str
    blocked: bool

    def document(self) -> dict[str, Any]:
        told: dict[str, Any] = {"near": list(self.near), "far": list(self.far), "passage": self.passage}
        colour = {"colour": self.colour} if self.passage == "locked" else {}
        return {**told, **colour, "blocked": self.blocked}


@dataclass(frozen=True)
class Thing:
    """What lies in a room.

    Attributes:
        what: One of THINGS.
        room: Rooms of which one is drawn; empty if it may be any.
        behind: The colour of the locked door that leads to its room instead; empty if none does.
        box: The colour of the box that holds it; empty if none does.
    """

    what: str
    room: tuple[str, ...]
    behind: str
    box: str

    def document(self) -> dict[str, Any]:
        told = {"room": list(self.room), "behind": self.behind, "box": self.box}
        return {"thing": self.what, **{key: value for key, value in told.items() if value}}


@dataclass(frozen=True)
class Plan:
    """A task of several rooms (`tasks.base.Definition`).

    Attributes:
        name: As typed on the command line.
        summary: One line for a reader.
        rooms: A name for each room, row by row; rooms of one name are one, without walls between them.
        room_size: Cells along a side of a room, its walls among them.
        agent: Rooms of which the agent starts in one; empty if it may be any.
        connect: Closed doors are added until each room can be reached.
        target: The thing that is to be picked up, or the goal.
        milestones: Subgoals that pay once an episode, when they first hold.
        horizon: Steps after which an episode is truncated.
        facts: The vocabulary, in order.
        subgoals: The subgoals that programs may name.
    """

    MADE_BY: ClassVar = "paddlectl.tasks.rooms.task:task_of"
    ENVIRONMENT: ClassVar = "paddlectl.tasks.rooms.env:RoomsEnv"

    name: str
    summary: str = field(compare=False)
    rooms: tuple[tuple[str, ...], ...]
    room_size: int
    agent: tuple[str, ...]
    doors: tuple[Door, ...]
    connect: bool
    things: tuple[Thing, ...]
    target: str
    milestones: tuple[str, ...]
    horizon: int
    facts: tuple[str, ...]
    subgoals: tuple[str, ...]

    @property
    def mission(self) -> str:
        """What is to be done, in MiniGrid's own words."""
        return mission_of(self.target)

    def document(self) -> dict[str, Any]:
        """All that a task file may say of it, nothing left to be filled in."""
        return {
            "name": self.name,
            "summary": self.summary,
            "rooms": [list(row) for row in self.rooms],
            "room_size": self.room_size,
            "agent": list(self.agent),
            "doors": [door.document() for door in self.doors],
            "connect": self.connect,
            "things": [thing.document() for thing in self.things],
            "target": self.target,
            "milestones": [subgoal.removesuffix("()") for subgoal in self.milestones],
            "horizon": self.horizon,
            "facts": list(self.facts),
            "subgoals": [subgoal.removesuffix("()") for subgoal in self.subgoals],
        }


def mission_of(target: str) -> str:
    """What is to be done, in MiniGrid's own words."""
    return "go to the goal" if target == GOAL else f"pick up the {target}"


class Need(NamedTuple):
    """What has to be somewhere for a fact or a subgoal to make sense.

    Attributes:
        told: What it is, for a reader.
        met: Whether it is there.
    """

    told: str
    met: bool


def needs(doors: Sequence[Door], connect: bool, things: Sequence[Thing], target: str) -> dict[str, Need]:
    """Of each fact and subgoal of the domain (`tasks.stock.tasks`)."""
    passages = {door.passage for door in doors}
    loose = [thing for thing in things if thing.what not in (GOAL, target)]
    boxed = any(thing.box or thing.what.endswith(" box") for thing in loose)
    locks = {f"{door.colour} key" for door in doors if door.passage == "locked"}
    crowded = len(loose) > 1 or any(door.blocked for door in doors)
    crowded |= any(thing.what not in locks for thing in loose)
    lock = Need("a locked door", "locked" in passages)
    shut = Need("a closed door, or connect: true", connect or "closed" in passages)
    box = Need("a box and a locked door", boxed and lock.met)
    several = Need("a blocked door, or a thing besides one key and the target", crowded)
    other = Need("a box, a blocked door, or a thing besides one key and the target", crowded or boxed)
    return {
        "has_key(agent)": lock,
        "has_key(env)": box,
        "has_blockage(agent)": other,
        "is_open(door)": lock,
        "is_blocked(door)": several,
        "is_open(way)": shut,
        "gt_blockage": several,
        "put_blockage": other,
        "gt_box": box,
        "gt_key": lock,
        "gt_door": lock,
        "put_key": lock,
        "gt_passage": shut,
        "gt_target": Need("a thing as target", target != GOAL),
        "gt_goal": Need("target: goal", target == GOAL),
    }
