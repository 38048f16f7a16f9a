"""Recorded episodes: whoever plays them again comes through the same states to the same end."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from paddlectl.agents import recording
from paddlectl.agents.base import Episode, Player
from paddlectl.agents.interaction import Interaction
from paddlectl.agents.recording import Choice, Recorder
from paddlectl.errors import IntegrityError, PaddlectlError
from paddlectl.experiments.recordings import played_again, recordings_document
from paddlectl.hybrid.settings import settings_for
from paddlectl.tasks import suite
from paddlectl.tasks.base import Environment, Step, Task
from paddlectl.tasks.maze2d import layouts as maze2d
from paddlectl.tasks.minigrid import layouts as minigrid
from paddlectl.tasks.naming import given
from samples import ROOT

LANES = 2
TASKS = (
    *minigrid.SPECS, *maze2d.SPECS, "MiniGrid-DoorKey-5x5-v0", "MiniGrid-KeyCorridorS3R1-v0",
    "MiniGrid-ObstructedMaze-1Dlhb-v0",
)  # fmt: skip


class Wanderer(Player):
    """Acts at random, and remembers through which states each lane came."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)
        self.ended: list[tuple[int, list[bytes]]] = []
        self.passed: list[list[bytes]] = [[] for _ in range(LANES)]

    def act(self, environment: Environment) -> Any:
        actions: Any = environment.actions.sample(self.rng, LANES)
        if not environment.actions.continuous:
            actions = np.where(self.rng.random(LANES) < 0.5, 2 % environment.actions.size, actions)
        return actions

    def observe(self, environment: Environment, step: Step) -> None:
        states = environment.flat_state()
        for lane in range(LANES):
            self.passed[lane].append(states[lane].tobytes())
        for lane in np.flatnonzero(step.terminated | step.truncated):
            self.ended.append((int(environment.t[lane]), self.passed[lane]))
            self.passed[lane] = []


def wandered(task: Task, repeat: int) -> tuple[Wanderer, dict[str, Any], list[Episode]]:
    """So many episodes as there are lanes."""
    environment, player = task.make(LANES, 5, repeat), Wanderer()
    recorder = Recorder(environment, task.horizon)
    interaction, episodes = Interaction(environment, player, recorder), []
    while len(episodes) < LANES:
        episodes += interaction.run(1)
    told = json.loads(json.dumps(recordings_document(task, repeat, recorder.kept)))
    return player, told, episodes


@pytest.mark.parametrize("name", [*TASKS, "mytasks/BoxMaze.yaml"])
def test_an_episode_comes_through_the_same_states_again(name: Any, tmp_path: Path) -> None:
    if name not in TASKS:  # one of docs/tasks.md
        text = re.search(rf"```yaml\n# {name}.*\n([^`]+)```", (ROOT / "docs/tasks.md").read_text("utf-8"))
        assert text is not None
        (tmp_path / "BoxMaze.yaml").write_text(text[1])
        name = given("BoxMaze.yaml", tmp_path)
    task = suite.load(name)
    repeat = settings_for(task).action_repeat
    player, told, episodes = wandered(task, repeat)
    assert told.keys() == {"early", "late"}
    for each in told.values():
        number = next(n for n, episode in enumerate(episodes) if episode.order == each["order"])
        length, states = player.ended[number]
        again: Any = task.make(2, 9, repeat)
        again.begin(each["start"])
        assert again.start(1) == each["start"]
        for action, state in zip(each["actions"], states, strict=True):
            step = again.step(np.array([action] * 2, again.actions.dtype))
            assert again.flat_state()[1].tobytes() == state
        assert (float(step.score[0]), int(again.t[0])) == (each["score"], length)
        assert (episodes[number].score, episodes[number].length) == (each["score"], each["length"])
        *_, end = played_again(name, each, {0, length})
        assert end.t == length and end.picture is not None and end.picture.shape[2] == 3
        assert end.valuation.tolist() == again.valuation()[0].tolist()


