"""CompoNet's module as worked by hand, what PPO changes of it, and the record of who was followed."""

import numpy as np
import pytest
import torch
from torch import nn

from paddlectl.agents.evaluation import evaluate
from paddlectl.agents.flat import FlatPolicy, FlatSettings
from paddlectl.errors import UsageError
from paddlectl.learners.componet import CompoNet, Composition, encoded_places
from paddlectl.learners.ppo import PPOSettings
from paddlectl.methods.base import Setup
from paddlectl.methods.componet import COMPONET, shares
from paddlectl.scenario import Scenario
from scripted import RIGHT, TASK, as_source, learning

SCENARIO = Scenario(name="A", target="BoxDoor", sources=("DoorBall", "OpenGoal"))
FEW = {"num_envs": 2, "rollout_steps": 16, "learner": {"width": 8}}


def linear(*weights):
    """Rows of weights, and no biases."""
    layer = nn.Linear(len(weights[0]), len(weights))
    with torch.no_grad():
        layer.weight.copy_(torch.tensor(weights))
        layer.bias.zero_()
    return layer


def test_a_module_over_two_sources_with_two_actions():
    """State 1, d = 4, so that √d = 2; all but the first unit of each query, key and value is 0."""
    sources = [linear([np.log(3.0)], [0.0]), linear([0.0], [np.log(4.0)])]
    module, rest = CompoNet(sources, 1, 2, 4), [[0.0, 0.0]] * 3
    module.out_query = linear([2.0], [0.0], [0.0], [0.0])
    module.out_key = linear([1.0, 0.0], *rest)
    module.in_query = linear([2.0], [0.0], [0.0], [0.0])
    module.in_key = linear([0.0, 1.0], *rest)
    module.in_value = linear([0.0, 10.0], *rest)
    module.internal = linear([1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 3.0])
    states = torch.tensor([[1.0]])
    attention, tentative, internal = module.compose(states)
    # Φ = (0.75, 0.25), (0.2, 0.8), and E = (sin n, cos n) of row n
    # keys 0.75 + 0, 0.2 + 0.8415; each score is 2 · key / 2
    assert attention[0].tolist() == pytest.approx([0.42764, 0.57236], abs=1e-5)
    # 0.42764 · (0.75, 0.25) + 0.57236 · (0.2, 0.8)
    assert tentative[0].tolist() == pytest.approx([0.43520, 0.56480], abs=1e-5)
    # keys 0.25 + 1, 0.8 + 0.5403, 0.5648 - 0.4161: weights 0.41204, 0.45098, 0.13697
    # of the values 2.5, 8, 5.6480; the internal policy gives that and three times the state
    assert internal[0].tolist() == pytest.approx([5.41160, 3.0], abs=1e-4)
    assert module(states)[0].tolist() == pytest.approx([5.84680, 3.56480], abs=1e-4)


def test_each_state_is_composed_by_itself():
    module = CompoNet([nn.Linear(3, 5), nn.Linear(3, 5), nn.Linear(3, 5)], 3, 5, 4)
    states = torch.randn(7, 3, generator=torch.Generator().manual_seed(0))
    whole = module(states)
    assert whole.shape == (7, 5)
    assert torch.allclose(whole, torch.cat([module(state[None]) for state in states]), atol=1e-6)
    attention = module.compose(states).attention
    assert torch.allclose(attention.sum(-1), torch.ones(7))


def test_places_are_encoded_by_sines_and_cosines():
    even, odd = encoded_places(3, 4), encoded_places(2, 3)
    assert even[0].tolist() == [0, 1, 0, 1]
    expected = [np.sin(2), np.cos(2), np.sin(0.02), np.cos(0.02)]
    assert even[2].tolist() == pytest.approx(expected)
    assert odd[1].tolist() == pytest.approx([np.sin(1), np.cos(1), np.sin(10_000 ** (-2 / 3))])


def tensors(policy):
    return {name: tensor.clone() for name, tensor in policy.state().items()}


def source(number):
    """Likes one action of three."""
    policy = FlatPolicy(TASK, number, FlatSettings())
    with torch.no_grad():
        policy.learner.actor[-1].bias[number] += 2.0
    return as_source(f"policy-{number}", policy)


def setup(*sources, **changes):
    return Setup(TASK, COMPONET.settings_for(TASK, SCENARIO, FEW, changes), 0, 1000, sources, SCENARIO)


