"""What a flat learner is given of the corridor, as worked by hand."""

import numpy as np
import pytest

from paddlectl.agents.flat import FlatAgent, FlatPolicy, FlatSettings
from paddlectl.agents.interaction import Interaction, Learning
from scripted import HORIZON, LEFT, RIGHT, STAY, TASK, ByScript, Corridor


class Reader(ByScript):
    """Remembers what it could have learned from."""

    def __init__(self, *actions):
        super().__init__(*actions)
        self.blocks, self.progress = [], []

    def anneal(self, done):
        self.progress.append(done)

    def update(self, buffer):
        self.blocks.append({name: column.copy() for name, column in vars(buffer).items()})
        return {}


def agent(learner, num_envs, steps, reward_unit=1.0):
    policy = FlatPolicy(
        TASK, 0, FlatSettings(num_envs=num_envs, rollout_steps=steps, reward_unit=reward_unit)
    )
    policy.learner = learner
    return FlatAgent(policy, np.random.default_rng(0))


def states(lanes):
    """place/10, layout, paid, time."""
    return pytest.approx(np.array(lanes, np.float32))


def test_a_block_of_two_lanes_that_walk_right():
    learner = Reader(RIGHT)
    made = agent(learner, 2, 7)
    (round_,) = Learning(Corridor(2, 0), made, 14)
    (block,) = learner.blocks
    # cell 2 pays 0.1; layouts 0 and 1 end at cells 5 and 6 for 0.5 and 0.505; then come layouts 2 and 3
    rewards = block["rewards"].T
    assert rewards == pytest.approx(np.array([[0, 0.1, 0, 0, 0.5, 0, 0.1], [0, 0.1, 0, 0, 0, 0.505, 0]]))
    ends = [(4, 0), (5, 1)]
    for name in ("ends", "terminated"):
        assert list(zip(*block[name].nonzero(), strict=True)) == ends
    assert not block["cut"].any() and not block["truncated"].any()
    assert block["observations"][:, 0, 0] == pytest.approx(np.array([0, 1, 2, 3, 4, 0, 1]) / 10)
    assert block["observations"][2] == states([[0.2, 0, 1, 2 / 12], [0.2, 1, 1, 2 / 12]])
    assert block["final_observations"][4, 0] == states([0.5, 0, 1, 5 / 12]), (
        "as it ended, not the next layout"
    )
    assert block["final_observations"][5, 1] == states([0.6, 1, 1, 6 / 12])
    assert block["last_observations"] == states([[0.2, 2, 1, 2 / 12], [0.1, 0, 0, 1 / 12]])
    assert (block["actions"] == RIGHT).all() and (block["log_probs"] == -0.5).all()
    assert not block["guides"].any()
    assert [(e.score, e.scenes) for e in round_.episodes] == [(0.5, ()), (pytest.approx(0.505), ())]
    assert learner.progress == [1.0]


def test_the_horizon_is_no_end():
    learner = Reader(RIGHT, RIGHT, LEFT, STAY)
    list(Learning(Corridor(1, 0), agent(learner, 1, HORIZON), HORIZON))
    (block,) = learner.blocks
    last = [(HORIZON - 1, 0)]
    for name in ("ends", "cut", "truncated"):
        assert list(zip(*block[name].nonzero(), strict=True)) == last
    assert not block["terminated"].any()
    assert block["final_observations"][-1, 0] == states([0.1, 0, 1, 1])
    assert block["last_observations"][0] == states([0, 1, 0, 0])


def test_blocks_follow_each_other_and_rewards_are_counted_in_their_unit():
    learner = Reader(RIGHT)
    list(Learning(Corridor(1, 0), agent(learner, 1, 3, reward_unit=10.0), 6))
    first, second = learner.blocks
    assert first["last_observations"] == pytest.approx(second["observations"][0])
    assert first["rewards"][:, 0] == pytest.approx([0, 0.01, 0])
    assert second["rewards"][:, 0] == pytest.approx([0, 0.05, 0])
    assert learner.progress == [0.5, 1.0]


def test_a_player_sees_what_its_learner_saw_and_teaches_it_nothing():
    learner = Reader(RIGHT)
    policy = agent(learner, 2, 7).policy()
    (episode,) = Interaction(Corridor(1, 0), policy.player(TASK, 1, np.random.SeedSequence(0))).run(5)
    assert (episode.score, episode.scenes) == (0.5, ())
    assert [seen[0, 0] for seen in learner.seen] == pytest.approx(np.arange(5) / 10)
    assert learner.blocks == []


def test_it_tells_nothing_but_its_figures():
    made = agent(Reader(RIGHT), 1, 3)
    assert (made.reuse(), made.record(3, [], 0), made.close(), made.documents()) == ((), {}, {}, {})
