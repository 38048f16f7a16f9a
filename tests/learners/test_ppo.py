"""PPO: what its losses let through, and that it solves what can be solved by hand."""

import numpy as np
import pytest
import torch

from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.ppo import PPO, PPOSettings

RIGHT = 1
RNG = np.random.default_rng(0)


def bandit_block(learner, rng, guide=None):
    """32 lanes by 8 one-step decisions: the action that the observation names pays 1."""
    buffer = RolloutBuffer.empty(8, 32, 3)
    named = rng.integers(3, size=(8, 32))
    buffer.observations[:] = np.eye(3, dtype=np.float32)[named]
    for t in range(8):
        buffer.actions[t], buffer.log_probs[t] = learner.act(buffer.observations[t], rng)
    if guide is not None:
        buffer.guides[:] = guide
        buffer.log_probs[:] = 0.0
    buffer.ends[:] = True
    buffer.reached[:] = buffer.actions == named
    buffer.rewards[:] = buffer.reached
    return buffer


def likelihood(learner):
    """Probability of the named action in each of the three states."""
    with torch.no_grad():
        return learner.actor(torch.eye(3)).softmax(-1).diagonal().numpy()


def of_fixed_probabilities(*probabilities):
    learner = PPO(3, 3, seed=0)
    state = learner.state()
    state["actor.6.bias"] = torch.tensor(probabilities).log()
    state["actor.6.weight"] = torch.zeros_like(state["actor.6.weight"])
    learner.load(state)
    return learner


def test_starts_almost_uniform():
    assert likelihood(PPO(3, 3, seed=0)) == pytest.approx([1 / 3] * 3, abs=0.02)


def test_sampled_actions_follow_their_probabilities():
    learner = of_fixed_probabilities(0.5, 0.3, 0.2)
    actions, log_probs = learner.act(np.zeros((20_000, 3), np.float32), RNG)
    assert np.bincount(actions) / 20_000 == pytest.approx([0.5, 0.3, 0.2], abs=0.02)
    np.testing.assert_allclose(log_probs, np.log([0.5, 0.3, 0.2])[actions], rtol=1e-5)


def test_once_frozen_it_explores_less():
    """Probabilities go as their squares: 0.5, 0.3, 0.2 to 25, 9 and 4 of 38."""
    learner = of_fixed_probabilities(0.5, 0.3, 0.2)
    actions, _ = learner.eval_actor().act(np.zeros((20_000, 3), np.float32), RNG)
    assert np.bincount(actions) / 20_000 == pytest.approx([25 / 38, 9 / 38, 4 / 38], abs=0.02)


def test_solves_a_bandit_of_three_states():
    learner, rng = PPO(3, 3, seed=0), np.random.default_rng(0)
    for _ in range(16):
        learner.update(bandit_block(learner, rng))
    assert likelihood(learner).min() > 0.9


def test_another_network_may_be_the_actor():
    made, rng = [], np.random.default_rng(0)
    learner = PPO(3, 4, seed=0, actor=lambda *sizes: made.append(sizes) or torch.nn.Linear(*sizes))
    before = {name: tensor.clone() for name, tensor in learner.state().items()}
    learner.update(bandit_block(learner, rng))
    assert made == [(3, 4)]
    learned = {name for name, tensor in learner.state().items() if not torch.equal(before[name], tensor)}
    assert {"actor.weight", "actor.bias"} <= learned


def corridor_block(learner, places, rng):
    """16 steps of a corridor of five cells; the last pays, and the walk starts anew."""
    buffer = RolloutBuffer.empty(16, len(places), 5)
    seen = np.eye(5, dtype=np.float32)
    for t in range(16):
        buffer.observations[t] = seen[places]
        buffer.actions[t], buffer.log_probs[t] = learner.act(buffer.observations[t], rng)
        places[:] = np.clip(places + np.where(buffer.actions[t] == RIGHT, 1, -1), 0, 4)
        buffer.ends[t] = buffer.reached[t] = places == 4
        buffer.rewards[t] = np.where(places == 4, 1.0, -0.02)
        places[places == 4] = rng.integers(4, size=(places == 4).sum())
    buffer.last_observations[:] = seen[places]
    return buffer


