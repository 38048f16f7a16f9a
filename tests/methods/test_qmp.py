"""The Q-switch worked by hand, and what is learned from what it chose."""

import json

import numpy as np
import pytest
import torch

from paddlectl.agents.flat import FlatPolicy, FlatSettings
from paddlectl.agents.interaction import Learning
from paddlectl.experiments import snapshot
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.dqn import StepDQNSettings, n_step
from paddlectl.learners.td3 import TD3Settings
from paddlectl.methods.base import Setup, method_of
from paddlectl.methods.qmp import QMPAgent, switch
from paddlectl.tasks.suite import load
from scripted import HORIZON, LEFT, RIGHT, STAY, TASK, ByScript, Corridor, as_source, learning

GOES_RIGHT = [[0.0, 0.1, 0.2]] * 20
"""Q of left, stay and right at each place."""


class Known(ByScript):
    """Acts by script, with a table of Q by place, and remembers what it could have learned from."""

    def __init__(self, *actions, values=GOES_RIGHT):
        super().__init__(*actions)
        self.values = torch.tensor(values)
        self.blocks = []

    def values_of(self, observations, actions):
        return self.values[(10 * observations[:, 0]).round().long(), actions]

    def update(self, buffer):
        self.blocks.append({name: column.copy() for name, column in vars(buffer).items()})


def policy(learner, num_envs=1, steps=3):
    made = FlatPolicy(TASK, 0, FlatSettings(num_envs=num_envs, rollout_steps=steps))
    made.learner = learner
    return made


def agent(learner, *sources, num_envs=1, steps=3):
    named = {f"policy-{n}": policy(source) for n, source in enumerate(sources, start=1)}
    return QMPAgent(policy(learner, num_envs, steps), np.random.default_rng(0), named, 10**6)


def told(made):
    """Who -> how often it acted, and the mean Q of what it proposed, where only one scene was met."""
    rows = list(made.reuse())
    assert all(row.terms == {"Q": row.weight} for row in rows)
    return {row.source: (row.chosen, pytest.approx(row.weight)) for row in rows}


def test_the_largest_q_acts_and_of_equals_the_target():
    values = np.float32(
        [[0.1, 0.3, 0.2], [0.3, 0.1, 0.2], [0.2, 0.2, 0.1], [0.1, 0.2, 0.2], [-2.0, -3.0, -1.0]]
    )
    assert switch(values).tolist() == [1, 0, 0, 1, 2]


def test_by_the_targets_own_q_a_source_acts_where_it_is_better():
    """Right is best at the cells 0 and 2, staying at cell 1."""
    values = [[0.0, 0.1, 0.2], [0.0, 0.3, 0.2], [0.0, 0.1, 0.2]]
    target = Known(LEFT, RIGHT, STAY, values=values)
    made = agent(target, ByScript(RIGHT), ByScript(STAY), steps=3)
    list(Learning(Corridor(1, 0), made, 3))
    (block,) = target.blocks
    # proposed: left, right, stay at cell 0; right, right, stay at cell 1, twice
    assert block["actions"][:, 0].tolist() == [RIGHT, STAY, STAY]
    assert block["observations"][:, 0, 0] == pytest.approx(np.array([0.0, 0.1, 0.1]))
    assert block["last_observations"][0, 0] == pytest.approx(0.1), "what was executed is what is learned from"


def test_it_is_told_who_acted_and_what_their_actions_were_worth():
    made = agent(Known(LEFT, RIGHT, STAY), ByScript(RIGHT, RIGHT, LEFT), ByScript(STAY), num_envs=2, steps=3)
    list(Learning(Corridor(2, 0), made, 6))
    # left, right, stay; right, right, stay, a tie; stay, left, stay, a tie: of two lanes each
    assert told(made) == {
        "target": (4, (0.0 + 0.2 + 0.1) / 3),
        "policy-1": (2, (0.2 + 0.2 + 0.0) / 3),
        "policy-2": (0, 0.1),
    }


def test_a_source_acts_as_it_was_learned_and_learns_nothing():
    source = policy(Known(RIGHT)).learner
    made = agent(Known(LEFT), source)
    list(Learning(Corridor(1, 0), made, 3))
    assert source.blocks == [] and len(source.seen) == 3
    assert told(made)["policy-1"][0] == 3


def test_without_sources_it_is_its_learner_alone():
    target = Known(LEFT, RIGHT, STAY)
    made = agent(target)
    list(Learning(Corridor(1, 0), made, 3))
    assert target.blocks[0]["actions"][:, 0].tolist() == [LEFT, RIGHT, STAY]
    assert told(made) == {"target": (3, 0.1)}


def transitions(steps, *actions, discount=0.5):
    """What a lane of the corridor is learned from: actions, rewards, discounts, and places/10, time after."""
    target = Known(*actions)
    list(Learning(Corridor(1, 0), agent(target, steps=len(actions)), len(actions)))
    return n_step(RolloutBuffer(**target.blocks[0]), steps, discount)


