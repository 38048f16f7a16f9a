"""MiniGrid's own wrappers around our tasks."""

import inspect
from typing import Any

import gymnasium
import numpy as np
import pytest
from minigrid import wrappers

from paddlectl.tasks.minigrid.layouts import SPECS
from paddlectl.tasks.registration import environment_id

NEEDED: dict[str, dict[str, Any]] = {
    "ReseedWrapper": {"seeds": (3, 4)},
    "ViewSizeWrapper": {"agent_view_size": 5},
}
NOT_OURS = {"NoDeath"}  # nothing kills here, and it asks for an action `forward`
BASES = {"Wrapper", "ObservationWrapper", "ActionWrapper"}
ALL = {
    name
    for name, found in inspect.getmembers(wrappers, inspect.isclass)
    if issubclass(found, gymnasium.Wrapper)
}


@pytest.mark.parametrize("name", sorted(ALL - BASES - NOT_OURS))
@pytest.mark.parametrize("task", SPECS)
def test_a_wrapper_shows_what_its_space_says(task: str, name: str) -> None:
    env = getattr(wrappers, name)(gymnasium.make(environment_id(task)), **NEEDED.get(name, {}))
    if name == "DirectionObsWrapper" and task != "OpenGoal":
        with pytest.raises(ValueError, match="Goal"):
            env.reset(seed=0)
        return
    env.action_space.seed(0)
    observation, _ = env.reset(**({} if name == "ReseedWrapper" else {"seed": 0}))
    for _ in range(20):
        if name == "DictObservationSpaceWrapper":
            observation["mission"] = np.array(observation["mission"])  # MiniGrid's list is in no space
        assert observation in env.observation_space
        observation, *_ = env.step(env.action_space.sample())


def test_missions_tell_the_tasks_apart() -> None:
    assert len({spec.mission for spec in SPECS.values()}) == len(SPECS)
    seen = set()
    for task in SPECS:
        env = wrappers.FlatObsWrapper(gymnasium.make(environment_id(task)))
        seen.add(env.reset(seed=0)[0][7 * 7 * 3 :].tobytes())
    assert len(seen) == len(SPECS)


def test_a_task_s_mission_is_its_space_s_one_text() -> None:
    space = gymnasium.make(environment_id("BoxDoor")).observation_space["mission"]
    other = gymnasium.make(environment_id("GapBall")).observation_space["mission"]
    assert space.sample() == SPECS["BoxDoor"].mission
    assert SPECS["BoxDoor"].mission in space
    assert all(wrong not in space for wrong in ("", SPECS["GapBall"].mission, 3, None, np.zeros(3)))
    assert space != other
    assert space == gymnasium.make(environment_id("BoxDoor")).observation_space["mission"]
