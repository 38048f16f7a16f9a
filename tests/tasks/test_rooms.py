"""Tasks of many rooms from files: what is told of them, what is drawn, and that it can be solved."""

import json
import re
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import given as drawn
from hypothesis import strategies as st

from paddlectl.errors import IntegrityError, InvalidFileError, PaddlectlError
from paddlectl.hybrid.settings import settings_for
from paddlectl.tasks.base import Defined
from paddlectl.tasks.files.rooms import DoorWords, RoomsFile, ThingWords
from paddlectl.tasks.naming import content, given, kept
from paddlectl.tasks.rooms import layouts
from paddlectl.tasks.rooms.env import RoomsEnv
from paddlectl.tasks.rooms.layouts import Ground
from paddlectl.tasks.rooms.plan import BLOCKING, Plan
from paddlectl.tasks.stock.tasks import PREDICATES, SUBGOALS
from paddlectl.tasks.stock.ways import NOWHERE, Map
from paddlectl.tasks.suite import load
from samples import ROOT
from wayfarer import follow_plan

PAGE = (ROOT / "docs" / "tasks.md").read_text(encoding="utf-8").partition("## More rooms\n")[2]
FILES = {name: text for name, text in re.findall(r"```yaml\n# mytasks/(\S+)\.yaml.*\n([^`]+)```", PAGE)}
TEXT = """\
rooms:
  - [start, middle]
  - [end, middle]
room_size: 5
agent: start
doors:
  - {near: start, far: middle, passage: locked, colour: red}
  - {near: middle, far: end, passage: locked, colour: blue}
things:
  - {thing: red key, room: start}
  - {thing: blue key, room: middle, box: grey}
  - {thing: goal, room: end}
target: goal
milestones: [gt_door]
"""
NESTED = """\
rooms:
  - [a, hall, c]
  - [b, hall, d]
room_size: 5
agent: hall
doors:
  - {near: hall, far: c, passage: locked, colour: red}
  - {near: hall, far: b, passage: locked, colour: blue}
  - {near: hall, far: a}
  - {near: hall, far: d, passage: locked, colour: green}
things:
  - {thing: red key, room: b}
  - {thing: blue key, room: a, box: grey}
  - {thing: green key, room: c}
  - {thing: purple ball, room: c}
target: purple ball
"""
DECOY = """\
rooms: [[a, b, c], [a, d, c]]
room_size: 4
agent: a
doors:
  - {near: a, far: b, passage: locked, colour: red}
  - {near: b, far: c}
  - {near: a, far: d, passage: locked, colour: blue, blocked: true}
  - {near: d, far: c, passage: open}
things:
  - {thing: blue key, room: a}
  - {thing: goal, room: c}
target: goal
"""
ONE_COLOUR = """\
rooms: [[a, b, c]]
room_size: 5
agent: a
doors:
  - {near: a, far: b, passage: locked, colour: red}
  - {near: b, far: c, passage: locked, colour: red, blocked: true}
things:
  - {thing: red key, room: a}
  - {thing: red key, room: c}
  - {thing: yellow ball}
  - {thing: blue box, room: c}
target: blue box
"""
TWINS = """\
rooms: [[a, b]]
agent: a
doors: [{near: a, far: b, passage: locked, colour: blue}]
things:
  - {thing: blue key, room: b}
  - {thing: blue key, room: a, box: grey}
  - {thing: red ball, room: b}
target: red ball
"""
ANYWHERE = """\
rooms: [[a, b, c, d], [e, f, g, h], [i, j, k, l]]
room_size: 5
connect: true
doors:
  - {near: [b, f], far: [c, g], passage: locked, colour: red}
  - {near: [f, j], far: [g, k], passage: locked, colour: blue}
  - {near: [c, g, k], far: [d, h, l], passage: locked, colour: green}
things:
  - {thing: red key}
  - {thing: blue key}
  - {thing: green key}
  - {thing: red ball}
  - {thing: grey box, behind: green}
target: grey box
"""


def written(folder: Path, text: str, name: str = "Rooms") -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def read(folder: Path, text: str) -> Defined:
    found = given(str(written(folder, text)))
    assert isinstance(found, Defined) and isinstance(found.spec, Plan)
    return found


def plan(folder: Path, text: str) -> Any:
    return read(folder, text).spec


