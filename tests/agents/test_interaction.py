"""The loop, step by step in the corridor, where all can be worked by hand."""

import numpy as np
import pytest

from paddlectl.agents.interaction import Interaction, Learning
from scripted import HORIZON, RIGHT, STAY, Corridor


class Walker:
    """Takes the same step in every lane, and remembers what it was told."""

    rollout_steps = 4

    def __init__(self, action=RIGHT):
        self._action = action
        self.seen, self.updates = [], []

    def act(self, environment):
        return np.full(environment.num_envs, self._action)

    def observe(self, environment, step):
        done = step.terminated | step.truncated
        self.seen.append((environment.place.tolist(), environment.t.tolist(), done.tolist()))

    def scenes(self, lane):
        return (len(self.seen), lane)

    def update(self, environment, progress):
        self.updates.append((environment.place.tolist(), progress))
        return {"updates": len(self.updates)}


# order, started, finished, score, length of all that end within 12 steps of three lanes that walk right;
# layouts 0, 1, 2 end at cells 5, 6, 7, and so do 3, 4, 5
WALKS = [
    (0, 0, 15, 0.5, 5),
    (1, 0, 18, 0.505, 6),
    (2, 0, 21, 0.51, 7),
    (3, 15, 30, 0.515, 5),
    (4, 18, 36, 0.52, 6),
]


@pytest.mark.parametrize("blocks", [[12], [5, 7], [1] * 12])
def test_frames_and_the_order_of_starting_whatever_the_blocks(blocks):
    interaction = Interaction(Corridor(3, 0), Walker())
    episodes = [episode for steps in blocks for episode in interaction.run(steps)]
    assert [episode[:5] for episode in episodes] == [(*e[:3], pytest.approx(e[3]), e[4]) for e in WALKS]
    assert interaction.frames == 36


def test_the_player_sees_how_an_episode_ended_before_the_lane_is_reset():
    player = Walker()
    (episode,) = Interaction(Corridor(2, 0), player).run(5)
    assert player.seen[-1] == ([5, 5], [5, 5], [True, False])
    assert episode.scenes == (5, 0), "asked of the lane after it was told of the end"


def test_a_lane_that_has_ended_goes_on_in_the_next_layout():
    interaction = Interaction(Corridor(2, 0), Walker())
    interaction.run(5)
    environment = interaction.environment
    assert environment.place.tolist() == [0, 5]
    assert environment.t.tolist() == [0, 5]
    assert environment.layout.tolist() == [2, 1]


def test_an_episode_ends_at_the_horizon_with_nothing():
    episodes = Interaction(Corridor(2, 0), Walker(STAY)).run(HORIZON)
    assert [e[:5] for e in episodes] == [(n, 0, 2 * HORIZON, 0.0, HORIZON) for n in (0, 1)]


def test_only_steps_that_were_taken_count():
    """An action of several steps ends with its episode."""

    class Repeating(Corridor):
        def __init__(self, num_envs, seed):
            super().__init__(num_envs, seed)
            self.action_repeat = 4

        def step(self, actions):
            step = super().step(actions)
            for _ in range(3):
                running = ~(step.terminated | step.truncated)
                place, t = self.place.copy(), self.t.copy()
                step = step.then(super().step(actions))
                self.place, self.t = np.where(running, self.place, place), np.where(running, self.t, t)
            return step

    interaction = Interaction(Repeating(1, 0), Walker())
    (episode,) = interaction.run(2)  # cell 5 in the first step of the second action
    assert (interaction.frames, episode.finished, episode.length) == (5, 5, 5)


@pytest.mark.parametrize("frames, rounds", [(1, 1), (24, 2), (35, 2), (36, 3)])
def test_learning_runs_as_many_whole_rounds_as_its_budget_holds_and_one_at_least(frames, rounds):
    player = Walker()
    learning = Learning(Corridor(3, 0), player, frames)
    assert (learning.round, learning.left) == (12, rounds)
    told = list(learning)
    assert [round_.frames for round_ in told] == [12 * (n + 1) for n in range(rounds)]
    assert [round_.figures for round_ in told] == [{"updates": n + 1} for n in range(rounds)]
    assert sum(len(round_.episodes) for round_ in told) == sum(e[2] <= 12 * rounds for e in WALKS)
    assert learning.left == 0
    # after 4, 8 and 12 steps; cells 5, 6 and 7 are ends
    places = [[4, 4, 4], [3, 2, 1], [2, 0, 5]]
    assert player.updates == [(places[n], 12 * (n + 1) / frames) for n in range(rounds)]
