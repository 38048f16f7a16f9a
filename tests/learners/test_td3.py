"""TD3: its targets by hand, what its actors do, and that it solves what can be solved by hand."""

import numpy as np
import pytest
import torch

from paddlectl.learners.buffers import TARGET, RolloutBuffer
from paddlectl.learners.networks import GoalFeatures
from paddlectl.learners.replay import Transitions
from paddlectl.learners.td3 import TD3, TD3Settings

SMALL = {"hidden": (32, 32), "warm_up": 64, "batch": 64, "learning_rate": 3e-3, "optimiser": "adam"}

RNG = np.random.default_rng(0)


def of_constant_values(first: float, second: float, **settings) -> TD3:
    learner = TD3(2, 1, 0, TD3Settings(**{**SMALL, **settings}))
    for critic, value in zip(learner.slow.critics, (first, second), strict=True):
        torch.nn.init.zeros_(critic[-1].weight)
        torch.nn.init.constant_(critic[-1].bias, value)
    return learner


def transitions(rewards, ends, steps) -> Transitions:
    count = len(rewards)
    column = [torch.tensor(x, dtype=torch.float32) for x in (rewards, ends, steps)]
    seen, actions = torch.zeros(count, 2), torch.zeros(count, 1)
    return Transitions(seen, actions, column[0], column[1], seen, column[2])


def test_targets_take_the_smaller_critic_and_stop_at_a_goal():
    learner = of_constant_values(3.0, 2.0, discount=0.9)
    batch = transitions([1.0, 1.0], [0.0, 1.0], [np.inf, 0.0])
    assert learner._targets(batch).tolist() == pytest.approx([1 + 0.9 * 2, 1.0])


def test_a_goal_known_to_be_near_bounds_the_target_from_below():
    """γ = 0.5, reward 8: in two more actions it is worth 2, at once 8; never more than 8."""
    learner = of_constant_values(2.0, 2.0, discount=0.5, lower_bound=True, goal_reward=8.0)
    batch = transitions([0.0, 0.0, 8.0, 8.0], [0, 0, 1, 0], [2.0, np.inf, 0.0, 0.0])
    assert learner._targets(batch).tolist() == [2.0, 1.0, 8.0, 8.0]


def test_the_defaults_are_those_of_table_1():
    settings = TD3Settings()
    assert (settings.learning_rate, settings.optimiser, settings.discount) == (2e-4, "rmsprop", 0.99)
    assert (settings.batch, settings.update_every, settings.policy_noise) == (256, 2, 0.2)
    assert settings.hidden == (400, 400, 400)
    assert not (settings.goal_exploration or settings.novelty or settings.hindsight)
    assert not (settings.lower_bound or settings.grid)
    assert settings.random_steps == 1.0


def bandit_block(learner: TD3, rng: np.random.Generator) -> RolloutBuffer:
    """One-step decisions: the action that the observation names pays most."""
    buffer = RolloutBuffer.empty(8, 32, 2, (1,), np.float32)
    buffer.observations[:] = rng.uniform(-0.8, 0.8, (8, 32, 2))
    for t in range(8):
        buffer.actions[t], buffer.log_probs[t] = learner.act(buffer.observations[t], rng)
    buffer.rewards[:] = 1.0 - np.abs(buffer.actions[..., 0] - buffer.observations[..., 0])
    buffer.ends[:] = buffer.reached[:] = True
    return buffer


def trained(seed: int, blocks: int = 40) -> TD3:
    learner, rng = TD3(2, 1, seed, TD3Settings(**SMALL, update_every=16)), np.random.default_rng(seed)
    for _ in range(blocks):
        learner.update(bandit_block(learner, rng))
    return learner


def test_it_learns_the_action_that_is_named():
    learner = trained(0)
    assert learner.updates == 40 * 16
    seen = np.random.default_rng(1).uniform(-0.8, 0.8, (200, 2)).astype(np.float32)
    actions, log_probs = learner.eval_actor().act(seen, RNG)
    assert np.abs(actions[:, 0] - seen[:, 0]).mean() < 0.12
    assert not log_probs.any()


def test_it_acts_at_random_until_it_is_warm_and_within_bounds_ever_after():
    learner = TD3(2, 1, 0, TD3Settings(**SMALL, exploration=2.0))
    first, _ = learner.act(np.zeros((2000, 2), np.float32), RNG)
    assert np.histogram(first, 4, (-1, 1))[0].min() > 400
    learner.update(bandit_block(learner, np.random.default_rng(0)))
    later, _ = learner.act(np.zeros((2000, 2), np.float32), RNG)
    assert np.abs(later).max() == 1.0