def told(folder: Path, text: str) -> str:
    """What is said of a file, from the position on; in two seconds."""
    path, began = written(folder, text), time.process_time()
    with pytest.raises(InvalidFileError) as caught:
        given(str(path))
    assert time.process_time() - began < 2
    assert caught.value.message.startswith(f"{path}:")
    return caught.value.message.removeprefix(f"{path}:")


# What a file says


def test_a_plan_is_a_task_of_minigrids_own_domain(tmp_path: Path) -> None:
    task, stock = load(read(tmp_path, TEXT)), load("MiniGrid-KeyCorridorS3R1-v0")
    assert (task.name, task.summary, task.horizon) == ("Rooms", "Go to the goal.", 400)
    assert list(map(str, task.vocabulary.atoms)) == [
        *("has_key(agent)", "has_key(env)", "has_blockage(agent)", "is_open(door)", "is_blocked(door)")
    ]
    assert [str(subgoal) for subgoal in task.subgoals if str(subgoal) not in SUBGOALS] == []
    one, other = task.make(2, 0), stock.make(2, 0)
    for shared in ("observation_size", "flat_size", "actions"):
        assert getattr(one, shared) == getattr(other, shared)
    assert (task.domain, task.domain_subgoals) == (stock.domain, stock.domain_subgoals)
    assert settings_for(task).decisions == settings_for(stock).decisions


def test_one_locked_door_is_told_in_minigrids_own_words(tmp_path: Path) -> None:
    text = """\
rooms: [[a, b]]
agent: a
doors: [{near: a, far: b, passage: locked, colour: red}]
things: [{thing: red key, room: a}, {thing: green box, room: b}]
target: green box
"""
    ours, theirs = load(read(tmp_path, text)), load("MiniGrid-UnlockPickup-v0")
    assert set(ours.subgoals) == set(theirs.subgoals) and ours.horizon == theirs.horizon
    assert set(ours.vocabulary.atoms) == set(theirs.vocabulary.atoms)


def test_rooms_without_doors_have_a_fact(tmp_path: Path) -> None:
    text = "rooms: [[a, a]]\nthings: [{thing: goal}]\ntarget: goal\n"
    assert plan(tmp_path, text).facts == ("is_open(way)",)
    assert follow_plan(load(read(tmp_path, text)), 8, 0) == 8