def test_pictures_are_those_of_the_steps_that_are_asked_for() -> None:
    _, told, _ = wandered(suite.load("GapBall"), 1)
    moments = [*played_again("GapBall", told["late"], {0, 7, 320})]
    assert [moment.t for moment in moments] == [*range(321)]
    shown = [moment for moment in moments if moment.picture is not None]
    assert [moment.t for moment in shown] == [0, 7, 320]
    first, second, last = (moment.picture for moment in shown)
    assert first is not None and second is not None and last is not None
    assert first.shape == second.shape and not np.array_equal(first, last)


def test_a_fault_of_a_plug_in_that_draws_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise KeyError("x")

    _, told, _ = wandered(suite.load("MiniGrid-DoorKey-5x5-v0"), 1)
    monkeypatch.setattr("paddlectl.tasks.lanes.GymnasiumEnvironment.picture", fails)
    with pytest.raises(PaddlectlError, match="can't be drawn: KeyError"):
        [*played_again("MiniGrid-DoorKey-5x5-v0", told["late"], {0})]


START = {"agent": 17, "facing": 0, "things": {"BOX": 33, "BALL": 40, "PASSAGE": 37}}


@pytest.mark.parametrize(
    "change",
    [
        {"score": 0.5},
        {"length": 2},
        {"length": 10**9},
        {"actions": [0] * 319},
        {"actions": [7] * 320},
        {"actions": ["up"] * 320},
        {"start": {}},
        {"start": {"seed": 3}},
        {"start": START | {"agent": 0}},
        {"start": START | {"agent": 33}},
        {"start": START | {"agent": True}},
        {"start": START | {"facing": 4}},
        {"start": START | {"things": {"BOX": 33, "BALL": 40, "PASSAGE": 3}}},
        {"start": START | {"things": {"BOX": 33, "MOON": 40, "PASSAGE": 37}}},
        {"start": START | {"things": [33, 40, 37]}},
    ],
    ids=str,
)
def test_what_comes_out_otherwise_is_told(change: dict[str, Any]) -> None:
    _, told, _ = wandered(suite.load("GapBall"), 1)
    with pytest.raises(IntegrityError, match="otherwise"):
        [*played_again("GapBall", told["late"] | change, {0})]


@pytest.mark.parametrize("position", [[0.0, 0.0], [-4.5], [-4.5, float("nan")], ["a", "b"], None])
def test_no_episode_of_the_maze_begins_elsewhere(position: Any) -> None:
    told = {"start": {"position": position}, "actions": [], "action_repeat": 1, "length": 1, "score": 0.0}
    with pytest.raises(IntegrityError):
        [*played_again("MailMaze", told, {0})]


# Which are kept


def kept(*episodes: tuple[int, float]) -> dict[str, int]:
    """By their orders and scores, in order of ending; the orders of those that are kept."""
    choice, found = Choice(), {}
    for order, score in episodes:
        phase = choice.phase(Episode(order, 0, 0, score, 1))
        if phase:
            found[phase] = order
    return found


def test_the_first_solved_and_the_latest_solved_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "EARLY", 10)
    assert kept() == {}
    assert kept((0, 0.0)) == {"early": 0}
    assert kept((0, 0.0), (1, 0.0), (2, 0.5), (3, 0.5)) == {"early": 2, "late": 3}
    assert kept((0, 0.5), (1, 0.5), (2, 0.0)) == {"early": 0, "late": 1}
    assert kept((0, 0.5), (1, 0.5), (12, 0.0), (13, 0.0)) == {"early": 0, "late": 13}
    assert kept((12, 0.5), (0, 0.0), (13, 0.5), (14, 0.0)) == {"early": 0, "late": 13}


def test_of_episodes_too_long_to_be_kept_none_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "LARGEST", LANES * 319)
    _, told, _ = wandered(suite.load("GapBall"), 1)
    assert told == {}