def test_random_actions_rise_from_lane_to_lane_and_fall_over_the_budget():
    def share(done: float) -> np.ndarray:
        learner = TD3(2, 1, 0, TD3Settings(**SMALL, random_actions=1.0, exploration=0.0))
        learner.update(bandit_block(learner, np.random.default_rng(0)))
        learner.anneal(done)
        seen = np.zeros((100, 2), np.float32)
        best = learner.act(seen, RNG)[0][0]  # the first lane never acts at random
        return np.mean([learner.act(seen, RNG)[0] != best for _ in range(60)], 0)[:, 0]

    np.testing.assert_allclose(share(0.0), np.linspace(0, 1, 100), atol=0.3)
    np.testing.assert_allclose(share(0.5), np.linspace(0, 0.5, 100), atol=0.3)
    assert not share(1.0).any()


def test_td3_holds_random_actions_until_it_is_warm_and_in_its_last_lanes_the_longest():
    learner = TD3(2, 1, 0, TD3Settings(**SMALL, random_actions=1.0, random_steps=5.0, exploration=0.0))
    seen, rng = np.zeros((100, 2), np.float32), np.random.default_rng(0)
    first = np.stack([learner.act(seen, rng)[0] for _ in range(60)])
    assert (first[30:] != first[29:-1]).mean() == pytest.approx(1 / 5, abs=0.05)
    learner.update(bandit_block(learner, rng))
    best = learner.eval_actor().act(seen[:1], rng)[0]
    later = np.stack([learner.act(seen, rng)[0] for _ in range(200)])[50:]
    random = (np.abs(later) >= 0.5).mean(0)[:, 0]
    assert abs(best.item()) < 0.5
    np.testing.assert_allclose(random, np.linspace(0, 1, 100), atol=0.35)


def test_td3_is_paid_for_novelty_beside_the_reward_and_not_at_the_end_of_the_budget():
    learner = TD3(2, 1, 0, TD3Settings(**SMALL, novelty=0.5))
    rng = np.random.default_rng(0)
    while not learner.updates:
        learner.update(bandit_block(learner, rng))
    batch = transitions([1.0, 0.0], [0.0, 1.0], [np.inf, np.inf])
    batch = batch._replace(following=torch.tensor([[50.0, 50.0], [-50.0, 50.0]]))
    for done, rewards in ((0.0, [1.5, 0.5]), (0.5, [1.25, 0.25]), (1.0, [1.0, 0.0])):
        learner.anneal(done)
        assert learner._with_novelty(batch).rewards.tolist() == rewards
    often = batch._replace(following=torch.zeros(2, 2))
    learner.anneal(0.0)
    assert 1.0 < learner._with_novelty(often).rewards[0].item() < 1.1


def test_without_novelty_rewards_stay_as_they_are():
    batch = transitions([1.0], [0.0], [np.inf])
    assert TD3(2, 1, 0, TD3Settings(**SMALL))._with_novelty(batch) is batch


def test_the_slow_copies_lag_behind_and_guides_are_played_by_them():
    learner = trained(0, blocks=4)
    seen = np.zeros((1, 2), np.float32)
    slow = learner.slow.actor(torch.zeros(1, 2)).tanh().item()
    assert learner.teacher_actor().act(seen, RNG)[0].item() == pytest.approx(slow)
    assert learner.online.actor(torch.zeros(1, 2)).tanh().item() != pytest.approx(slow, abs=1e-6)


def test_the_rate_falls_to_its_last_share():
    learner = TD3(2, 1, 0, TD3Settings(learning_rate=0.1, final_rate=0.2))
    for done, rate in ((0.0, 0.1), (0.5, 0.06), (1.0, 0.02), (1.5, 0.02)):
        learner.anneal(done)
        assert learner.actor_optimiser.param_groups[0]["lr"] == pytest.approx(rate)


def test_a_saturated_actor_costs():
    learner = TD3(2, 1, 0, TD3Settings(**SMALL, saturation_cost=2.0, saturation=1.5))
    for network in (learner.online.actor, learner.online.critics[0]):
        torch.nn.init.zeros_(network[-1].weight)
    torch.nn.init.constant_(learner.online.actor[-1].bias, -4.5)
    torch.nn.init.constant_(learner.online.critics[0][-1].bias, 1.0)
    assert learner._actor_loss(torch.zeros(3, 2)).item() == pytest.approx(2 * 3.0**2 - 1)