BALL = "  - {thing: red ball, room: start}\n"
# (text to replace, with what, what is told from the position on)
MISTAKES = [
    ("rooms:\n", "romos:\n", "1:1: unknown key 'romos'; did you mean 'rooms'?"),
    ("agent:", "agnt:", "5:1: unknown key 'agnt'; did you mean 'agent'?"),
    ("near: start,", "nera: start,", "7:6: unknown key 'nera'; did you mean 'near'?"),
    ("thing: goal", "goal: 1", "12:6: unknown key 'goal'; "),
    ("target: goal\n", "", "1:1: missing key 'target'"),
    ("near: start, ", "", "7:5: missing key 'near'"),
    ("  - [start, middle]\n  - [end, middle]\n", "", "1:7: rooms: must be a list"),
    ("\n  - [start, middle]\n  - [end, middle]", " 2x3", "1:8: rooms: must be a list; write [2x3]"),
    ("\n  - [start, middle]\n  - [end, middle]", " 1000x1000", "1:8: rooms: must be a list"),
    ("\n  - [start, middle]\n  - [end, middle]", " []", "1:8: rooms: must not be empty"),
    ("[end, middle]", "[]", "3:5: rooms.1: must not be empty"),
    ("[end, middle]", f"[{', '.join(f'r{n}' for n in range(11))}]", "3:5: rooms.1: has too many entries"),
    ("  - [end, middle]\n", "  - [end, middle]\n" * 10, "2:3: rooms: has too many entries"),
    ("[end, middle]", "[end]", "3:5: a row of 1 room, where the first has 2"),
    ("[end, middle]", "[end, a b]", "3:11: no room is called 'a b' (letters, digits, _ and -, a letter"),
    ("[end, middle]", "[end, 'null']", "3:11: no room is called 'null'"),
    ("[end, middle]", "[end, 7]", '3:11: rooms.1.1: must be a text; write "7"'),
    ("[end, middle]", "[middle, end]", "3:6: another middle lies elsewhere; rooms of one name are one, side"),
    ("room_size: 5", "room_size: 2", "4:12: room_size: input should be greater than or equal to 3"),
    ("room_size: 5", "room_size: 0", "4:12: room_size: input should be greater than or equal to 3"),
    ("room_size: 5", "room_size: 10000000000", "4:12: room_size: input should be less than or equal to 25"),
    ("room_size: 5", "room_size: 5.5", "4:12: room_size: must be a whole number"),
    ("agent: start", "agent: strat", "5:8: unknown room 'strat'; did you mean 'start'?"),
    ("agent: start", "agent: [start, start]", "5:16: 'start' stands twice in agent"),
    ("agent: start", "agent: 3", "5:8: agent: must be a list"),
    ("near: start", "near: []", "7:12: doors.0.near: must not be empty"),
    ("far: end", "far: [end, edn]", "8:31: unknown room 'edn'; did you mean 'end'?"),
    ("far: end", "far: middle", "8:25: middle doesn't lie beside middle"),
    ("passage: locked, colour: red", "passage: loked", "7:41: unknown passage 'loked'; did you mean 'loc"),
    ("passage: locked, colour: red", "colour: red", "7:40: only a locked door has a colour, that of its key"),
    ("passage: locked, colour: red", "passage: locked", "7:5: a locked door has the colour of its key"),
    ("colour: red", "colour: rad", "7:57: unknown colour 'rad'; did you mean 'red'?"),
    ("colour: red", "colour: grey", "7:57: grey are the doors that aren't locked; take another"),
    ("colour: red", "colour: red, blocked: 1", "7:71: doors.0.blocked: must be true or false"),
    ("thing: red key", "thing: red kye", "10:13: unknown thing 'red kye'; did you mean 'red key'?"),
    ("thing: red key, room: start", "thing: goal, room: start", "13:9: 2 things are a goal; the target is"),
    ("room: start}", "room: start, behind: red}", "10:43: it lies in a room or behind a door; write one"),
    ("room: start}", "behind: rad}", "10:30: unknown locked door 'rad'; did you mean 'red'?"),
    ("colour: blue}\nthings:\n", "colour: red}\nthings:\n  - {thing: blue ball, behind: red}\n",
     "10:32: 2 locked doors are red; write room: instead"),
    ("box: grey", "box: gray", "11:42: unknown colour 'gray'; did you mean 'grey'?"),
    ("thing: goal,", "thing: goal, box: grey,", "12:24: only a key that isn't the target can be in a box"),
    ("target: goal", "target: gaol", "13:9: unknown target 'gaol'; did you mean 'goal'?"),
    ("target: goal", "target: red key", "12:13: a goal ends the episode; write target: goal, or leave"),
    ("target: goal", "target: goal\nhorizon: 0", "14:10: horizon: input should be greater than or"),
    ("target: goal", "target: goal\nhorizon: 1e9", "14:10: horizon: input should be less than or equal to"),
    ("[gt_door]", "[gt_dor]", "14:14: unknown subgoal 'gt_dor'; did you mean 'gt_door'?"),
    ("[gt_door]", "[gt_door, gt_door()]", "14:23: 'gt_door' stands twice in milestones"),
    ("[gt_door]", "[gt_passage]", "14:14: gt_passage needs a closed door, or connect: true"),
    ("[gt_door]", "[put_key]", "14:14: put_key holds at the start already, so it is no milestone"),
    ("[gt_door]", "[gt_door]\nfacts: [is_open(dor)]", "15:9: unknown fact 'is_open(dor)'; did you mean"),
    ("[gt_door]", "[gt_door]\nfacts: [is_open(way)]", "15:9: is_open(way) needs a closed door, or connect"),
    ("[gt_door]", "[gt_door]\nsubgoals: [gt_key, gt_goal]", "14:14: gt_door isn't among the subgoals; write"),
    ("[gt_door]", "[gt_door]\nsubgoals: [gt_key, gt_door]", "15:11: gt_goal solves the task; write it there"),
    ("rooms:\n", "name: BoxDoor\nrooms:\n", "1:7: there is a task BoxDoor without this file; give"),
    ("rooms:\n", 'summary: "\\e[2J"\nrooms:\n', "1:10: summary: must be one line of plain text"),
    ("rooms:\n", "near: [key]\nrooms:\n", "1:1: unknown key 'near'; "),
    ("room: start}", "room: middle}",
     "13:9: goal can't be reached: the red door never opens, as the red key is beyond what can be reached"),
    ("thing: red key", "thing: green key",
     "13:9: goal can't be reached: the red door never opens, as there is no red key"),
    ("far: end, passage: locked, colour: blue", "far: start", "8:5: no wall is left for it between near"),
    ("  - {near: middle, far: end, passage: locked, colour: blue}\n", "",
     "12:9: goal can't be reached: no way leads there from the agent"),
    ("room: middle, box: grey}", "behind: blue}",
     "13:9: goal can't be reached: the blue door never opens, as the blue key is beyond what can be reached"),
    ("room: start}\n", f"room: start}}\n{BALL * 9}", "19:5: no cell of start is free for the red ball"),
    ("room: start}\n", f"room: start}}\n{BALL * 400}", "10:3: things: has too many entries"),
    ("room_size: 5", "room_size: 3", "5:8: no cell is free where the agent is to start"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), MISTAKES)