def test_a_solved_task_has_no_future():
    """Cell 2 pays 0.1, and cell 5 solves for 0.5; then the next layout begins."""
    one = transitions(1, *[RIGHT] * 6)
    assert one.rewards == pytest.approx(np.array([0, 0.1, 0, 0, 0.5, 0]))
    assert one.discounts == pytest.approx(np.array([0.5, 0.5, 0.5, 0.5, 0.0, 0.5]))
    assert one.following[:, 0] == pytest.approx(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.1]))
    three = transitions(3, *[RIGHT] * 6)
    assert three.states == pytest.approx(one.states)
    assert three.actions.tolist() == [RIGHT] * 6
    # no return crosses the end of the episode, nor that of the block
    assert three.rewards == pytest.approx(np.array([0.05, 0.1, 0.125, 0.25, 0.5, 0]))
    assert three.discounts == pytest.approx(np.array([0.125, 0.125, 0.0, 0.0, 0.0, 0.5]))
    assert three.following[:, 0] == pytest.approx(np.array([0.3, 0.4, 0.5, 0.5, 0.5, 0.1]))
    assert {column.dtype for column in (three.rewards, three.discounts)} == {np.dtype(np.float32)}


def test_the_horizon_has_one_and_its_last_state_is_the_true_one():
    batch = transitions(2, RIGHT, RIGHT, LEFT, *[STAY] * (HORIZON - 3))
    assert batch.discounts == pytest.approx(np.array([0.25] * (HORIZON - 1) + [0.5]))
    assert batch.following[-2:] == pytest.approx(np.float32([[0.1, 0, 1, 1]] * 2)), "not the next layout"


def test_a_source_acts_only_where_a_dqn_explores():
    shares = []
    for rate in (0.0, 0.5, 1.0):
        target = StepDQNSettings().learner(4, 3, 0)
        target.dqn.exploration = rate
        made = agent(target, StepDQNSettings().learner(4, 3, 1), num_envs=100)
        made.act(Corridor(100, 0))
        shares.append(1.0 - told(made)["target"][0] / 100)
    assert shares[0] == 0.0 and shares[0] < shares[1] < shares[2]


def test_td3_proposes_as_it_explores_and_its_source_what_it_means():
    task, learner = load("MailMaze"), TD3Settings(hidden=(8,))
    settings = FlatSettings(num_envs=50, rollout_steps=2, learner=learner)
    target, source = FlatPolicy(task, 0, settings), FlatPolicy(task, 1, settings)
    environment = task.make(50, 0)
    states = environment.flat_state()
    meant = source.learner.actions_of(torch.from_numpy(states))
    made = QMPAgent(target, np.random.default_rng(0), {"policy-1": source}, 10**6)
    target.learner.values_of = lambda states, actions: -(actions - meant).abs().sum(-1)
    assert (made.act(environment) == meant.numpy()).all(), "the source's own is nearest"
    target.learner.values_of = lambda states, actions: (actions - meant).abs().sum(-1)
    own = made.act(environment)
    assert len(np.unique(own, axis=0)) == 50 and (own != meant.numpy()).all()
    assert own.dtype == np.float32 and np.abs(own).max() <= 1.0


SMALL = {
    "num_envs": 2,
    "rollout_steps": 4,
    "learner": {"warm_up": 8, "update_every": 2, "batch": 8, "capacity": 1000},
}


@pytest.mark.parametrize(
    "target, given, teacher", [("BoxDoor", "DoorBall", "ppo"), ("MailMaze", "CoffeeMaze", "td3")]
)
def test_who_goes_on_from_a_checkpoint_learns_the_same(target, given, teacher):
    """Beside the contract of all methods, which ends before a replay is large enough to learn from."""

    def begun():
        task, method, theirs = load(target), method_of("qmp"), method_of(teacher)
        source = theirs.policy(load(given), 1, theirs.settings_for(load(given), None))
        settings = method.settings_for(task, None, SMALL)
        return learning(method, Setup(task, settings, 0, 10**6, [as_source("policy-1", source)]))

    whole, fresh = begun(), begun()
    first = whole.agent.policy().state()
    before = {name: tensor.clone() for name, tensor in first.items()}
    for _ in range(3):
        next(whole)
    assert any((first[name] != before[name]).any() for name in first)
    tree, arrays = snapshot.capture({"learning": whole})
    snapshot.restore({"learning": fresh}, json.loads(json.dumps(tree)), arrays)
    assert [next(whole) for _ in range(2)] == [next(fresh) for _ in range(2)]
    ends = [made.agent.policy().state() for made in (whole, fresh)]
    assert all(torch.equal(ends[0][name], ends[1][name]) for name in before)
    assert list(whole.agent.reuse()) == list(fresh.agent.reuse())
