"""The loop: it steps the environment, and knows nothing of who acts."""

from typing import NamedTuple

import numpy as np

from paddlectl.agents.base import Agent, Episode, Player
from paddlectl.agents.recording import Recorder
from paddlectl.tasks.base import Environment, Step


class Round(NamedTuple):
    """What one block of experience brought.

    Attributes:
        frames: Environment steps so far.
        episodes: Those that ended in it, in order of ending.
        figures: What the agent has to tell of it.
    """

    frames: int
    episodes: list[Episode]
    figures: dict[str, float]


class Interaction:
    """B environments and who acts in them.

    Args:
        environment: They.
        player: Who acts.
        recorder: Keeps some of the episodes, if there is one.

    Attributes:
        frames: Steps of the task so far, of all environments together.
    """

    def __init__(self, environment: Environment, player: Player, recorder: Recorder | None = None) -> None:
        self.environment = environment
        self.player = player
        self.recorder = recorder
        self.frames = 0
        self._order = np.arange(environment.num_envs)
        self._started = np.zeros(environment.num_envs, np.intp)

    def run(self, steps: int) -> list[Episode]:
        """Takes so many steps in each environment; gives the episodes that ended, in order of ending."""
        return [episode for _ in range(steps) for episode in self._step()]

    def _step(self) -> list[Episode]:
        environment = self.environment
        before = environment.t.sum()
        actions = self.player.act(environment)
        if self.recorder is not None:
            self.recorder.add(actions, self.player.subgoals())
        step = environment.step(actions)
        self.frames += int(environment.t.sum() - before)
        self.player.observe(environment, step)
        return self._finish(step)

    def _finish(self, step: Step) -> list[Episode]:
        done = step.terminated | step.truncated
        lanes = np.flatnonzero(done)
        if not len(lanes):
            return []
        episodes = [
            Episode(
                int(self._order[lane]),
                int(self._started[lane]),
                self.frames,
                float(step.score[lane]),
                int(self.environment.t[lane]),
                self.player.scenes(int(lane)),
            )
            for lane in lanes
        ]
        if self.recorder is not None:
            for episode, lane in zip(episodes, lanes.tolist(), strict=True):
                self.recorder.end(self.environment, episode, lane)
        self.environment.reset(done)
        self._order[lanes] = self._order.max() + 1 + np.arange(len(lanes))
        self._started[lanes] = self.frames
        return episodes


class Learning:
    """Act, update, again, within a budget. Between two rounds all that it needs is in its attributes.

    Args:
        environment: B environments.
        agent: Who learns.
        frames: The budget: as many whole rounds as it holds, and one at least.
        recorder: Keeps some of the episodes, if there is one.

    Attributes:
        round: Frames of a round, at most.
        left: Rounds to come.
    """

    def __init__(
        self, environment: Environment, agent: Agent, frames: int, recorder: Recorder | None = None
    ) -> None:
        self.agent = agent
        self.interaction = Interaction(environment, agent, recorder)
        self.budget = frames
        self.round = agent.rollout_steps * environment.num_envs * environment.action_repeat
        self.left = max(1, frames // self.round)

    @property
    def frames(self) -> int:
        """Steps of the task so far."""
        return self.interaction.frames

    def __iter__(self) -> "Learning":
        return self

    def __next__(self) -> Round:
        if not self.left:
            raise StopIteration
        episodes = self.interaction.run(self.agent.rollout_steps)
        figures = self.agent.update(self.interaction.environment, self.frames / self.budget)
        self.left -= 1
        return Round(self.frames, episodes, dict(figures))