def test_mistakes_are_told_where_they_stand(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in TEXT
    assert told(tmp_path, TEXT.replace(old, new, 1)).startswith(expected)


def test_too_large_a_grid_is_told_at_once(tmp_path: Path) -> None:
    rows = "".join(f"  - [{', '.join(f'r{y}-{x}' for x in range(10))}]\n" for y in range(10))
    text = f"rooms:\n{rows}room_size: SIZE\nconnect: true\nthings: [{{thing: goal}}]\ntarget: goal\n"
    expected = "12:12: a grid of 61 x 61 cells; 2,500 are the most; write fewer rooms, or a smaller room_size"
    assert told(tmp_path, text.replace("SIZE", "7")) == expected
    began = time.process_time()
    assert plan(tmp_path, text.replace("SIZE", "5")).horizon == 10_000
    assert time.process_time() - began < 2


def test_too_few_layouts_are_told(tmp_path: Path) -> None:
    text = "rooms: [[a, b]]\nroom_size: 3\nagent: a\ndoors: [{near: a, far: b}]\nthings: [{thing: goal}]\n"
    assert told(tmp_path, f"{text}target: goal\n").startswith("1:8: hardly two layouts differ, so none is")


# What is drawn


LIKE_MINIGRIDS = {
    "MiniGrid-KeyCorridorS3R3-v0": (FILES["KeyHall"], 0),
    "MiniGrid-ObstructedMaze-2Dlh-v0": (FILES["BoxMaze"], 1),
    "MiniGrid-ObstructedMaze-1Dlhb-v0": (
        "rooms: [[a, b]]\nagent: a\ntarget: blue ball\n"
        "doors: [{near: a, far: b, passage: locked, colour: red, blocked: true}]\n"
        "things: [{thing: red key, room: a, box: grey}, {thing: blue ball, room: b}]\n",
        0,
    ),
    "MiniGrid-UnlockPickup-v0": (
        "rooms: [[a, b]]\nagent: a\ntarget: green box\n"
        "doors: [{near: a, far: b, passage: locked, colour: red}]\n"
        "things: [{thing: red key, room: a}, {thing: green box, room: b}]\n",
        0,
    ),
}


def kind_of(env: Any, step: int, first: int) -> tuple[Any, ...]:
    """What is where in a layout, by rows and columns of rooms, and which key fits which door."""

    def room(x: int, y: int) -> tuple[int, int]:
        return y // step, x // step + first

    found, doors = [], Counter[str]()
    cells = [(x, y) for x in range(env.width) for y in range(env.height)]
    there = {place: env.grid.get(*place) for place in cells if env.grid.get(*place) is not None}
    locks = {each.color: place for place, each in there.items() if each.type == "door" and each.is_locked}
    for place, each in there.items():
        if each.type == "door":
            doors["locked" if each.is_locked else "closed"] += 1
        elif each.type != "wall":
            held = each.contains or each
            fits = room(*locks[held.color]) if held.type == "key" else None
            x, y = place
            before = any((x + dx, y + dy) in locks.values() for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)))
            blocks = each.type == "ball" and each is not env.obj and before
            found.append((each.type, held.type, room(*place), fits, each is env.obj, blocks))
    _, column = room(*env.agent_pos)
    return tuple(sorted(map(str, found))), doors["locked"], column