def test_solves_a_corridor_where_the_reward_is_delayed():
    learner, rng = PPO(5, 2, seed=1), np.random.default_rng(1)
    places = np.zeros(32, np.intp)
    for _ in range(14):
        learner.update(corridor_block(learner, places, rng))
    with torch.no_grad():
        right = learner.actor(torch.eye(5)[:4]).softmax(-1)[:, RIGHT]
    assert right.min() > 0.8


def one_step_gradient(action_log_ratio, reward_of_sample):
    """The actor's gradient from two equal observations, whose old probabilities were off by a ratio.

    The entropy and value terms are switched off, so that only the clipped surrogate is left.
    """
    settings = PPOSettings(epochs=1, entropy_coef=0.0, value_coef=0.0)
    learner = PPO(2, 2, seed=0, settings=settings)
    buffer = RolloutBuffer.empty(2, 1, 2)
    buffer.observations[:] = [[[1.0, 0.0]], [[0.0, 1.0]]]
    with torch.no_grad():
        log_probs = learner.actor(torch.from_numpy(buffer.observations[:, 0])).log_softmax(-1)[:, 0].numpy()
    buffer.log_probs[:, 0] = log_probs - action_log_ratio
    buffer.ends[:] = True
    buffer.rewards[:, 0] = reward_of_sample
    learner.update(buffer)
    return max(float(p.grad.abs().max()) for p in learner.actor.parameters())


CLIPPED = [
    # log-ratios of two samples, their rewards (advantages +1 and -1): is there a gradient?
    ((np.log(1.5), np.log(0.5)), (9.0, -9.0), False),  # better and already likelier, worse and rarer
    ((np.log(1.25), np.log(0.75)), (9.0, -9.0), False),
    ((np.log(1.1), np.log(0.5)), (9.0, -9.0), True),  # the first is inside
    ((np.log(1.5), np.log(0.9)), (9.0, -9.0), True),  # the second is inside
    ((np.log(0.5), np.log(1.5)), (9.0, -9.0), True),  # the pessimistic side isn't clipped
]


@pytest.mark.parametrize(("ratios", "rewards", "learns"), CLIPPED)
def test_there_is_no_gradient_beyond_the_clip(ratios, rewards, learns):
    assert (one_step_gradient(np.array(ratios), np.array(rewards)) > 1e-6) == learns


def test_guided_actions_that_reached_become_likelier():
    learner, rng = PPO(3, 3, seed=0), np.random.default_rng(0)
    for _ in range(6):
        learner.update(bandit_block(learner, rng, guide=1))
    assert likelihood(learner).min() > 0.9


def test_guided_actions_that_failed_teach_nothing():
    learner, rng = PPO(3, 3, seed=0), np.random.default_rng(0)
    before = {name: tensor.clone() for name, tensor in learner.state().items()}
    buffer = bandit_block(learner, rng, guide=2)
    buffer.reached[:] = False
    learner.update(buffer)
    assert all(torch.equal(before[name], tensor) for name, tensor in learner.state().items())


def test_the_surrogate_is_of_the_targets_own_samples():
    """Whatever a failed guide did and earned, the update is that of the target's own samples."""
    rng = np.random.default_rng(0)
    blocks = [bandit_block(PPO(3, 3, seed=7), np.random.default_rng(3)) for _ in range(2)]
    for block in blocks:
        block.guides[:, 16:] = 1
        block.reached[:, 16:] = False
    blocks[1].actions[:, 16:] = rng.integers(3, size=(8, 16))
    blocks[1].rewards[:, 16:] = 5.0
    learners = [PPO(3, 3, seed=0) for _ in blocks]
    for learner, block in zip(learners, blocks, strict=True):
        learner.update(block)
    one, other = (learner.state() for learner in learners)
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_a_handful_of_guided_steps_is_no_whole_step_of_the_optimiser():
    """RMSprop divides by the usual size of gradients: one of eight samples would weigh as one of 256."""
    moved = {}
    for few in (False, True):
        learner, rng = PPO(3, 3, seed=0, settings=PPOSettings(minibatch=256)), np.random.default_rng(0)
        for _ in range(4):
            learner.update(bandit_block(learner, rng, guide=1))
        block = bandit_block(learner, rng, guide=1)
        if few:
            rest = np.ones(block.guides.shape, np.bool_)
            rest[0, :8] = False
            block.reached[rest] = False
        before = learner.actor[-1].weight.clone()
        learner.update(block)
        moved[few] = float((learner.actor[-1].weight - before).detach().norm())
    assert 0 < moved[True] < 0.2 * moved[False]


