"""Any Gymnasium environment as a task: predicates and subgoals are small functions of its state.

    ICY = GymnasiumTask(env="FrozenLake-v1", domain="lake", horizon=100, predicates={…}, subgoals={…}, …)

is what an entry point of the group `paddlectl.tasks` names, and what stands in `TASKS` of a file that is
given as `--tasks FILE.py`. Lanes are stepped through Gymnasium's vector API, one after another.

An episode is what its seed makes of the environment. An eighth of all seeds are for evaluation alone; of an
environment that draws nothing by its seed, both splits are the same.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import Any

from numpy.typing import ArrayLike

from paddlectl.logic.atoms import Atom, Literal
from paddlectl.logic.syntax import parse_clause
from paddlectl.plugins import attribute
from paddlectl.tasks.base import FRAMES, Environment, Split, Task, Vocabulary

MOST_PREDICATES = 16
"""A program has a scene for each truth of all of them: twice as many with each."""

# What the fields of a task are, and how that is said.
_TEXT = (str, "a text")
_FUNCTION = (Callable, "a function")
_MAPPING = (Mapping, "a dict by atoms")
_TEXTS = (tuple, 'a tuple of texts, ("gt_key()",)')
_KINDS: dict[str, tuple[Any, str]] = {
    "env": _TEXT,
    "domain": _TEXT,
    "summary": _TEXT,
    "horizon": (int, "a whole number of steps"),
    "frames": (int, "a whole number of steps"),
    "own_reward": (int | float, "a number"),
    "continuous": (bool, "True or False"),
    "predicates": _MAPPING,
    "subgoals": _MAPPING,
    "options": (Mapping, "a dict"),
    "milestones": _TEXTS,
    "domain_subgoals": _TEXTS,
    "exclusions": (tuple, 'a tuple of tuples of texts, (("has_key(agent)", "!is_seen(key)"),)'),
    **dict.fromkeys(("success", "flat", "wrap", "state"), _FUNCTION),
}


def _unwrapped(env: Any) -> Any:
    return env.unwrapped


def _as_it_is(env: Any) -> Any:
    return env


@dataclass(frozen=True)
class Subgoal:
    """What the low level is to reach, by functions of the state.

    Attributes:
        reached: Whether it holds.
        sees: What the low level sees for it: as many numbers in every state, for each subgoal of the domain.
            Which subgoal it is needn't be among them.
        available: Whether there is something to act on; without, always. It is asked only where the subgoal
            doesn't hold.
        distance: About how many steps it is away; only for a learner with `decisions.shaping`.
    """

    reached: Callable[[Any], bool]
    sees: Callable[[Any], ArrayLike]
    available: Callable[[Any], bool] | None = None
    distance: Callable[[Any], float] | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None or name in ("reached", "sees"):
                _require(name, value, *_FUNCTION)


@dataclass(frozen=True)
class GymnasiumTask:
    """A task over a Gymnasium environment. Called with a name, it gives the `Task` of that name.

    Atoms are written as programs show them: `has_key(agent)`, `gt_key()`.

    Attributes:
        env: The environment's id, `Taxi-v4`.
        domain: Policies are interchangeable within one.
        horizon: Steps after which an episode is truncated, unless the environment does so before.
        predicates: The body atoms, and whether each holds in a state.
        subgoals: The subgoals.
        success: Whether a state solves the task. That pays 1 - 0.9 t / horizon and ends the episode.
        flat: The whole state as numbers, as many in every state of the domain's tasks: what a learner without
            subgoals sees. The milestones that were paid and the time left are added to them.
        summary: One line for a reader.
        milestones: Subgoals that pay 0.1 once an episode.
        exclusions: Sets of literals that never hold together: `("has_key(agent)", "!is_seen(key)")`.
        domain_subgoals: All subgoals of the domain, if other tasks of it have more.
        options: For `gymnasium.make`.
        wrap: Wraps what it made.
        state: What all other functions are given of the wrapped environment, once a step; without, the
            environment itself, unwrapped.
        own_reward: The environment's own rewards count this much besides.
        continuous: Whether actions are of a bounded `Box`, and not whole numbers.
        frames: The usual budget of learning it, in environment steps.
    """

    env: str
    domain: str
    horizon: int
    predicates: Mapping[str, Callable[[Any], bool]]
    subgoals: Mapping[str, Subgoal]
    success: Callable[[Any], bool]
    flat: Callable[[Any], ArrayLike]
    summary: str = ""
    milestones: tuple[str, ...] = ()
    exclusions: tuple[tuple[str, ...], ...] = ()
    domain_subgoals: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    wrap: Callable[[Any], Any] = _as_it_is
    state: Callable[[Any], Any] = _unwrapped
    own_reward: float = 0.0
    continuous: bool = False
    frames: int = FRAMES

    def __post_init__(self) -> None:
        """Refuses fields of another kind.

        Raises:
            TypeError: If one is.
        """
        for name, (kind, said) in _KINDS.items():
            _require(name, getattr(self, name), kind, said)
        for atom, predicate in self.predicates.items():
            _require(f"predicate {atom}", predicate, *_FUNCTION)
        for atom, subgoal in self.subgoals.items():
            _require(f"subgoal {atom}", subgoal, Subgoal, "a Subgoal(reached, sees)")
        for each in self.exclusions:
            _require("an exclusion", each, *_TEXTS)
        for text in (*self.milestones, *self.domain_subgoals, *chain(*self.exclusions)):
            _require("an atom", text, *_TEXT)

    def __call__(self, name: str) -> Task:
        """The task of that name.

        Raises:
            ValueError: If an atom isn't written as one, a milestone is no subgoal, or there are too many
                predicates.
        """
        atoms = tuple(map(_atom, self.predicates))
        if len(atoms) > MOST_PREDICATES:
            raise ValueError(f"it has {len(atoms)} predicates; {MOST_PREDICATES} are the most")
        if unknown := [text for text in self.milestones if text not in self.subgoals]:
            raise ValueError(f"milestone {unknown[0]} is none of its subgoals")
        if unknown := [text for text in self.subgoals if text not in self.whole_domain]:
            raise ValueError(f"{unknown[0]} is none of its domain_subgoals")
        excluded = [text for each in self.exclusions for text in each]
        if unknown := [text for text in excluded if _literal(text).atom not in atoms]:
            raise ValueError(f"exclusion {unknown[0]} is none of its predicates")
        return Task(
            name=name,
            domain=self.domain,
            summary=self.summary or f"{self.env} of Gymnasium.",
            horizon=self.horizon,
            vocabulary=Vocabulary(atoms, tuple(frozenset(map(_literal, each)) for each in self.exclusions)),
            subgoals=tuple(map(_atom, self.subgoals)),
            domain_subgoals=tuple(map(_atom, self.whole_domain)),
            make=partial(_made, self, name),
            learner="td3" if self.continuous else "ppo",
            frames=self.frames,
        )

    @property
    def whole_domain(self) -> tuple[str, ...]:
        """All subgoals of the domain."""
        return self.domain_subgoals or tuple(self.subgoals)

    @property
    def impossible(self) -> list[tuple[list[int], list[bool]]]:
        """Of each exclusion the columns of a valuation, and the truth that they never have together."""
        order = list(map(_atom, self.predicates))
        literals = [[_literal(text) for text in each] for each in self.exclusions]
        return [([order.index(x.atom) for x in each], [x.positive for x in each]) for each in literals]


def _made(
    task: GymnasiumTask,
    name: str,
    num_envs: int,
    seed: int,
    action_repeat: int = 1,
    split: Split = "training",
) -> Environment:
    """Imports Gymnasium, which takes long, and makes the lanes."""
    lanes: Environment = attribute("paddlectl.tasks.lanes:GymnasiumEnvironment")(
        task, name, num_envs, seed, action_repeat, split
    )
    return lanes


def _require(name: str, value: Any, kind: Any, said: str) -> None:
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise TypeError(f"{name} must be {said}, not {value!r}")


def _literal(text: str) -> Literal:
    (literal,) = parse_clause(f"x() :- {text}").body
    return literal


def _atom(text: str) -> Atom:
    literal = _literal(text)
    if str(literal) != text or not literal.positive:
        raise ValueError(f"an atom is written like {literal.atom}, not {text}")
    return literal.atom
