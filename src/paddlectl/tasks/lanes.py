"""The lanes of a task over a Gymnasium environment (`tasks.gymnasium`), stepped one after another."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import ArrayLike, NDArray

from paddlectl.errors import PaddlectlError
from paddlectl.plugins import told
from paddlectl.tasks.base import Actions, Bools, Environment, Floats, Ints, Split, Step
from paddlectl.tasks.gymnasium import GymnasiumTask, Subgoal
from paddlectl.tasks.split import belongs, checked_split

MILESTONE = 0.1
"""What each milestone pays, once an episode."""

_PROBED = 50  # steps
_SEEDS = 2**31


class _Lane(gymnasium.Wrapper[Any, Any, Any, Any]):
    """One environment of the batch, whose state is looked at and not its observations.

    Attributes:
        terminated: The environment ended its episode for good.
        truncated: It cut its episode off.
        rests: No step changes anything until it is reset.
    """

    def __init__(self, task: GymnasiumTask) -> None:
        options = {"disable_env_checker": True, "max_episode_steps": task.horizon, **task.options}
        super().__init__(task.wrap(gymnasium.make(task.env, **options)))
        self.observation_space = Box(0, 0, (0,), np.float32)
        self.terminated = self.truncated = self.rests = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        self.env.reset(seed=seed)
        self.terminated = self.truncated = self.rests = False
        return _NOTHING, {}

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        if self.rests:
            return _NOTHING, 0.0, False, False, {}
        _, reward, self.terminated, self.truncated, _ = self.env.step(action)
        self.rests = self.terminated or self.truncated
        return _NOTHING, float(reward), False, False, {}  # ends would ask for a reset of the lane at once


_NOTHING = np.empty(0, np.float32)


class GymnasiumEnvironment(Environment):
    """B lanes of one task (`tasks.base.Environment`).

    Where it is, is kept as the seed and the actions of each lane's episode, and found again by playing them
    once more. An environment that isn't the same again then goes on from the beginning of its episode.

    Args:
        task: The task.
        name: What it is called.
        num_envs: How many are stepped together.
        seed: Of the episodes' seeds.
        action_repeat: Steps that one action lasts, unless the episode ends before.
        split: Of which the seeds are.

    Attributes:
        seeds: Of the episode of each lane. [B]

    Raises:
        PaddlectlError: If the environment can't be made, or a function of the task fails.
    """

    def __init__(
        self,
        task: GymnasiumTask,
        name: str,
        num_envs: int,
        seed: int,
        action_repeat: int = 1,
        split: Split = "training",
    ) -> None:
        self.num_envs = num_envs
        self.action_repeat = action_repeat
        self._task, self._name = task, name
        self._split: Split = checked_split(split)
        self._rng = np.random.default_rng(seed)
        self._subgoals = [task.subgoals.get(text) for text in task.whole_domain]
        self._milestones = [task.subgoals[text].reached for text in task.milestones]
        self._exclusions = task.impossible
        self._exact: bool | None = None
        self._kept: Floats | None = None
        with self._blamed("its environment"):
            self._vector = SyncVectorEnv(
                [partial(_Lane, task)] * num_envs, copy=False, autoreset_mode=AutoresetMode.DISABLED
            )
        self._lanes: list[Any] = self._vector.envs
        self._space: Any = self._vector.single_action_space
        self.actions = self._actions()
        self.t: Ints = np.zeros(num_envs, np.intp)
        self.seeds = np.zeros(num_envs, np.int64)
        self._finished = np.zeros(num_envs, np.bool_)
        self._paid = np.zeros((num_envs, len(self._milestones)), np.bool_)
        self._played = np.zeros((num_envs, task.horizon, *self.actions.shape), self.actions.dtype)
        self._states: list[Any] = []
        self._width = 0
        self.reset()
        self._measure()

    def _actions(self) -> Actions:
        space, task = self._space, self._task
        if isinstance(space, Discrete) and not task.continuous:
            return Actions(int(space.n))
        if isinstance(space, Box) and space.is_bounded() and task.continuous:
            return Actions(int(np.prod(space.shape)), continuous=True)
        wanted = "a bounded Box" if task.continuous else "Discrete, or a bounded Box with continuous=True"
        raise PaddlectlError(f"actions of {task.env} are {space}", f"a task's are {wanted}")

    def _measure(self) -> None:
        """Finds how many numbers there are to see, and tries the predicates."""
        self.valuation()
        for number, subgoal in enumerate(self._subgoals):
            if subgoal is not None:
                with self._blamed(f"sees of {self._task.whole_domain[number]}"):
                    size = len(_numbers(subgoal.sees(self._state(0))))
                    if self._width not in (0, size):
                        raise ValueError(f"it gives {size} numbers, another subgoal {self._width}")
                    self._width = size
        self.observation_size = self._width + len(self._subgoals)
        self.flat_size = self.flat_state().shape[1]

    def reset(self, lanes: Bools | None = None) -> None:
        """Begins episodes with new seeds in the masked lanes; in all if None. [B]"""
        chosen = np.ones(self.num_envs, np.bool_) if lanes is None else np.asarray(lanes, np.bool_)
        for lane in np.flatnonzero(chosen):
            self.seeds[lane] = self._seed()
        self._restart(chosen)

    def _restart(self, lanes: Bools) -> None:
        self._begin(lanes)
        self.t[lanes] = 0
        self._paid[lanes] = self._finished[lanes] = False

    def start(self, lane: int) -> dict[str, int]:
        """How the lane's episode began: by its seed."""
        return {"seed": int(self.seeds[lane])}

    def begin(self, start: Mapping[str, Any]) -> None:
        """Begins all lanes by what `start` told.

        Raises:
            KeyError or ValueError: If it can't have told that.
        """
        seed = start["seed"]
        if type(seed) is not int or seed not in range(_SEEDS):
            raise ValueError(f"no seed of an episode: {seed!r}")
        self.seeds[:] = seed
        self._restart(np.ones(self.num_envs, np.bool_))

    def _seed(self) -> int:
        while True:
            seed = self._rng.integers(_SEEDS, size=(1, 1))
            if belongs(seed, self._split)[0]:
                return int(seed[0, 0])

    def _begin(self, lanes: Bools) -> None:
        """Puts lanes at the beginning of the episodes of their seeds. [B]"""
        if lanes.any():
            with self._blamed("reset()"):
                self._vector.reset(seed=[*self.seeds.tolist()], options={"reset_mask": lanes})
        self._changed()

    def _changed(self) -> None:
        self._states = [None] * self.num_envs
        self._kept = None

    def _state(self, lane: int) -> Any:
        found = self._states[lane]
        if found is None:
            found = self._states[lane] = self._task.state(self._lanes[lane].env)
        return found

    def step(self, actions: NDArray[Any]) -> Step:
        """Applies one action a lane, for `action_repeat` steps. [B, ...]

        Raises:
            ValueError: If `actions.checked` refuses them.
            PaddlectlError: If the environment, or a function of the task, fails.
        """
        actions = self.actions.checked(actions, (self.num_envs,))
        step = self._step(actions)
        for _ in range(self.action_repeat - 1):
            step = step.then(self._step(actions))
        return step

    def _step(self, actions: NDArray[Any]) -> Step:
        task, running = self._task, ~self._finished
        lanes = np.flatnonzero(running)
        self._played[lanes, self.t[lanes]] = actions[lanes]
        with self._blamed("step()"):
            _, own, _, _, _ = self._vector.step(self._taken(actions))
        self.t[lanes] += 1
        self._changed()
        solved = running & self._each(task.success, "success")
        terminated = solved | (running & [lane.terminated for lane in self._lanes])
        late = (self.t >= task.horizon) | [lane.truncated for lane in self._lanes]
        truncated = running & late & ~terminated
        score = np.where(solved, 1 - 0.9 * self.t / task.horizon, 0.0)
        reward = score + MILESTONE * self._newly_paid(running) + task.own_reward * own
        self._rest(terminated | truncated)
        return Step(reward.astype(np.float32), score.astype(np.float32), terminated, truncated)

    def _newly_paid(self, running: Bools) -> Ints:
        """How many milestones each lane has reached for the first time. [B]"""
        held = [self._each(reached, "a milestone") for reached in self._milestones]
        new = np.array(held, np.bool_).reshape(len(held), self.num_envs).T & ~self._paid & running[:, None]
        self._paid |= new
        count: Ints = new.sum(1)
        return count

    def _rest(self, lanes: Bools) -> None:
        self._finished |= lanes
        for lane in np.flatnonzero(lanes):
            self._lanes[lane].rests = True

    def _taken(self, actions: NDArray[Any]) -> NDArray[Any]:
        """Actions as the environment takes them. [n, ...]"""
        space = self._space
        if not self.actions.continuous:
            return np.asarray(actions + space.start)
        share = (actions.reshape(len(actions), *space.shape) + 1) / 2
        taken: NDArray[Any] = (space.low + share * (space.high - space.low)).astype(space.dtype)
        return taken

    def _each(self, function: Callable[[Any], bool], what: str) -> Bools:
        """A function's truth in each lane. [B]"""
        with self._blamed(what):
            return np.array([_truth(function(self._state(lane))) for lane in range(self.num_envs)], np.bool_)

    def valuation(self) -> Bools:
        """E(s): the truth of every atom of the vocabulary, in its order. [B, P]

        Raises:
            PaddlectlError: If a predicate fails, or what never holds together does.
        """
        columns = [self._each(*each[::-1]) for each in self._task.predicates.items()]
        truth = np.array(columns, np.bool_).reshape(len(columns), self.num_envs).T
        for number, (wanted, signs) in enumerate(self._exclusions):
            if (truth[:, wanted] == signs).all(1).any():
                together = " and ".join(self._task.exclusions[number])
                raise PaddlectlError(
                    f"{together} hold together in {self._name}", "take them out of its exclusions"
                )
        return np.ascontiguousarray(truth)

    def observe(self, subgoals: Ints) -> Floats:
        """What each lane's subgoal sees, then which it is. [B, D]"""
        out = np.zeros((self.num_envs, self.observation_size), np.float32)
        with self._blamed("sees"):
            for lane, number in enumerate(subgoals.tolist()):
                if (subgoal := self._subgoals[number]) is not None:
                    out[lane, : self._width] = subgoal.sees(self._state(lane))
        out[np.arange(self.num_envs), self._width + subgoals] = 1
        if not np.isfinite(out).all():
            raise PaddlectlError(f"sees of {self._name} gives a number that isn't finite", "mend it")
        return out

    def flat_state(self) -> Floats:
        """`flat`, which of the domain's subgoals were paid as milestones, and the time left. [B, F]"""
        with self._blamed("flat"):
            rows = np.stack([_numbers(self._task.flat(self._state(lane))) for lane in range(self.num_envs)])
        paid = np.zeros((self.num_envs, len(self._subgoals)), np.bool_)
        paid[:, [self._task.whole_domain.index(text) for text in self._task.milestones]] = self._paid
        left = 1 - self.t[:, None] / self._task.horizon
        return np.hstack([rows, paid, left]).astype(np.float32)

    def distance(self, subgoals: Ints) -> Floats:
        """As the subgoals tell it; 0 where they don't. [B]"""

        def of(subgoal: Subgoal, state: Any) -> float:
            return 0.0 if subgoal.distance is None else float(subgoal.distance(state))

        return np.array(self._of_subgoals(of, subgoals, "distance"), np.float32)

    def in_world(self, subgoals: Ints, actions: NDArray[Any]) -> NDArray[Any]:
        """The same actions. [B, ...]"""
        return actions

    def reached(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal holds in the present state. [B]"""

        def of(subgoal: Subgoal, state: Any) -> bool:
            return _truth(subgoal.reached(state))

        return np.array(self._of_subgoals(of, subgoals, "reached"), np.bool_)

    def available(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal has something to act on and doesn't hold already. [B]"""

        def of(subgoal: Subgoal, state: Any) -> bool:
            if _truth(subgoal.reached(state)):
                return False
            return subgoal.available is None or _truth(subgoal.available(state))

        return np.array(self._of_subgoals(of, subgoals, "available"), np.bool_)

    def _of_subgoals(self, of: Callable[[Subgoal, Any], Any], subgoals: Ints, what: str) -> list[Any]:
        """Of each lane's subgoal; 0 for one that the task hasn't. [B]"""
        with self._blamed(what):
            return [
                0 if (subgoal := self._subgoals[number]) is None else of(subgoal, self._state(lane))
                for lane, number in enumerate(subgoals.tolist())
            ]

    @property
    def exact(self) -> bool:
        """Whether equal seeds and actions lead to equal states, as far as some steps tell."""
        if self._exact is None:
            self._exact = self._probed()
        return self._exact

    def _probed(self) -> bool:
        two = GymnasiumEnvironment(self._task, self._name, 2, 0, split=self._split)
        two.seeds[:] = two.seeds[0]
        two._begin(np.ones(2, np.bool_))
        rng = np.random.default_rng(0)
        for _ in range(_PROBED):
            one, other = two.flat_state()
            if not np.array_equal(one, other):
                return False
            two.step(np.repeat(self.actions.sample(rng, 1), 2, axis=0))
        return True

    def snapshot(self) -> dict[str, Any]:
        """The seeds and actions of the episodes that go on, and what they have led to."""
        return {
            "seeds": self.seeds,
            "played": self._played[:, : self.t.max()],
            "t": self.t,
            "paid": self._paid,
            "finished": self._finished,
            "rng": self._rng,
            "state": self.flat_state() if self._kept is None else self._kept,
        }

    def restore(self, value: dict[str, Any]) -> None:
        """Plays the episodes once more, from their seeds; one that goes another way is begun anew."""
        self._rng = value["rng"]
        kept = {"seeds": self.seeds, "t": self.t, "paid": self._paid, "finished": self._finished}
        for name, array in kept.items():
            array[:] = value[name]
        played = value["played"]
        self._played[:, : played.shape[1]] = played
        self._begin(np.ones(self.num_envs, np.bool_))
        with self._blamed("step()"):
            for lane, steps in enumerate(self.t.tolist()):
                for action in self._taken(played[lane, :steps]):
                    self._lanes[lane].step(action)
        self._rest(self._finished)
        self._changed()
        other = (self.flat_state() != value["state"]).any(1)
        if other.any():
            self._exact = False
            self._begin(other)
        self._kept = value["state"]

    def show(self, state: Any, t: int, paid: Bools) -> None:
        """Brings a single lane to where an environment is that is stepped elsewhere.

        Args:
            state: What the task's `state` gives of that.
            t: Its steps.
            paid: Which milestones it has paid. [1, M]
        """
        self._states = [state]
        self.t[:] = t
        self._paid[:] = paid

    def picture(self, lane: int) -> NDArray[np.uint8]:
        """What the environment itself draws of a lane. [height, width, 3]

        Raises:
            PaddlectlError: If it can't.
        """
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # Pygame looks for a screen, and complains
        inner = self._lanes[lane].unwrapped
        with self._blamed("render()"):
            inner.render_mode = "rgb_array"
            drawn = np.asarray(inner.render(), np.uint8)
            if drawn.ndim != 3:
                raise ValueError(f"it gives no picture, but an array of shape {drawn.shape}")
        return drawn

    def close(self) -> None:
        """Closes its environments."""
        self._vector.close()

    @contextmanager
    def _blamed(self, what: str) -> Iterator[None]:
        """What fails within is told as the fault of the task.

        Raises:
            PaddlectlError: If something does.
        """
        try:
            yield
        except PaddlectlError:
            raise
        except Exception as error:
            raise PaddlectlError(
                f"{what} of task {self._name} ({self._task.env}) fails: {told(error)}", "mend the task"
            ) from error


def _truth(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"it gives {type(value).__name__} instead of bool")
    return bool(value)


def _numbers(value: ArrayLike) -> Floats:
    numbers: Floats = np.asarray(value, np.float32)
    if numbers.ndim != 1:
        raise ValueError(f"it gives numbers of shape {numbers.shape} instead of a row")
    return numbers
