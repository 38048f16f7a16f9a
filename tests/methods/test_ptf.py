"""What options learn and what the target imitates, as worked by hand: two options, three states."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from paddlectl.agents.flat import FlatPolicy, FlatSettings
from paddlectl.agents.interaction import Learning
from paddlectl.errors import UsageError
from paddlectl.learners.replay import Transitions
from paddlectl.methods.base import Setup, method_of
from paddlectl.methods.flat import USUAL
from paddlectl.methods.ptf import (
    OPTIONS,
    Arrivals,
    Options,
    OptionSettings,
    PTFOverPPO,
    PTFOverTD3,
    PTFSettings,
    decay,
)
from paddlectl.tasks.suite import load
from scripted import FAR, TASK, Corridor, as_source

HALF = OptionSettings(
    discount=0.5, learning_rate=0.125, termination_rate=0.125, regulariser=0.25, capacity=64
)
Q = [[1.0, 2.0], [3.0, 0.0], [0.0, 0.0]]  # of each state
SLOW = [[4.0, 8.0], [5.0, 7.0], [0.0, 0.0]]
BETA = [[0.5, 0.25], [0.25, 0.75], [0.5, 0.5]]


def table(rows):
    """Gives the row of a state, which is told by a one."""
    made = nn.Linear(len(rows), len(rows[0]), bias=False)
    made.weight.data = torch.tensor(rows).T.contiguous()
    return made


def by_tables(options):
    """Q, Q' and β as above."""
    options.online, options.slow = table(Q), table(SLOW)
    options.termination = table(torch.tensor(BETA).logit().tolist())
    for name in ("online", "termination"):
        parameters = getattr(options, name).parameters()
        setattr(options, f"{name}_optimiser", torch.optim.SGD(parameters, lr=options.settings.learning_rate))
    return options


def states(*numbers):
    return torch.eye(3)[list(numbers)]


def transitions(begun, rewards, ends, followed, alike):
    return Transitions(
        states(*begun),
        torch.tensor(alike),
        torch.tensor(rewards),
        torch.tensor(ends),
        states(*followed),
        torch.zeros(len(rewards)),
    )


