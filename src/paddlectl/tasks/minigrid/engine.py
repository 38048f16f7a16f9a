"""The MiniGrid tasks in batches: B lanes as a structure of arrays, stepped without a loop over them.

`env.PaddleEnv` is the same definition on MiniGrid's own objects; a test holds both to it.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paddlectl.tasks.base import Actions, Bools, Floats, Ints, Split, Step, Task, Vocabulary
from paddlectl.tasks.minigrid import symbols
from paddlectl.tasks.minigrid.flat import FLAT_SIZE, flat_state
from paddlectl.tasks.minigrid.grid import (
    ABSENT,
    ACTIONS,
    CELLS,
    DELTA,
    EFFECT_CODE,
    EFFECT_ENTERS,
    EFFECT_HELD,
    EFFECT_LEAVES,
    MOVE,
    OUTCOME,
    TURN,
    Action,
    Code,
    Codes,
    Held,
    Thing,
    outcome_index,
)
from paddlectl.tasks.minigrid.layouts import (
    HORIZON,
    SPECS,
    Layouts,
    Passage,
    Spec,
    build_grid,
    draw_layouts,
    layout_of,
    start_of,
)
from paddlectl.tasks.minigrid.observe import OBSERVATION_SIZE, Observer, obstacle_rows, update_rows

_ON_GOAL = int(symbols.Fact.ON_GOAL)
_POOL = 1024  # layouts drawn at once; independent of the lanes, so the draws are too


def final_rewards() -> Floats:
    """The reward of solving a task in step t, 1 - 0.9 t / T. [T + 1]"""
    return (1 - 0.9 * np.arange(HORIZON + 1) / HORIZON).astype(np.float32)


class State:
    """n states of one task.

    Attributes:
        grid: Codes of the cells. [n, 120] uint8
        agent: The agent's cell. [n]
        facing: Its direction. [n]
        held: What is in hand. [n]
        where: Cell of each thing, or ABSENT. [n, 9]
        facts: `symbols.encode` of the above. [n]
        rows: `observe.obstacle_rows` of the grid. [n, 14]
    """

    def __init__(self, grid: Codes, agent: Ints, facing: Ints, held: Ints, where: Ints) -> None:
        self.grid, self.agent, self.facing, self.held, self.where = grid, agent, facing, held, where
        self.facts = symbols.encode(grid, where, held, agent)
        self.rows = obstacle_rows(grid)

    @classmethod
    def start(cls, spec: Spec, layouts: Layouts) -> "State":
        """The states in which episodes with these layouts begin."""
        agent, facing, where = (values.copy() for values in layouts)
        return cls(build_grid(spec, where), agent, facing, np.zeros_like(agent), where)

    def assign(self, lanes: Ints, other: "State", chosen: slice) -> None:
        """Overwrites the states of `lanes` with those `chosen` of another."""
        for name, values in vars(self).items():
            values[lanes] = getattr(other, name)[chosen]

    def write(self, lanes: Ints, cells: Ints, codes: Codes) -> None:
        """Changes one cell in each of the lanes, their rows with it. [n]"""
        self.grid[lanes, cells] = codes
        update_rows(self.rows, lanes, cells, codes)


class Engine:
    """B lanes of one task (`tasks.base.Environment`).

    Args:
        spec: The task.
        num_envs: How many are stepped together.
        seed: Of the layouts: equal seeds give the same layouts in the same order.
        action_repeat: Steps that one action lasts, unless the episode ends before.
        split: Of which the layouts are.
        milestone_reward: What each milestone pays; 0 gives the sparse variant.
    """

    observation_size = OBSERVATION_SIZE
    flat_size = FLAT_SIZE
    actions = Actions(ACTIONS)

    def __init__(
        self,
        spec: Spec,
        num_envs: int,
        seed: int,
        action_repeat: int = 1,
        split: Split = "training",
        milestone_reward: float = 0.1,
    ) -> None:
        self.spec = spec
        self.num_envs = num_envs
        self.action_repeat = action_repeat
        self.split: Split = split
        self._rng = np.random.default_rng(seed)
        self._observer = Observer(num_envs)
        self._bases: Ints = np.arange(num_envs) * CELLS

        self._valuations = symbols.valuation_table(spec.atoms)
        reached = symbols.reached_table(spec.things)
        self._reached = reached.ravel()
        self._available = symbols.available_table(spec.things).ravel()
        self._solved = np.logical_and.reduce(
            [reached[symbols.SUBGOALS.index(subgoal)] for subgoal in spec.success]
        )
        self._milestones: Ints = np.zeros(symbols.FACTS, dtype=np.intp)  # a bit for each subgoal that pays
        for number in map(symbols.SUBGOALS.index, spec.milestones):
            self._milestones |= reached[number].astype(np.intp) << number
        count = np.bitwise_count(np.arange(1 << len(symbols.SUBGOALS)))
        self._milestone_rewards = (milestone_reward * count).astype(np.float32)
        self._final_rewards = final_rewards()

        self.t: Ints = np.zeros(num_envs, dtype=np.intp)
        self._earned: Ints = np.zeros(num_envs, dtype=np.intp)
        self._finished: Bools = np.zeros(num_envs, dtype=np.bool_)
        self._began = np.zeros((num_envs, 2 + len(Thing)), dtype=np.int16)
        self._fill_pool()
        self.state = State.start(spec, draw_layouts(spec, np.random.default_rng(0), num_envs))
        self.reset()

    def reset(self, lanes: Bools | None = None) -> None:
        """Draws new layouts for the masked lanes; for all if None. [B]"""
        waiting = np.arange(self.num_envs) if lanes is None else np.flatnonzero(lanes)
        self._restart(waiting)
        while len(waiting):
            if self._used == _POOL:
                self._fill_pool()
            taken = slice(self._used, min(self._used + len(waiting), _POOL))
            count = taken.stop - taken.start
            self.state.assign(waiting[:count], self._pool, taken)
            self._began[waiting[:count]] = self._starts[taken]
            self._used += count
            waiting = waiting[count:]

    def _fill_pool(self) -> None:
        layouts = draw_layouts(self.spec, self._rng, _POOL, self.split)
        self._pool, self._starts = State.start(self.spec, layouts), _rows(layouts)
        self._used = 0

    def set_layouts(self, layouts: Layouts) -> None:
        """Starts all lanes from given layouts, one a lane."""
        self.state = State.start(self.spec, layouts)
        self._began[:] = _rows(layouts)
        self._restart(np.arange(self.num_envs))

    def start(self, lane: int) -> dict[str, Any]:
        """How the lane's episode began."""
        agent, facing, *where = self._began[lane].tolist()
        return start_of(agent, facing, where)

    def begin(self, start: Mapping[str, Any]) -> None:
        """Begins all lanes by what `start` told.

        Raises:
            KeyError, TypeError or ValueError: If it can't have told that.
        """
        layout = layout_of(self.spec, start)
        self.set_layouts(Layouts(*(values.repeat(self.num_envs, axis=0) for values in layout)))

    def set_state(self, state: State, t: Ints, paid: Ints) -> None:
        """Puts all lanes into the midst of episodes.

        Args:
            state: Theirs.
            t: Steps since each lane's start. [B]
            paid: A bit for each subgoal of the domain that was paid as a milestone. [B]
        """
        self.state, self.t, self._earned = state, t, paid
        self._finished[:] = False

    def _restart(self, lanes: Ints) -> None:
        self.t[lanes] = 0
        self._earned[lanes] = 0
        self._finished[lanes] = False

    def step(self, actions: Ints) -> Step:
        """Applies one action a lane, for `action_repeat` steps. [B]

        Raises:
            ValueError: If `actions.checked` refuses them.
        """
        actions = self.actions.checked(actions, (self.num_envs,))
        step = self._step(actions)
        for _ in range(self.action_repeat - 1):
            step = step.then(self._step(actions))
        return step

    def _step(self, actions: Ints) -> Step:
        running = ~self._finished
        self._act(np.where(running, actions, Action.STAY))
        self.t += running

        facts = self.state.facts
        new = self._milestones.take(facts) & ~self._earned
        self._earned |= new
        terminated = self._solved.take(facts) & running
        truncated = (self.t >= HORIZON) & running & ~terminated
        self._finished |= terminated
        self._finished |= truncated
        score = self._final_rewards.take(self.t) * terminated
        return Step(self._milestone_rewards.take(new) + score, score, terminated, truncated)

    def _act(self, actions: Ints) -> None:
        """Turns and moves all lanes; the few that change their grid are then treated by themselves."""
        state = self.state
        TURN.take(actions * 4 + state.facing, out=state.facing, mode="clip")
        front = state.agent + DELTA.take(state.facing)
        code = state.grid.take(self._bases + front)
        outcome = OUTCOME.take(outcome_index(actions, state.held, code))
        np.copyto(state.agent, front, where=outcome == MOVE)
        changed = np.flatnonzero(outcome > MOVE)
        if len(changed):
            self._change(changed, front.take(changed), outcome.take(changed))
        if Thing.GOAL in self.spec.things:
            self._mark_goal()

    def _change(self, lanes: Ints, front: Ints, outcome: Ints) -> None:
        """Lets each lane's effect happen to its cell in front. [n]"""
        state = self.state
        state.write(lanes, front, EFFECT_CODE.take(outcome))
        held = EFFECT_HELD.take(outcome)
        state.held[lanes] = held = np.where(held < 0, state.held.take(lanes), held)
        state.where[lanes, EFFECT_ENTERS.take(outcome)] = front
        state.where[lanes, EFFECT_LEAVES.take(outcome)] = ABSENT
        if self.spec.passage is Passage.GAP:
            opened = lanes[held == Held.KEY]
            passage = state.where[opened, Thing.PASSAGE]
            state.write(opened, passage, np.full(len(opened), Code.OPEN, dtype=np.uint8))
        where, agent = state.where.take(lanes, axis=0), state.agent.take(lanes)
        state.facts[lanes] = symbols.encode(state.grid.take(lanes, axis=0), where, held, agent)

    def _mark_goal(self) -> None:
        """The one fact that a mere step can change."""
        state = self.state
        state.facts &= ~_ON_GOAL
        state.facts |= (state.agent == state.where[:, Thing.GOAL]) * _ON_GOAL

    def valuation(self) -> Bools:
        """E(s): the truth of every atom of the vocabulary, in its order. [B, P]"""
        return self._valuations.take(self.state.facts, axis=0)

    def observe(self, subgoals: Ints) -> Floats:
        """What the low level sees (`tasks.minigrid.observe`). [B, 81]"""
        s = self.state
        return self._observer(s.grid, s.rows, s.agent, s.facing, s.held, s.where, subgoals)

    def flat_state(self) -> Floats:
        """The whole state as one vector (`tasks.minigrid.flat`). [B, FLAT_SIZE]"""
        s = self.state
        return flat_state(s.grid, s.rows, s.agent, s.facing, s.held, s.where, s.facts, self._earned, self.t)

    def distance(self, subgoals: Ints) -> Floats:
        """Steps to what each lane's subgoal acts on, as if nothing stood in the way. [B]"""
        return self._observer.distance(self.state.agent, self.state.where, subgoals)

    def in_world(self, subgoals: Ints, actions: Ints) -> Ints:
        """Actions chosen by what `observe` shows, as `step` takes them. [B]"""
        return self._observer.in_world(self.state.agent, self.state.where, subgoals, actions)

    def reached(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal holds in the present state. [B]"""
        return self._reached.take(subgoals * symbols.FACTS + self.state.facts)

    def available(self, subgoals: Ints) -> Bools:
        """Whether each lane's subgoal has something to act on and doesn't hold already. [B]"""
        return self._available.take(subgoals * symbols.FACTS + self.state.facts)


def _rows(layouts: Layouts) -> NDArray[np.int16]:
    """Layouts as rows of agent, facing and where. [n, 11]"""
    rows: NDArray[np.int16] = np.column_stack(layouts).astype(np.int16)
    return rows


def make_task(name: str, milestone_reward: float = 0.1) -> Task:
    """The task of that name."""
    return task_of(SPECS[name], milestone_reward)


def task_of(spec: Spec, milestone_reward: float = 0.1) -> Task:
    """A task of that kind."""
    return Task(
        name=spec.name,
        domain="minigrid",
        summary=spec.summary,
        horizon=HORIZON,
        vocabulary=Vocabulary(spec.atoms, symbols.exclusions(spec.atoms)),
        subgoals=spec.subgoals,
        domain_subgoals=symbols.SUBGOALS,
        make=partial(Engine, spec, milestone_reward=milestone_reward),
    )
