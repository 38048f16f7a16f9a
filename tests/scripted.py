"""A corridor whose every step can be worked by hand, as a task of the package, and actors by script."""

from collections.abc import Iterable, Sequence

import numpy as np

from paddlectl.agents.interaction import Learning
from paddlectl.hybrid.rollout import PROGRESS, Outcome
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.logic.atoms import Predicate
from paddlectl.methods.base import Method, Setup, Source
from paddlectl.tasks.base import Actions, Step, Task, Vocabulary

LEFT, STAY, RIGHT = range(3)
FAR = Predicate("far", 0)()
GT_OTHER, GT_TWO, GT_END, GT_MOON = (
    Predicate(name, 0)() for name in ("gt_other", "gt_two", "gt_end", "gt_moon")
)
DOMAIN_SUBGOALS = (GT_OTHER, GT_TWO, GT_END, GT_MOON)
OTHER, TWO, END, MOON = range(4)
HORIZON = 12
NEAR_SCENE, FAR_SCENE = range(2)


class Corridor:
    """Cells 0, 1, 2, … The scene turns far at cell 3; the end, at cell 5, 6 or 7, solves the episode.

    Layout n ends at cell 5 + n % 3 and scores 0.5 + (n % 100) / 200; no one gets to the end of layout
    9, 19, 29, … Cell 2 pays 0.1, once an episode. `gt_moon` holds always, so it is never available.
    Layouts are numbered 1000·seed, 1000·seed + 1, …, in the order of being drawn.
    """

    observation_size = 2 + len(DOMAIN_SUBGOALS)
    flat_size = 4
    actions = Actions(3)

    def __init__(self, num_envs: int, seed: int, action_repeat: int = 1, split: str = "training") -> None:
        assert action_repeat == 1
        self.num_envs, self.action_repeat = num_envs, action_repeat
        self._next = 1000 * seed
        self.layout, self.place, self.t = np.zeros((3, num_envs), np.intp)
        self.paid = np.zeros(num_envs, np.bool_)
        self.reset()

    def reset(self, lanes=None):
        chosen = np.flatnonzero(np.ones(self.num_envs, np.bool_) if lanes is None else lanes)
        self.layout[chosen] = self._next + np.arange(len(chosen))
        self._next += len(chosen)
        self.place[chosen] = 0
        self.t[chosen] = 0
        self.paid[chosen] = False

    def step(self, actions):
        self.place = np.maximum(self.place + actions - STAY, 0)
        self.t += 1
        solved = self._at_end()
        milestone = (self.place == 2) & ~self.paid
        self.paid |= milestone
        score = np.where(solved, 0.5 + (self.layout % 100) / 200, 0.0).astype(np.float32)
        return Step(0.1 * milestone + score, score, solved, (self.t >= HORIZON) & ~solved)

    def _at_end(self):
        return (self.place == 5 + self.layout % 3) & (self.layout % 10 != 9)

    def valuation(self):
        return (self.place >= 3)[:, None]

    def observe(self, subgoals):
        return np.column_stack([self.place / 10, self.layout % 3, np.eye(4)[subgoals]]).astype(np.float32)

    def flat_state(self):
        columns = [self.place / 10, self.layout % 3, self.paid, self.t / HORIZON]
        return np.column_stack(columns).astype(np.float32)

    def distance(self, subgoals):
        end = 5 + self.layout % 3
        return np.select(
            [subgoals == TWO, subgoals == END], [abs(self.place - 2), abs(self.place - end)], 0
        ).astype(np.float32)

    def in_world(self, subgoals, actions):
        return actions

    def reached(self, subgoals):
        places = {TWO: self.place == 2, END: self._at_end(), MOON: np.ones(self.num_envs, np.bool_)}
        return np.array(
            [subgoal in places and places[subgoal][lane] for lane, subgoal in enumerate(subgoals)]
        )

    def available(self, subgoals):
        return ~self.reached(subgoals) & (np.asarray(subgoals) != OTHER)


TASK = Task(
    name="Corridor",
    domain="scripted",
    summary="get to the end",
    horizon=HORIZON,
    vocabulary=Vocabulary((FAR,)),
    subgoals=(GT_END, GT_TWO, GT_MOON),
    domain_subgoals=DOMAIN_SUBGOALS,
    make=Corridor,
)


class ByScript:
    """Every lane does the same: these actions, one a step, then the last for ever."""

    def __init__(self, *actions: int) -> None:
        self._actions = list(actions)
        self.seen: list[np.ndarray] = []

    def act(self, observations, rng):
        self.seen.append(observations.copy())
        action = self._actions[min(len(self.seen), len(self._actions)) - 1]
        return np.full(len(observations), action), np.full(len(observations), -0.5, np.float32)

    def update(self, buffer):
        return {}

    def anneal(self, done):
        pass

    def eval_actor(self):
        return self

    def teacher_actor(self):
        return self

    def state(self):
        return {}

    def load(self, state):
        pass


def as_source(name: str, policy, program=None) -> Source:
    """A source that is this policy."""
    return Source(name, policy.task, program, name, lambda: policy)


class Teller:
    """Gives these subgoals in turn, the last for ever; a listener that remembers what it was told."""

    def __init__(self, subgoals: Iterable[int], guides: Sequence[int] = (0,)) -> None:
        self._subgoals = list(subgoals)
        self._guides = guides
        self.asked: list[list[tuple[int, int]]] = []
        self.progress: list[list[int]] = []
        self.told: list = []

    def select(self, lanes, scene_states):
        scenes, progress = divmod(scene_states, PROGRESS)
        self.asked.append(list(zip(lanes.tolist(), scenes.tolist(), strict=True)))
        self.progress.append(progress.tolist())
        subgoal = self._subgoals[min(len(self.asked), len(self._subgoals)) - 1]
        guides = np.array([self._guides[lane % len(self._guides)] for lane in lanes])
        return guides, np.full(len(lanes), subgoal)

    def on_decision_end(self, outcome):
        self.told.append(outcome)


def learning(method: Method, setup: Setup) -> Learning:
    """The method's agent at work, as a run has it."""
    environment = setup.task.make(setup.settings.num_envs, setup.seed, setup.settings.action_repeat)
    return Learning(environment, method.make(setup), setup.frames)


def outcome(scene_state, subgoal, reward=0.0, following=None, reached=False, lane=0, truncated=False):
    """One decision of three steps that ended; the task is solved if no scene follows."""
    columns = {
        "lanes": lane,
        "scene_states": scene_state,
        "subgoals": subgoal,
        "guides": 0,
        "steps": 3,
        "rewards": np.float32(reward),
        "reached": reached,
        "cut": False,
        "terminated": following is None,
        "solved": following is None,
        "truncated": truncated,
        "next_scene_states": 0 if following is None else following * PROGRESS,
    }
    return Outcome(**{name: np.array([value]) for name, value in columns.items()})


def block(steps: int, num_envs: int) -> RolloutBuffer:
    return RolloutBuffer.empty(steps, num_envs, Corridor.observation_size)
