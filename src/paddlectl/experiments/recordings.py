"""The two episodes of a run that can be played again: as the registry keeps them, and played."""

from collections.abc import Collection, Iterator, Mapping
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl import plugins
from paddlectl.errors import IntegrityError, PaddlectlError, UsageError
from paddlectl.tasks.base import Actions, Bools, Split, Task
from paddlectl.tasks.environment import can_be_drawn, drawn
from paddlectl.tasks.suite import AnyTask, load

if TYPE_CHECKING:
    from paddlectl.agents.base import Policy
    from paddlectl.agents.recording import Recorded


def recordings_document(task: Task, action_repeat: int, kept: Mapping[str, "Recorded"]) -> dict[str, Any]:
    """Episodes by their phase, `early` or `late`, as JSON. Numbers are exact."""
    return {phase: _told(task, action_repeat, recorded) for phase, recorded in kept.items()}


def _told(task: Task, action_repeat: int, recorded: "Recorded") -> dict[str, Any]:
    episode, subgoals = recorded.episode, [] if recorded.subgoals is None else recorded.subgoals.tolist()
    return {
        "order": episode.order,
        "frames": episode.finished,
        "score": episode.score,
        "length": episode.length,
        "action_repeat": action_repeat,
        "start": recorded.start,
        "actions": _numbers(recorded.actions),
        "subgoals": [
            {"subgoal": str(task.domain_subgoals[which]), "actions": len([*some])}
            for which, some in groupby(subgoals)
        ],
    }


def _numbers(actions: NDArray[Any]) -> list[Any]:
    """Actions, those of float32 in as few digits as tell them apart."""
    if actions.dtype != np.float32:
        return list(actions.tolist())
    return [[float(str(number)) for number in action] for action in actions]


def played_anew(policy: "Policy", task: Task, seed: int) -> dict[str, Any]:
    """An episode of a policy on an unseen layout, as `played_again` takes it; nothing is learned.

    Args:
        policy: Who plays.
        task: Which; another than the policy's must be of its domain.
        seed: Of the layout and of all chance.

    Raises:
        UsageError: If its episodes can't be played again.
    """
    from paddlectl.agents.interaction import Interaction
    from paddlectl.agents.recording import Recorder

    environment: Any = task.make(1, seed, policy.action_repeat, "evaluation")
    if not hasattr(environment, "start"):
        raise _no_second_time(task)
    recorder = Recorder(environment, task.horizon)
    interaction = Interaction(environment, policy.player(task, 1, np.random.SeedSequence(seed)), recorder)
    while not interaction.run(1):
        pass
    if not recorder.kept:
        raise _no_second_time(task)
    return {**_told(task, policy.action_repeat, recorder.kept["early"]), "split": "evaluation"}


class Moment(NamedTuple):
    """A moment of an episode that is played again.

    Attributes:
        t: Steps so far.
        valuation: The truth of the vocabulary's atoms. [P]
        picture: [height, width, 3] uint8; None where none is asked for.
    """

    t: int
    valuation: Bools
    picture: NDArray[np.uint8] | None


def played_again(asked: AnyTask, told: Mapping[str, Any], shown: Collection[int]) -> Iterator[Moment]:
    """Plays an episode as it was recorded: the moment before each step, and the end.

    Args:
        asked: The task.
        told: The episode, of a run's `recordings`.
        shown: The moments of which there is a picture, by their steps so far.

    Raises:
        UsageError: If its episodes can't be played again, or not be drawn.
        IntegrityError: If it comes out otherwise than it did.
    """
    try:
        yield from _moments(asked, told, shown)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise IntegrityError(
            f"an episode of {load(asked).name} comes out otherwise than it was recorded",
            "use the version of paddlectl that recorded it",
        ) from error


def _moments(asked: AnyTask, told: Mapping[str, Any], shown: Collection[int]) -> Iterator[Moment]:
    task, split = load(asked), told.get("split", "training")
    engine: Any = task.make(1, 0, split=split)
    if not hasattr(engine, "begin"):
        raise _no_second_time(task)
    engine.begin(told["start"])
    with _Drawing(asked, engine, told["start"], split) as picture:
        score, t, ended = 0.0, 0, False
        for action in _each_step(told, engine.actions):
            if ended:
                raise ValueError("it ends before")
            yield Moment(t, engine.valuation()[0], picture() if t in shown else None)
            step = engine.step(action)
            picture.step(action[0])
            score, t = float(step.score[0]), int(engine.t[0])
            ended = bool(step.terminated[0] or step.truncated[0])
        if not ended or (score, t) != (told["score"], told["length"]):
            raise ValueError("it ends otherwise")
        yield Moment(t, engine.valuation()[0], picture() if t in shown else None)


def _each_step(told: Mapping[str, Any], actions: Actions) -> Iterator[NDArray[Any]]:
    """The action of each step. [1, ...]"""
    for step in range(told["length"]):
        yield np.array([told["actions"][step // told["action_repeat"]]], actions.dtype)


def _no_second_time(task: Task) -> UsageError:
    return UsageError(
        f"an episode of {task.name} can't be played again",
        "its environment has no start() and begin(), or the episode is too long",
    )


class _Drawing:
    """Draws the one lane of a task's engine: by the task's own environment, which goes along with it."""

    def __init__(self, asked: AnyTask, engine: Any, start: Any, split: Split) -> None:
        self._engine = engine
        self._env: Any = drawn(asked, split) if can_be_drawn(asked) else None
        if self._env is not None:
            self._env.begin(start)
        elif not hasattr(engine, "picture"):
            raise UsageError(f"{asked} can't be drawn", "its environment has no picture")

    def __enter__(self) -> "_Drawing":
        return self

    def __exit__(self, *_: object) -> None:
        if self._env is not None:
            self._env.close()

    def step(self, action: NDArray[Any]) -> None:
        if self._env is not None:
            self._env.step(action)

    def __call__(self) -> NDArray[np.uint8]:
        """[height, width, 3]"""
        try:
            shown: NDArray[np.uint8] = self._engine.picture(0) if self._env is None else self._env.render()
        except PaddlectlError:
            raise
        except Exception as error:  # of a plug-in
            raise PaddlectlError(
                f"an episode can't be drawn: {plugins.told(error)}", "mend the task"
            ) from error
        return shown