def trained(seed):
    learner, rng = PPO(3, 3, seed=seed), np.random.default_rng(0)
    for _ in range(3):
        learner.update(bandit_block(learner, rng))
    return learner


def test_equal_seeds_give_equal_tensors_bit_for_bit():
    torch.manual_seed(1)
    one = trained(5).state()
    torch.manual_seed(2)  # the global generator plays no part
    same = trained(5).state()
    other = trained(6).state()
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not all(torch.equal(one[name], other[name]) for name in one)


def test_making_one_leaves_the_global_generator_alone():
    torch.manual_seed(0)
    before = torch.get_rng_state()
    PPO(3, 3, seed=9)
    assert torch.equal(torch.get_rng_state(), before)


def test_state_is_taken_back():
    learner, fresh = trained(0), PPO(3, 3, seed=9)
    fresh.load(learner.state())
    assert likelihood(fresh).tolist() == likelihood(learner).tolist()
    assert all(torch.equal(tensor, fresh.state()[name]) for name, tensor in learner.state().items())


def test_another_networks_tensors_are_refused():
    with pytest.raises(RuntimeError):
        PPO(3, 3, seed=0).load(PPO(4, 3, seed=0).state())


def test_the_learning_rate_falls_in_a_straight_line():
    learner = PPO(2, 2, seed=0, settings=PPOSettings(learning_rate=0.1, final_rate=0.2))
    for done, rate in [(0.0, 0.1), (0.5, 0.06), (1.0, 0.02), (1.3, 0.02)]:
        learner.anneal(done)
        assert learner.optimiser.param_groups[0]["lr"] == pytest.approx(rate)


def test_an_heir_has_the_same_preferences_weakened():
    """Log-odds times 0.5, so probabilities go with their square roots; the critic and the elder stay."""
    elder, heir = PPO(3, 4, seed=0), PPO(3, 4, seed=1)
    with torch.no_grad():
        elder.actor[-1].weight.mul_(100.0)
    before = {name: tensor.clone() for name, tensor in elder.state().items()}
    heir.warm_start(elder.state(), 0.5)
    observation = torch.tensor([[0.3, -1.0, 2.0]])
    roots = elder.actor(observation).softmax(-1).sqrt()
    assert torch.allclose(heir.actor(observation).softmax(-1), roots / roots.sum(), atol=1e-6)
    assert torch.equal(heir.critic(observation), elder.critic(observation))
    assert all(torch.equal(before[name], tensor) for name, tensor in elder.state().items())


def test_a_decision_that_the_horizon_cut_off_is_worth_what_its_last_state_is():
    """γ = 0.5, λ = 1: one lane, two steps; the second is cut at a state worth V. G = 0 + 0.5·(0 + 0.5·V)."""
    learner = PPO(2, 2, seed=3, settings=PPOSettings(discount=0.5, trace_decay=1.0))
    buffer = RolloutBuffer.empty(2, 1, 2)
    buffer.observations[:, 0] = [[1.0, 0.0], [0.0, 1.0]]
    buffer.final_observations[1, 0] = [2.0, -1.0]
    buffer.last_observations[0] = [9.0, 9.0]  # of the next episode: no part of this one
    buffer.ends[1] = buffer.truncated[1] = buffer.cut[1] = True
    with torch.no_grad():
        final = learner.critic(torch.tensor([[2.0, -1.0]])).item()
    _, returns = learner._targets(buffer)
    assert returns.tolist() == pytest.approx([0.25 * final, 0.5 * final])
    buffer.cut[1], buffer.rewards[1] = False, -0.1  # it failed by itself, in the same step
    _, returns = learner._targets(buffer)
    assert returns.tolist() == pytest.approx([-0.05, -0.1])