@pytest.mark.parametrize("name", LIKE_MINIGRIDS)
def test_layouts_are_of_the_kinds_that_minigrid_draws(name: str, tmp_path: Path) -> None:
    text, first = LIKE_MINIGRIDS[name]
    theirs: Any = gymnasium.make(name, disable_env_checker=True).unwrapped
    ours, step = RoomsEnv(plan(tmp_path, text)), theirs.room_size - 1
    kinds: list[set[Any]] = [set(), set()]
    closed: list[set[int]] = [set(), set()]
    for env, kind, many, moved in zip((ours, theirs), kinds, closed, (first, 0), strict=True):
        for seed in range(100):
            env.reset(seed=seed)
            kind.add(kind_of(env, step, moved))
            shut = [cell for cell in env.grid.grid if cell is not None and cell.type == "door"]
            many.add(len([door for door in shut if not door.is_locked]))
    assert kinds[0] == kinds[1]
    assert min(closed[0]) == min(closed[1]) and abs(max(closed[0]) - max(closed[1])) <= 2


@pytest.mark.parametrize("text", [*FILES.values(), ANYWHERE], ids=[*FILES, "Anywhere"])
def test_no_layout_for_evaluation_is_drawn_in_training(text: str, tmp_path: Path) -> None:
    """Whatever their seeds; an eighth of all drawn ones are for evaluation."""
    ground, rng = Ground(plan(tmp_path, text)), np.random.default_rng(1)
    values: dict[str, set[Any]] = {"training": set(), "evaluation": set()}
    for split, seen in values.items():
        for _ in range(60):
            layout = ground.drawn_of(split, rng)  # type: ignore[arg-type]
            seen.add((layout.agent, tuple(sorted(layout.items.items()))))
    assert not values["training"] & values["evaluation"] and len(values["evaluation"]) > 2
    env: Any = load(read(tmp_path, text)).make(4, 0, 1, "evaluation")
    assert {lane.unwrapped.split for lane in env._lanes} == {"evaluation"}


def test_every_layout_can_be_solved_and_keeps_cells_beside_doors_free(tmp_path: Path) -> None:
    ground, rng = Ground(plan(tmp_path, ANYWHERE)), np.random.default_rng(0)
    for _ in range(50):
        layout = ground.drawn_of("training", rng)
        assert ground.reached(layout) >> layout.target & 1
        doors = {cell for cell, item in layout.items.items() if item.is_door}
        beside = {cell + step for cell in doors for step in (1, -1, ground.width, -ground.width)}
        assert not beside & (layout.items.keys() - doors)


def test_a_task_without_layouts_of_a_split_ends_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that was kept by another version may be."""
    monkeypatch.setattr(layouts, "TRIES", 100)
    ground = Ground(plan(tmp_path, TEXT))
    ground.reached = lambda layout: 0  # type: ignore[method-assign]
    with pytest.raises(PaddlectlError, match="Rooms has hardly a layout for training"):
        ground.drawn_of("training", np.random.default_rng(0))


# How it is told


@pytest.mark.parametrize(
    "text",
    [*FILES.values(), TEXT, NESTED, DECOY, ONE_COLOUR, TWINS, ANYWHERE],
    ids=[*FILES, "Text", "Nested", "Decoy", "OneColour", "Twins", "Anywhere"],
)
def test_its_facts_lead_a_plan_to_success(text: str, tmp_path: Path) -> None:
    assert follow_plan(load(read(tmp_path, text)), 12, 0) >= 11


def test_the_door_is_the_one_whose_key_can_be_had(tmp_path: Path) -> None:
    env = RoomsEnv(plan(tmp_path, NESTED))
    env.reset(seed=0)
    doors = {each.color: cell for cell, each in enumerate(env.grid.grid) if each and each.type == "door"}
    boxes = [cell for cell, each in enumerate(env.grid.grid) if each and each.type == "box"]
    x, y = env.agent_pos
    facts = Map(env).facts(int(y) * env.width + int(x))
    assert (facts.door, facts.key, [facts.box]) == (doors["blue"], NOWHERE, boxes)
    env = RoomsEnv(plan(tmp_path, DECOY))
    for seed in range(5):
        env.reset(seed=seed)
        x, y = env.agent_pos
        door = Map(env).facts(int(y) * env.width + int(x)).door
        assert env.grid.grid[door].color == "blue"


def test_a_door_that_was_opened_is_reached_though_another_is_locked(tmp_path: Path) -> None:
    """Else the low level would be blamed for what it was to do."""
    env = RoomsEnv(plan(tmp_path, TEXT))
    env.reset(seed=0)
    cells = {each.color: (n, each) for n, each in enumerate(env.grid.grid) if each and each.type == "door"}
    key = next(n for n, each in enumerate(env.grid.grid) if each and each.type == "key")
    env.carrying = env.grid.grid[key]
    env.grid.grid[key] = None
    reached = SUBGOALS["gt_door()"].reached
    assert not reached(env._view()) and env._view().facts.key_held
    cells["red"][1].toggle(env, None)
    after = env._view()
    assert reached(after) and not after.facts.opened and after.facts.door == cells["blue"][0]
    assert after.facts.other_held and not after.facts.key_held


def test_a_blockage_is_what_can_be_come_to(tmp_path: Path) -> None:
    """A ball behind the closed door isn't in the way yet."""
    text = "rooms: [[a, b]]\nagent: b\ndoors: [{near: a, far: b, blocked: true}]\n"
    env = RoomsEnv(plan(tmp_path, f"{text}things: [{{thing: goal, room: a}}]\ntarget: goal\n"))
    env.reset(seed=0)
    facts = env._view().facts
    assert (facts.blocked, facts.clear) == (False, False)
    next(each for each in env.grid.grid if each and each.type == "door").is_open = True
    facts = env._view().facts
    assert facts.clear and env.grid.grid[facts.blockage].type in BLOCKING