def test_equal_seeds_learn_the_same_and_states_can_be_carried_over():
    one, same, other = (trained(seed, blocks=2).state() for seed in (3, 3, 4))
    assert all(torch.equal(one[key], same[key]) for key in one)
    assert not all(torch.equal(one[key], other[key]) for key in one)
    fresh = TD3(2, 1, 9, TD3Settings(**SMALL))
    fresh.load(one)
    assert all(torch.equal(one[key], fresh.state()[key]) for key in one)
    with pytest.raises(RuntimeError):
        TD3(3, 1, 0, TD3Settings(**SMALL)).load(one)


def test_a_code_interpolates_between_the_points_of_its_grid():
    """Grid points of 3 x 2 lie at -1, 0, 1 and at -0.5, 0.5."""
    features = GoalFeatures(5, 2, (3, 2))
    seen = features(torch.tensor([[0.0, 0.5, 9.0, 0.25, 0.0]]))[0]
    assert (len(seen), features.size) == (5 + 2 + 12, 5 + 2 + 12)
    assert seen[0] == 9.0
    np.testing.assert_allclose(seen[1:7], np.array([0, 0.5, 0.25, 0, 0.25, -0.5]) / 1.5, atol=1e-6)
    np.testing.assert_allclose(seen[7:13] / 2, [0, 0, 0, 1, 0, 0])
    np.testing.assert_allclose(seen[13:] / 2, [0, 0, 0.375, 0.375, 0.125, 0.125])


def test_what_is_inherited_is_used_at_once():
    learner, heir = trained(0, blocks=4), TD3(2, 1, 5, TD3Settings(**SMALL, exploration=0.0))
    heir.warm_start(learner.state(), 0.7)
    seen = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 2)).astype(np.float32)
    expected = learner.online.actor(torch.from_numpy(seen)).tanh().detach().numpy()
    np.testing.assert_allclose(heir.act(seen, RNG)[0], expected, atol=1e-6)


def guided_block(rng: np.random.Generator) -> RolloutBuffer:
    """Guide 1 shows an action, half the named one, and reaches its subgoals; others do something else."""
    buffer = RolloutBuffer.empty(8, 32, 2, (1,), np.float32)
    buffer.observations[:] = rng.uniform(-0.8, 0.8, (8, 32, 2))
    buffer.actions[:] = buffer.observations[..., :1] / 2
    buffer.guides[:] = 1
    buffer.ends[:] = buffer.reached[:] = True
    buffer.guides[:, :8] = TARGET
    buffer.reached[:, 8:16] = False
    buffer.actions[:, :16] = 1.0
    return buffer


def test_who_clones_learns_what_guides_did_that_reached_their_subgoal_and_nothing_else():
    heir = TD3(2, 1, 5, TD3Settings(**SMALL, update_every=16, cloning=True))
    given = {name: value.clone() for name, value in trained(0, blocks=4).state().items()}
    heir.warm_start(given, 0.7)
    rng = np.random.default_rng(0)
    for _ in range(40):
        heir.update(guided_block(rng))
    seen = rng.uniform(-0.8, 0.8, (200, 2)).astype(np.float32)
    assert np.abs(heir.eval_actor().act(seen, RNG)[0] - seen[:, :1] / 2).mean() < 0.03
    critics = [name for name in given if name.startswith("online.critics")]
    assert critics and all(torch.equal(heir.state()[name], given[name]) for name in critics)


def test_who_clones_does_not_explore_and_learns_nothing_by_itself():
    heir = TD3(2, 1, 5, TD3Settings(**SMALL, cloning=True, exploration=1.0, random_actions=1.0))
    given = {name: value.clone() for name, value in trained(0, blocks=4).state().items()}
    heir.warm_start(given, 0.7)
    seen = np.zeros((50, 2), np.float32)
    assert np.ptp(heir.act(seen, RNG)[0]) < 1e-6
    heir.update(bandit_block(heir, np.random.default_rng(0)))
    assert all(torch.equal(value, given[name]) for name, value in heir.state().items())


def test_who_inherited_nothing_has_nothing_to_clone_upon():
    learner, rng = TD3(2, 1, 0, TD3Settings(**SMALL, update_every=16, cloning=True)), np.random.default_rng(0)
    learner.update(bandit_block(learner, rng))
    assert learner.updates == 16