def test_the_value_on_arrival_and_the_target_of_q():
    options = by_tables(Options(3, 1, 2, 0, HALF))
    batch = transitions([2] * 3, [0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [0, 1, 0], [[1.0, 1.0]] * 3)
    # in 0, Q is largest for option 1, worth 8 by Q':  0.5 · 4 + 0.5 · 8 = 6,     0.75 · 8 + 0.25 · 8 = 8
    # in 1, for option 0, worth 5:                    0.75 · 5 + 0.25 · 5 = 5,  0.25 · 7 + 0.75 · 5 = 5.5
    # y = r + 0.5 U, and r where the task was solved
    assert options.targets(batch).tolist() == [[3.0, 4.0], [3.5, 3.75], [1.0, 1.0]]


def test_only_options_that_would_have_done_the_same_learn():
    options = by_tables(Options(3, 1, 2, 0, HALF))
    options.improve_values(transitions([0, 1], [7.0, 7.0], [1.0, 1.0], [2, 2], [[1.0, 0.0], [0.0, 1.0]]))
    # the mean over two transitions of (Q - 7)²: Q moves by 0.125 · (7 - Q)
    assert options.values(states(0, 1, 2)).tolist() == [[1.75, 2.0], [3.0, 0.875], [0.0, 0.0]]
    assert options.slow(states(0)).tolist() == [SLOW[0]]


def test_the_slow_copy_follows_now_and_then():
    options = by_tables(Options(3, 1, 2, 0, replace(HALF, refresh_every=2)))
    batch = transitions([0], [7.0], [1.0], [2], [[1.0, 1.0]])
    for copied in (False, True):
        options.improve_values(batch)
        assert torch.equal(options.slow.weight, options.online.weight) == copied


@pytest.mark.parametrize(
    "option, advantage, within, change",
    [(0, -1.0, 1.0, 1), (1, 0.0, 1.0, -1), (1, -0.125, 1.0, -1), (0, -1.0, 0.0, 0)],
    ids=["a worse option ends sooner", "the best goes on", "a hardly worse one too", "no step within"],
)
def test_an_option_ends_where_another_is_better(option, advantage, within, change):
    options = by_tables(Options(3, 1, 2, 0, HALF))
    before = options.terminations(states(0, 1, 2))
    columns = torch.tensor([option]), torch.tensor([advantage]), torch.tensor([within])
    options.improve_termination(Arrivals(states(0), *columns))
    changes = (options.terminations(states(0, 1, 2)) - before).sign()
    expected = torch.zeros(3, 2)
    expected[0, option] = change
    assert changes.tolist() == expected.tolist()


def test_the_step_of_a_termination():
    options = by_tables(Options(3, 1, 2, 0, HALF))
    columns = torch.tensor([0]), torch.tensor([-1.25]), torch.tensor([1.0])
    options.improve_termination(Arrivals(states(0), *columns))
    # σ(0) = 0.5, dβ = 0.25; the logit moves by -0.125 · 0.25 · (-1.25 + 0.25)
    assert options.termination(states(0))[0, 0].item() == pytest.approx(0.03125)


@pytest.mark.parametrize("gap, low, high", [(0.01, 0.45, 0.55), (1.0, 0.9, 1.0)])
def test_values_that_hardly_differ_end_no_option_for_good(gap, low, high):
    options = Options(3, 1, 2, 0, replace(OPTIONS["ppo"], regulariser=0.0, termination_rate=0.1))
    columns = torch.tensor([0] * 3), torch.tensor([-gap] * 3), torch.ones(3)
    for _ in range(100):
        options.improve_termination(Arrivals(states(0, 1, 2), *columns))
    ending = options.terminations(states(0, 1, 2))[:, 0]
    assert low < ending.min() <= ending.max() < high


def test_imitation_ends_with_the_episodes():
    told = [decay(episode, 0.001) for episode in (0, 3000, 6000)]
    assert told == pytest.approx([0.5 + np.tanh(3) / 2, 0.5, 0.5 - np.tanh(3) / 2])
    assert told[0] > 0.997


class Scripted:
    """Prefers an action, or does it."""

    def __init__(self, *preferred):
        self.preferred = torch.tensor(preferred)

    def log_probs(self, states):
        return self.preferred.log().expand(len(states), -1)

    def actions_of(self, states):
        return self.preferred.expand(len(states), -1)


def agent(*learners, task=TASK, num_envs=1, rollout_steps=4, learner="ppo", **options):
    """Learns the task from sources that are scripted."""
    settings = PTFSettings(
        num_envs=num_envs,
        rollout_steps=rollout_steps,
        learner=USUAL[learner].learner,
        options=replace(HALF, **options),
    )
    sources = [
        as_source(f"policy-{n}", FlatPolicy(task, 0, FlatSettings(learner=settings.learner)))
        for n in range(len(learners))
    ]
    for source, scripted in zip(sources, learners, strict=True):
        source.policy.learner = scripted
    return method_of("ptf").make(Setup(task, settings, 0, 100, sources))


LEFTWARD, RIGHTWARD = (0.5, 0.25, 0.25), (0.25, 0.25, 0.5)


def test_the_imitation_loss_over_ppo_is_of_the_option_that_was_current():
    made = agent(Scripted(*LEFTWARD), Scripted(*RIGHTWARD))
    answers = made.answers(torch.zeros(2, 4))[torch.arange(2), [0, 1]]
    loss = made.imitation(answers, torch.tensor([0.5, 1.0]), 9.0)
    log_probs = torch.tensor([[0.25, 0.5, 0.25], [0.25, 0.25, 0.5]]).log2()  # of places 1 and 0
    # place 1 follows option 1: 0.25 · 2 + 0.25 · 1 + 0.5 · 2
    # place 0 follows option 0, half as much: 0.5 · (0.5 · 2 + 0.25 · 2 + 0.25 · 1)
    assert loss(torch.tensor([1, 0]), log_probs).item() == pytest.approx((1.75 + 0.875) / 2)


MAZE = "CoffeeMailMaze"


def test_the_imitation_loss_over_td3_is_of_the_option_that_is_greedy():
    made = agent(
        Scripted(1.0, 0.0), Scripted(0.0, 1.0), task=load(MAZE), learner="td3", deviation=0.5, imitation=2.0
    )
    assert isinstance(made, PTFOverTD3)
    by_tables(made._options)
    batch = transitions([0, 1], [0.0] * 2, [0.0] * 2, [0] * 2, [[0.0] * 2] * 2)
    actions = torch.tensor([[0.0, 0.5], [0.5, 0.5]], requires_grad=True)
    loss = made.imitation(torch.zeros(0), torch.zeros(0), 2.0)(batch, actions)
    # state 0 follows option 1: 2 · 0.75 · 0.25; state 1 option 0: 2 · 0.75 · (0.25 + 0.25); over 2 · 0.25
    assert loss.item() == pytest.approx((0.375 + 0.75) / 2 / 0.5)
    loss.backward()
    assert (actions - actions.grad)[0, 1] > 0.5, "drawn to the source's action"


def test_who_would_have_done_the_same():
    made = agent(Scripted(*LEFTWARD), Scripted(*RIGHTWARD))
    answers = made.answers(torch.zeros(3, 4))
    assert made.alike(answers, torch.tensor([0, 1, 2])).tolist() == [
        [True, False],
        [False] * 2,
        [False, True],
    ]
    made = agent(Scripted(0.5, 0.0), Scripted(0.0, 0.0), task=load(MAZE), learner="td3", deviation=0.25)
    actions = torch.tensor([[0.25, 0.25], [0.25, 0.5], [-0.25, 0.0], [0.75, -0.25]])
    told = made.alike(made.answers(torch.zeros(4, 9)), actions).tolist()
    assert told == [[True, True], [False, False], [False, True], [True, False]]


def test_an_option_is_picked_at_the_start_and_where_one_ends():
    made = agent(Scripted(*LEFTWARD), Scripted(*RIGHTWARD), exploration=0.0, final_exploration=0.0)
    values = np.float32([[[0, 1]], [[1, 0]], [[1, 0]], [[0, 1]]])
    ending = np.float32([[[0, 0]], [[1, 0]], [[0, 0]], [[1, 0]]])
    made._buffer.truncated[1] = True
    by, current, within = (column.tolist() for column in made.follow(values, ending))
    # 1 is picked, and stays though 0 is better; with the next episode 0 is picked, and it ends at once
    assert current == [1, 1, 0, 1]
    assert by[1:] == [1, 1, 0]
    assert within == [False, True, False, True]
    made._buffer.truncated[1] = False
    by, current, within = (column.tolist() for column in made.follow(values, np.zeros_like(ending)))
    assert (by, current, within) == ([1] * 4, [1] * 4, [True] * 4), "from one block to the next"


def test_picks_are_random_the_less_the_more_episodes_ended():
    made = agent(
        Scripted(*LEFTWARD),
        Scripted(*RIGHTWARD),
        exploration=1.0,
        exploration_fall=0.25,
        final_exploration=0.125,
    )
    values = np.tile(np.float32([0, 1]), (4000, 1))
    for made._episodes, others in ((0, 0.5), (2, 0.25), (9, 0.0625)):
        assert (made.pick(values) == 0).mean() == pytest.approx(others, abs=0.03)


def test_a_block_teaches_the_current_option_and_is_told(monkeypatch):
    made = agent(Scripted(0.0, 0.0, 1.0), Scripted(1.0, 0.0, 0.0), num_envs=2, exploration=0.0)
    kept = []
    monkeypatch.setattr(made._options, "learn", lambda *given: kept.append(given))
    monkeypatch.setattr(made._options, "values", lambda states: torch.tensor([[3.0, 1.0]]).expand(8, -1))
    monkeypatch.setattr(
        made._options, "terminations", lambda states: torch.tensor([[0.25, 1.0]]).expand(8, -1)
    )
    (round_,) = Learning(Corridor(2, 0), made, 8)
    ((_, alike, arrivals),) = kept
    actions = made._buffer.actions
    assert alike[..., 0].all(), "current"
    assert (alike[..., 1] == (actions == 0)).all()
    assert arrivals.within.tolist() == [False] * 2 + [True] * 6
    assert arrivals.advantages.tolist() == [0.0] * 8
    assert round_.figures["imitation"] == pytest.approx(0.75 * decay(0, 0.001))
    rows = [row for row in made.reuse() if FAR not in row.context]
    assert [row.source for row in rows[:3]] == ["target", "policy-0", "policy-1"]
    assert [row.weight for row in rows[:3]] == [0.0, 3.0, 1.0]
    assert [row.terms["termination"] for row in rows[:3]] == [0.0, 0.25, 1.0]
    assert sum(row.chosen for row in rows) == sum(row.chosen for row in rows if row.source == "policy-0") == 8


@pytest.mark.parametrize("weight, same", [(0.0, True), (1.0, False)])
def test_without_imitation_it_is_the_learner_alone(weight, same):
    made = agent(Scripted(*LEFTWARD), imitation=weight)
    alone = method_of("ppo").make(Setup(TASK, replace(USUAL["ppo"], num_envs=1, rollout_steps=4), 0, 100))
    for each in (made, alone):
        list(Learning(Corridor(1, 0), each, 8))
    mine, theirs = made.policy().state(), alone.policy().state()
    assert all(torch.equal(mine[name], theirs[name]) for name in theirs) == same


def test_the_target_comes_to_do_as_its_source():
    made = agent(Scripted(0.01, 0.01, 0.98), num_envs=4, rollout_steps=16)
    list(Learning(Corridor(4, 0), made, 640))
    assert isinstance(made, PTFOverPPO)
    states = torch.from_numpy(Corridor(4, 0).flat_state())
    assert made.policy().learner.log_probs(states).exp()[:, 2].min() > 0.8


@pytest.mark.parametrize("name", ["BoxDoor", MAZE])
def test_without_sources_it_is_refused(name):
    task, method = load(name), method_of("ptf")
    with pytest.raises(UsageError, match=f"ptf needs a source for {name}, and has none") as told:
        method.make(Setup(task, method.settings_for(task, None), 0, 100))
    kind = {"BoxDoor": "ppo", MAZE: "td3"}[name]
    assert told.value.hint == f"learn it alone: paddlectl train {name} --method {kind}"


def test_its_settings_are_closed():
    task, method = load("BoxDoor"), method_of("ptf")
    usual = method.settings_for(task, None, {"options": {"decay": 0.5}})
    assert usual.options == replace(OPTIONS["ppo"], decay=0.5)
    assert usual.learner == USUAL["ppo"].learner
    assert method.settings_for(load(MAZE), None).options == OPTIONS["td3"]
    for wrong in ({"options": {"slope": 1}}, {"options": 3}, {"options": {"decay": "0.5"}}, {"option": {}}):
        with pytest.raises(ValueError, match=r"can't be|have no"):
            method.settings_from(task, wrong)