def of_source(tensors, number):
    start = f"actor.sources.{number}."
    return {name.removeprefix(start): value for name, value in tensors.items() if name.startswith(start)}


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def test_sources_stay_as_they_are_and_all_else_learns():
    sources = [source(RIGHT), source(0)]
    theirs = [tensors(each.policy) for each in sources]
    made = learning(COMPONET, setup(*sources))
    before = tensors(made.agent.policy())
    for _ in range(2):
        next(made)
    after = tensors(made.agent.policy())
    for number, each in enumerate(sources):
        actor = {n.removeprefix("actor."): t for n, t in theirs[number].items() if n.startswith("actor.")}
        assert same(of_source(before, number), actor)
        assert same(of_source(after, number), actor)
        assert same(tensors(each.policy), theirs[number])
        assert all(parameter.grad is None for parameter in made.agent._module.sources[number].parameters())
    left = {name for name in before if torch.equal(before[name], after[name])}
    # a bias that is added to all keys alike changes no attention, but for rounding
    assert {name for name in left if not name.startswith("actor.sources.")} <= {
        "actor.out_key.bias",
        "actor.in_key.bias",
    }


def test_what_was_kept_is_revived_without_its_sources():
    policy = learning(COMPONET, setup(source(RIGHT), source(0))).agent.policy()
    assert policy.settings_document()["learner"]["modules"] == 2
    settings = COMPONET.settings_from(TASK, policy.settings_document())
    revived = COMPONET.policy(TASK, 5, settings)
    revived.load(tensors(policy))
    states = torch.rand(4, 4)
    assert torch.equal(revived.learner.log_probs(states), policy.learner.log_probs(states))
    assert evaluate(revived, TASK, 2, 0) == evaluate(policy, TASK, 2, 0)


def test_a_module_has_so_many_sources_as_the_scenario_whatever_else_is_changed():
    settings = COMPONET.settings_for(TASK, SCENARIO, {"learner": {"modules": 5, "width": 3, "clip": 0.1}})
    assert (settings.learner.modules, settings.learner.width, settings.learner.clip) == (2, 3, 0.1)
    assert settings.learner.learning_rate == PPOSettings().learning_rate


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_setup_without_a_policy_of_each_source_is_refused(count):
    with pytest.raises(UsageError) as told:
        COMPONET.make(setup(*[source(number) for number in range(count)]))
    assert told.value.message == f"componet needs 2 sources for Corridor, and has {count or 'none'}"
    assert told.value.hint.startswith("learn it alone: paddlectl train Corridor --method ")


def test_shares_of_the_logits():
    """v is 0.3, -0.3 about its mean; what is added 0.1, -0.1 in the first state, and 0 in the second."""
    tentative = torch.tensor([[0.8, 0.2], [0.8, 0.2]])
    internal = torch.tensor([[5.1, 4.9], [7.0, 7.0]])
    attention = torch.tensor([[0.8, 0.2], [0.5, 0.5]])
    found = shares(Composition(attention, tentative, internal))
    assert found == pytest.approx(np.array([[0.25, 0.6, 0.15], [0.0, 0.5, 0.5]]), abs=1e-5)


def test_the_source_of_largest_attention_was_followed(monkeypatch):
    made, asked = learning(COMPONET, setup(source(RIGHT), source(0))), []

    def compose(states):
        asked.append(states)
        tentative, internal = torch.tensor([[0.3, -0.3, 0.0], [0.1, -0.1, 0.0]])[:, None].expand(2, 4, 3)
        return Composition(
            torch.tensor([[0.8, 0.2], [0.8, 0.2], [0.2, 0.8], [0.8, 0.2]]), tentative, internal
        )

    monkeypatch.setattr(made.agent._module, "compose", compose)
    made.agent._valuations[8, 1] = True  # the last of the four
    made.agent._tell()
    assert [states.shape for states in asked] == [(4, 4)], "each eighth of 16 steps of two lanes"
    near, far = list(made.agent.reuse())[:3], list(made.agent.reuse())[3:]
    assert [row.source for row in near] == ["target", "policy-2", "policy-0"]
    assert [row.chosen for row in near] == [0, 2, 1]
    assert [row.terms["attention"] for row in near] == pytest.approx([0.0, 0.6, 0.4])
    assert [row.weight for row in near] == pytest.approx([0.25, 0.45, 0.3])
    assert [row.context for row in far] == [("far()",)] * 3
    assert [row.chosen for row in far] == [0, 1, 0]
    assert [row.weight for row in far] == pytest.approx([0.25, 0.6, 0.15])
