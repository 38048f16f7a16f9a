"""CUP: who guides, how strongly and what is learned from it, as worked by hand."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from paddlectl.errors import UsageError
from paddlectl.experiments import snapshot
from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.methods.base import Setup, method_of
from paddlectl.methods.catalogue import METHODS
from paddlectl.methods.cup import CUP, ActionValues, CUPSettings, over_ppo, over_td3
from paddlectl.tasks.suite import load
from scripted import RIGHT, STAY, as_source, learning
from scripted import TASK as CORRIDOR

USUAL = CUPSettings()
WIDE = CUPSettings(cap=0.5)

# three states, three actions, two sources
TARGET = torch.tensor([[0.5, 0.25, 0.25], [0.5, 0.25, 0.25], [0.5, 0.25, 0.25]])
SOURCES = torch.tensor(
    [
        [[0.1, 0.1, 0.8], [0.7, 0.2, 0.1]],
        [[0.25, 0.25, 0.5], [0.25, 0.5, 0.25]],
        [[0.25, 0.5, 0.25], [0.25, 0.25, 0.5]],
    ]
)
Q = torch.tensor([[1.0, 0.0, 2.0], [-2.0, 2.0, -2.0], [3.0, 2.0, 2.0]])
# E Q of the target is 1, -1, 2.5; of the sources 1.7 and 0.9, -1 and 0, 2.25 and 2.25
ADVANTAGES = [[0.0, 0.7, -0.1], [0.0, 0.0, 1.0], [0.0, -0.25, -0.25]]
GUIDES = [1, 2, 0]


def by_tables(settings, target=TARGET):
    return over_ppo(target.log(), SOURCES.log(), Q, settings)


def divergence(p, q):
    return float((p * (p / q).log()).sum())


def test_the_candidate_of_largest_advantage_guides_and_the_target_is_one_of_them():
    found = by_tables(USUAL)
    assert found.advantages.numpy() == pytest.approx(np.array(ADVANTAGES), abs=1e-6)
    assert found.guide.tolist() == GUIDES


@pytest.mark.parametrize(
    "settings, coefficients",
    [
        (USUAL, [30 * 0.003, 30 * 0.003, 0.0]),  # |V| is 1 in both
        (WIDE, [30 * 0.5, 30 * 0.5, 0.0]),
        (CUPSettings(cap=0.9), [30 * 0.7, 30 * 0.9, 0.0]),  # the first advantage is below the cap
        (CUPSettings(weight=2.0, cap=10.0), [2 * 0.7, 2 * 1.0, 0.0]),
    ],
)
def test_the_penalty_is_the_divergence_from_the_guide_times_the_capped_advantage(settings, coefficients):
    apart = [divergence(TARGET[0], SOURCES[0, 0]), divergence(TARGET[1], SOURCES[1, 1]), 9.9]
    by_hand = sum(c * d for c, d in zip(coefficients, apart, strict=True)) / 3
    assert by_tables(settings).loss.item() == pytest.approx(by_hand, rel=1e-5)


def test_its_gradient_leads_to_the_guide_and_nowhere_else():
    logits = TARGET.log().requires_grad_()
    over_ppo(logits.log_softmax(-1), SOURCES.log(), Q, WIDE).loss.backward()
    for n, source in ((0, 0), (1, 1)):
        ratio = (TARGET[n] / SOURCES[n, source]).log()
        # of KL(π || π_g) by the logits: π (log π / π_g - KL); the coefficient has none
        by_hand = 15 * TARGET[n] * (ratio - (TARGET[n] * ratio).sum()) / 3
        assert logits.grad[n].numpy() == pytest.approx(by_hand.numpy(), rel=1e-4, abs=1e-6)
    assert not logits.grad[2].any(), "the target guides itself"
    nearer = (TARGET.log() - 0.1 * logits.grad).softmax(-1)
    assert divergence(nearer[0], SOURCES[0, 0]) < divergence(TARGET[0], SOURCES[0, 0])


def test_over_td3_the_guide_is_whose_action_is_worth_most():
    """Q(s, a) = s - |a|², in s = 1 and s = -1: the source that stays at 0 is 0.25 better than (0.5, 0)."""
    states = torch.tensor([[1.0], [-1.0]])
    actions = torch.tensor([[0.5, 0.0], [0.0, 0.0]], requires_grad=True)
    critic = SimpleNamespace(values_of=lambda s, a: s[:, 0] - a.square().sum(-1))
    sources = [
        SimpleNamespace(actions_of=lambda s, to=to: torch.full((len(s), 2), to)) for to in (1.0, 0.0, 0.5)
    ]
    found = over_td3(actions, states, sources, critic, USUAL)
    by_hand = np.array([[0.0, -1.75, 0.25, -0.25], [0.0, -2.0, 0.0, -0.5]])
    assert found.advantages.numpy() == pytest.approx(by_hand)
    assert found.guide[0] == 2
    # V(s) = 0.75, so β1 β2 |V| = 0.0675; D = 0.5² / (2 · 0.2²) = 3.125; in the second state nobody is better
    assert found.loss.item() == pytest.approx(0.0675 * 3.125 / 2)
    found.loss.backward()
    assert actions.grad.numpy() == pytest.approx(np.array([[0.0675 * 12.5 / 2, 0.0], [0.0, 0.0]]))


STATES = torch.eye(4)
ODDS = torch.tensor([[0.5, 0.5], [0.25, 0.75], [0.5, 0.5], [0.5, 0.5]])
VALUES = torch.tensor([[0.0, 10.0], [4.0, 8.0], [6.0, 2.0], [1000.0, 1000.0]])  # E Q: 5, 7, 4, 1000


def critic(discount=0.5, **settings):
    """Q as a table of four states by two actions."""
    made = ActionValues(4, 2, discount, CUPSettings(**settings), np.random.default_rng(0))
    made.network = torch.nn.Linear(4, 2, bias=False)
    made.network.weight.data = VALUES.T.clone()
    made.optimiser = torch.optim.SGD(made.network.parameters(), lr=0.5)
    return made


def block():
    """State 0 goes on to 1, 1 is solved, 0 is cut off by the horizon in 2, 1 goes on to 2 after the block."""
    made = RolloutBuffer.empty(4, 1, 4)
    made.observations[:, 0] = STATES[[0, 1, 0, 1]]
    made.actions[:, 0] = [0, 1, 1, 0]
    made.rewards[:, 0] = [1.0, 2.0, 0.5, 0.0]
    made.terminated[1] = made.truncated[2] = made.cut[2] = True
    made.ends[[1, 2]] = True
    made.final_observations[[1, 2], 0] = STATES[[3, 2]]
    made.last_observations[0] = STATES[2]
    return made


POLICY = SimpleNamespace(log_probs=lambda states: (states @ ODDS).log())


def test_targets_are_those_of_expected_sarsa():
    # 1 + 7/2 as usual; 2 when solved; 0.5 + 4/2 from where the horizon cut it off; 0 + 4/2 after the block
    targets = critic(trace_decay=0.0).targets(block(), POLICY)
    assert targets[:, 0].tolist() == pytest.approx([4.5, 2.0, 2.5, 2.0])


def test_a_trace_goes_no_further_than_its_episode_and_the_block():
    # the first is 1 + (7/2 + 2/2) / 2: half of it by what came of the second
    targets = critic(trace_decay=0.5).targets(block(), POLICY)
    assert targets[:, 0].tolist() == pytest.approx([3.25, 2.0, 2.5, 2.0])
    longest = critic(trace_decay=1.0).targets(block(), POLICY)
    assert longest[:, 0].tolist() == pytest.approx([2.0, 2.0, 2.5, 2.0])


def test_only_the_values_of_what_was_done_change():
    made = critic(trace_decay=0.0, critic_epochs=1)
    made.update(block(), made.targets(block(), POLICY))
    # by SGD of rate 1/2 the mean of four squares moves each value a quarter of the way
    by_hand = [[1.125, 8.125], [3.5, 6.5], [6.0, 2.0], [1000.0, 1000.0]]
    assert made.values(STATES).numpy() == pytest.approx(np.array(by_hand))


def flat_source(name, task, method, **changes):
    made = method_of(method)
    return as_source(name, made.policy(task, 7, made.settings_for(task, None, changes)))


SMALL_TD3 = {
    "learner": {
        "hidden": (16,), "warm_up": 8, "update_every": 2, "batch": 8, "capacity": 1000,
        "learning_rate": 0.01, "tau": 0.5,
    }
}  # fmt: skip
KINDS = {
    "discrete": ("BlockedBoxUnlockPickup", "BoxDoor", "ppo", {"num_envs": 2, "rollout_steps": 8}),
    "continuous": ("CoffeeMailMaze", "MailMaze", "td3", {"num_envs": 2, "rollout_steps": 8, **SMALL_TD3}),
}


def made(kind, start, **changes):
    """An agent at work that has a source; a budget of a hundred rounds."""
    target, source, teacher, few = KINDS[kind]
    task = load(target)
    settings = CUP.settings_for(task, None, few, {"start": start, **changes})
    sources = [flat_source("policy-1", load(source), teacher, **few)]
    round_ = settings.num_envs * settings.rollout_steps * settings.action_repeat
    return learning(CUP, Setup(task, settings, 0, 100 * round_, sources))


def alone(kind):
    target, _, teacher, few = KINDS[kind]
    task, method = load(target), method_of(teacher)
    settings = method.settings_for(task, None, few)
    round_ = settings.num_envs * settings.rollout_steps * settings.action_repeat
    return learning(method, Setup(task, settings, 0, 100 * round_))


def tensors(learning_):
    return {name: tensor.detach().clone() for name, tensor in learning_.agent.policy().state().items()}


def same(one, other):
    return all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("kind", KINDS)
def test_until_sources_guide_it_learns_as_its_learner_alone(kind):
    guided, plain = made(kind, start=0.035), alone(kind)
    for _ in range(3):
        assert next(guided).figures == {"guided": 0.0}
        next(plain)
    assert same(tensors(guided), tensors(plain))
    assert not list(guided.agent.reuse())
    next(guided), next(plain)
    assert not same(tensors(guided), tensors(plain))
    assert list(guided.agent.reuse())


@pytest.mark.parametrize("kind, states", [("discrete", 2 * 8), ("continuous", 2)])
def test_it_tells_who_guided_and_by_which_advantage(kind, states):
    guided = made(kind, start=0.0)
    share = next(guided).figures["guided"]
    rows = list(guided.agent.reuse())
    assert {row.source for row in rows} == {"target", "policy-1"}
    assert sum(row.chosen for row in rows) == states
    assert sum(row.chosen for row in rows if row.source == "policy-1") == pytest.approx(share * states)
    assert all(row.terms == {"advantage": row.weight} for row in rows)
    assert all(row.weight == 0.0 for row in rows if row.source == "target")


@pytest.mark.parametrize("kind", KINDS)
def test_a_guided_run_goes_on_from_what_was_captured(kind):
    whole, stopped, fresh = (made(kind, start=0.0) for _ in range(3))
    rounds = [next(whole) for _ in range(3)]
    next(stopped), next(stopped)
    tree, arrays = snapshot.capture({"learning": stopped})
    snapshot.restore({"learning": fresh}, json.loads(json.dumps(tree)), arrays)
    assert next(fresh) == rounds[-1]
    assert same(tensors(fresh), tensors(whole))
    assert list(fresh.agent.reuse()) == list(whole.agent.reuse())


@pytest.mark.parametrize("normalised, unit", [(False, 1.0), (True, 2.0)])
def test_in_a_minibatch_each_state_has_its_own_guide(monkeypatch, normalised, unit):
    guided, given = made("discrete", start=0.0, normalised=normalised), []
    agent, learner = guided.agent, guided.agent.policy().learner
    (source,) = agent._sources
    source.warm_start(source.state(), 100.0)  # far from the target
    values = torch.from_numpy(np.random.default_rng(0).normal(size=(2 * 8, 7)).astype(np.float32))

    def targets(buffer, policy):
        """2 more, or less, than V."""
        own = policy.log_probs(torch.from_numpy(buffer.observations).flatten(0, 1)).detach()
        return ((own.exp() * values).sum(-1) + torch.tensor([2.0, -2.0]).repeat(8)).reshape(8, 2)

    monkeypatch.setattr(agent.critic, "targets", targets)
    monkeypatch.setattr(agent.critic, "update", lambda *_: None)
    monkeypatch.setattr(agent.critic, "values", lambda _: values)
    monkeypatch.setattr(learner, "update", lambda _, guidance: given.append(guidance))
    next(guided)
    states = torch.from_numpy(agent._buffer.observations).flatten(0, 1)
    with torch.no_grad():
        own, theirs = learner.log_probs(states), source.log_probs(states)
        found = [given[0](torch.tensor([place]), own[[place]]).item() for place in range(len(states))]
        losses = [
            over_ppo(own[[place]], theirs[[place], None], values[[place]] / unit, agent.settings).loss.item()
            for place in range(len(states))
        ]
    assert found == pytest.approx(losses, rel=1e-3)
    assert 2 < len(set(losses) - {0.0}) < len(losses)


def test_ppo_is_drawn_to_a_source_that_does_what_is_valued(monkeypatch):
    source = flat_source("policy-1", CORRIDOR, "ppo")
    settings = CUP.settings_for(
        CORRIDOR, None, {"num_envs": 4, "rollout_steps": 8, "start": 0.0, "weight": 1e4}
    )
    before = {name: tensor.clone() for name, tensor in source.policy.state().items()}
    prefers = torch.tensor([0.0, 0.0, 3.0])
    monkeypatch.setattr(
        source.policy.learner, "log_probs", lambda s: prefers.log_softmax(-1).expand(len(s), 3)
    )
    guided = learning(CUP, Setup(CORRIDOR, settings, 0, 10**6, [source]))
    monkeypatch.setattr(
        guided.agent.critic, "values", lambda s: torch.tensor([0.0, 0.0, 1.0]).expand(*s.shape[:-1], 3)
    )
    assert next(guided).figures == {"guided": 1.0}
    next(guided), next(guided)
    own = guided.agent.policy().learner.log_probs(
        torch.from_numpy(guided.interaction.environment.flat_state())
    )
    assert own.exp()[:, RIGHT].min() > 0.6 > own.exp()[:, STAY].max()
    assert same(before, source.policy.state())


def test_td3_is_drawn_to_a_source_that_does_what_is_valued(monkeypatch):
    guided = made("continuous", start=0.0, weight=1e4)
    (source,), learner = guided.agent._sources, guided.agent.policy().learner
    monkeypatch.setattr(source, "actions_of", lambda s: torch.full((len(s), 2), 0.5))
    monkeypatch.setattr(learner, "values_of", lambda _, a: 1.0 - (a - 0.5).square().sum(-1))

    def apart():
        latest = torch.from_numpy(guided.interaction.environment.flat_state())
        return float((learner.actions_of(latest) - 0.5).abs().max())

    before = apart()
    for _ in range(8):
        next(guided)
    assert apart() < 0.5 * before


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_source_it_is_refused(kind):
    task = load(KINDS[kind][0])
    with pytest.raises(UsageError, match=f"cup needs a source for {task.name}, and has none") as told:
        CUP.make(Setup(task, CUP.settings_for(task, None), 0, 1000))
    method = told.value.hint.split()[-1]
    assert told.value.hint.endswith(f"paddlectl train {task.name} --method {method}")
    assert kind in METHODS[method].actions and not METHODS[method].teaches


def test_its_settings_are_closed_and_come_back():
    task = load("CoffeeMailMaze")
    settings = CUP.settings_for(task, None, {"weight": 10, "learner": {"batch": 8}})
    stored = json.loads(json.dumps(CUP.policy(task, 0, settings).settings_document()))
    assert CUP.settings_from(task, stored) == settings
    assert CUP.settings_from(task, {"cap": 1.0}).weight == 30.0
    for wrong in ({"wieght": 1.0}, {"weight": "1"}, {"learner": {"clip": 0.2}}):
        with pytest.raises(ValueError, match=r"can't be|have no"):
            CUP.settings_from(task, wrong)