def test_it_pays_and_shows_as_its_lanes_do(tmp_path: Path) -> None:
    """The environment that is stepped alone, beside one lane, and a mirror of it."""
    found = read(tmp_path, FILES["TwoLocks"])
    task = load(found)
    own, mirror = (task.make(1, 3) for _ in range(2))
    env: Any = gymnasium.make("paddlectl.tasks.registration:paddle/File-v0", task=found.spec).unwrapped
    env.reset(seed=int(own.seeds[0]))  # type: ignore[attr-defined]
    rng, paid, subgoals = np.random.default_rng(0), 0.0, np.arange(len(SUBGOALS))[:, None]
    for t in range(300):
        env.mirror_in(mirror)
        for ask in ("valuation", "flat_state"):
            np.testing.assert_array_equal(getattr(own, ask)(), getattr(mirror, ask)())
        for ask in ("observe", "reached", "available"):
            for number in subgoals if t % 10 == 0 else ():
                np.testing.assert_array_equal(getattr(own, ask)(number), getattr(mirror, ask)(number))
        action = int(rng.choice(6, p=[0.1, 0.15, 0.3, 0.2, 0.05, 0.2]))
        step, (_, reward, terminated, truncated, more) = own.step(np.array([action])), env.step(action)
        assert (step.terminated[0], step.truncated[0]) == (terminated, truncated)
        assert (step.reward[0], step.score[0]) == pytest.approx((reward, more["score"]))
        paid += reward
        if terminated or truncated:
            break
    assert paid >= 0.1


# As it is kept


@pytest.mark.parametrize("text", [*FILES.values(), NESTED], ids=[*FILES, "Nested"])
def test_what_is_kept_is_the_same_task(text: str, tmp_path: Path) -> None:
    task = read(tmp_path, text)
    name, definition = content(task)
    assert kept(name, json.loads(json.dumps(definition))) == task
    other = read(tmp_path, text.replace("red", "green").replace("room_size: 3", "room_size: 4"))
    assert other != task and content(other).identity != content(task).identity


@pytest.mark.parametrize(
    "changes",
    [
        {"rooms": []},
        {"rooms": [["a"], ["b", "c"]]},
        {"room_size": 99},
        {"things": [{"thing": "dragon"}]},
        {"more": 1},
        {"target": "blue ball"},
        {"doors": [{"near": ["start"], "far": ["end"], "passage": "\x1b[2J"}]},
    ],
)
def test_what_is_kept_is_checked(tmp_path: Path, changes: dict[str, object]) -> None:
    _, definition = content(read(tmp_path, TEXT))
    with pytest.raises(IntegrityError):
        kept("Rooms", {**(definition or {}), **changes})


# Any file


@st.composite
def files(draw: Any) -> dict[str, Any]:
    """Files whose words make sense, mostly."""
    rows, columns = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    rooms = [[f"r{y}{x}" for x in range(columns)] for y in range(rows)]
    if draw(st.booleans()):
        rooms = [["hall", *row[1:]] for row in rooms]
    names = st.sampled_from(sorted({name for row in rooms for name in row}))
    some = st.lists(names, min_size=1, max_size=3, unique=True)
    pairs = [(a, b) for row in rooms for a, b in pairwise(row)]
    pairs += [(a, b) for one, two in pairwise(rooms) for a, b in zip(one, two, strict=True)]
    sides = [pair[::turn] for pair in pairs for turn in (1, -1) if pair[0] != pair[1]]
    found: dict[str, Any] = {"rooms": rooms, "room_size": draw(st.integers(3, 6)), "doors": [], "things": []}
    for near, far in draw(st.lists(st.sampled_from(sides), max_size=4)) if sides else ():
        passage = draw(st.sampled_from(["locked", "locked", "closed", "open"]))
        colour = {"colour": draw(st.sampled_from(["red", "blue"]))} if passage == "locked" else {}
        blocked = draw(st.booleans())
        found["doors"].append({"near": near, "far": far, "passage": passage, **colour, "blocked": blocked})
    kinds = st.sampled_from(["red key", "blue key", "purple key", "yellow ball", "grey box"])
    target = draw(st.sampled_from(["goal", "blue ball", "red box", "green key"]))
    for what in [*draw(st.lists(kinds, max_size=4)), target]:
        colours = [door["colour"] for door in found["doors"] if "colour" in door]
        where: dict[str, Any] = draw(st.sampled_from([{}, {"room": draw(some)}]))
        if colours and draw(st.integers(0, 3)) == 0:
            where = {"behind": draw(st.sampled_from(colours))}
        box = {"box": "grey"} if what.endswith("key") and what != target and draw(st.booleans()) else {}
        found["things"].append({"thing": what, **where, **box})
    more = {
        "agent": some,
        "connect": st.booleans(),
        "milestones": st.lists(st.sampled_from([*SUBGOALS]), max_size=2),
        "facts": st.lists(st.sampled_from([*PREDICATES]), max_size=3),
        "horizon": st.integers(0, 500),
    }
    kept = {key: draw(values) for key, values in more.items() if draw(st.integers(0, 2)) == 0}
    return {**found, "target": target, **kept}


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@drawn(files())
def test_any_file_is_refused_with_a_place_or_can_be_played(tmp_path: Path, document: dict[str, Any]) -> None:
    path, began = written(tmp_path, json.dumps(document, indent=1)), time.process_time()
    try:
        task = given(str(path))
    except InvalidFileError as error:
        assert re.match(rf"{path}:\d+:\d+: \S", error.message)
        return
    finally:
        assert time.process_time() - began < 2
    name, definition = content(task)
    again = kept(name, json.loads(json.dumps(definition)))
    assert again == task and content(again) == content(task)
    rng = np.random.default_rng(0)
    for split in ("training", "evaluation"):
        batch = load(task).make(1, 0, 1, split)  # type: ignore[arg-type]
        for _ in range(100):
            step = batch.step(rng.choice(7, p=[0.1, 0.15, 0.3, 0.15, 0.1, 0.15, 0.05], size=1))
            batch.valuation()
            assert np.isfinite(batch.observe(rng.integers(len(SUBGOALS), size=1))).all()
            assert np.isfinite(batch.flat_state()).all()
            batch.reset(step.terminated | step.truncated)


# The page


def test_the_page_has_every_key_and_word_and_no_other() -> None:
    tables: dict[str, set[str]] = {}
    for head, rows in re.findall(r"^\| ([\w ]+) \|.*\n\|[-|]+\|\n((?:\|.*\n)+)", PAGE, re.MULTILINE):
        tables[head] = set(re.findall(r"^\| `([^`]+)` \|", rows, re.MULTILINE))
    above = {"name", "summary", "milestones", "facts", "subgoals"}
    assert tables == {
        "key": set(RoomsFile.model_fields) - above,
        "door": set(DoorWords.model_fields),
        "of a thing": set(ThingWords.model_fields),
        "fact": set(PREDICATES),
        "subgoal": {subgoal.removesuffix("()") for subgoal in SUBGOALS},
    }


def test_the_page_tells_what_is_told(tmp_path: Path) -> None:
    text = FILES["TwoLocks"].replace("red key, room: start", "red key, room: middle")
    said = told(tmp_path, f"# mytasks/TwoLocks.yaml\n{text}")
    assert f"error: mytasks/TwoLocks.yaml:{said}\n" in PAGE
