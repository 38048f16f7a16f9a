"""Replay and hindsight on a line: lane b stands at 10·b + t after t actions and wants to be at 3."""

import numpy as np
import pytest

from paddlectl.learners.buffers import RolloutBuffer
from paddlectl.learners.exploration import GoalExploration
from paddlectl.learners.replay import Hindsight, Replay

LANES, STEPS = 2, 8
GOAL = 3.0


def block(
    first: int = 0, done_at: int | None = None, reached_at: int | None = None, solved: bool = False
) -> RolloutBuffer:
    """Observations are (place, speed, goal); actions are 0.1·t."""
    buffer = RolloutBuffer.empty(STEPS, LANES, 3, (1,), np.float32)
    times = np.arange(first, first + STEPS)
    places = times[:, None] + 10.0 * np.arange(LANES)
    buffer.observations[:] = np.stack([places, np.ones_like(places), np.full_like(places, GOAL)], -1)
    buffer.last_observations[:] = buffer.observations[-1] + np.array([1, 0, 0])
    buffer.actions[:] = 0.1 * times[:, None, None]
    buffer.final_observations[:] = buffer.observations + np.array([1, 0, 0])
    if done_at is not None:
        (buffer.terminated if solved else buffer.truncated)[done_at] = buffer.ends[done_at] = True
    if reached_at is not None:
        buffer.reached[reached_at] = buffer.ends[reached_at] = True
        buffer.rewards[reached_at] = 5.0
    return buffer


def replay(hindsight: Hindsight | None = None, capacity: int = 100, **events: int) -> Replay:
    made = Replay(capacity, LANES, 3, 1, hindsight or Hindsight())
    made.add(block(**events))
    return made


def sample(made: Replay, count: int = 2000):
    return [x.numpy() for x in made.sample(count, np.random.default_rng(0))]


def test_without_goals_transitions_come_as_they_were():
    observations, actions, rewards, ends, following, steps = sample(replay(reached_at=2))
    np.testing.assert_allclose(actions[:, 0], 0.1 * (observations[:, 0] % 10), rtol=1e-6)
    np.testing.assert_array_equal(following, observations + np.array([1, 0, 0]))
    at_goal = observations[:, 0] % 10 == 2
    np.testing.assert_array_equal(rewards, 5.0 * at_goal)
    np.testing.assert_array_equal(ends, at_goal)
    np.testing.assert_array_equal(steps == 0, at_goal)
    assert len(np.unique(observations[:, 0])) == LANES * STEPS


def test_the_oldest_make_room():
    made = replay(capacity=LANES * 10)
    made.add(block(first=STEPS))
    assert len(made) == LANES * 10
    assert sorted(set(sample(made)[0][:, 0] % 10)) == list(range(10))
    assert set(sample(made)[0][:, 0]) == {*range(6, 16), *range(16, 26)}


def test_hindsight_gives_goals_that_were_achieved_later():
    made = replay(Hindsight(goal_size=1, radius=0.25, reward=7.0, future=1.0, span=4))
    observations, _, rewards, ends, following, steps = sample(made)
    ahead = observations[:, 2] - following[:, 0]  # the line goes on by 1 an action
    assert set(ahead) == {0, 1, 2, 3}
    np.testing.assert_array_equal(steps, ahead)
    np.testing.assert_array_equal(ends, ahead == 0)
    np.testing.assert_array_equal(rewards, 7.0 * (ahead == 0))
    np.testing.assert_array_equal(following[:, 2], observations[:, 2])


def test_hindsight_stays_within_the_episode():
    made = replay(Hindsight(goal_size=1, radius=0.25, future=1.0, span=6), done_at=4)
    observations, _, _, ends, _, steps = sample(made)
    before = observations[:, 0] % 10 < 4
    assert (observations[before, 2] % 10 <= 5).all()  # to where the last action led, and no further
    last = observations[:, 0] % 10 == 4
    assert (observations[last, 2] % 10 == 5).all()
    assert (steps[last] == 0).all()
    assert ends[last].all()


@pytest.mark.parametrize("solved", [False, True])
def test_the_next_state_is_of_the_same_episode(solved: bool) -> None:
    """After the fourth action an episode ends at place 5, and the next one begins at place 7."""
    made, jumped = Replay(100, LANES, 3, 1, Hindsight()), block(done_at=4, solved=solved)
    jumped.observations[5:, :, 0] += 1
    made.add(jumped)
    observations, _, _, ends, following, _ = sample(made)
    last = observations[:, 0] % 10 == 4
    assert (following[last, 0] % 10 == 5).all(), "where that episode ended"
    assert (ends[last] == solved).all(), "the horizon is no end to what could have come, a solved task is"
    assert not ends[~last].any()


def test_a_goal_that_was_reached_in_the_last_step_is_what_it_achieved():
    made = replay(
        Hindsight(goal_size=1, radius=0.25, reward=5.0, future=1.0, span=6), done_at=2, reached_at=2
    )
    observations, _, rewards, ends, _, steps = sample(made)
    last = observations[:, 0] == 2
    assert (observations[last, 2] == GOAL).all()
    assert (rewards[last] == 5.0).all()
    assert ends[last].all()
    to_it = (observations[:, 0] == 0) & (observations[:, 2] == GOAL) & (steps == 2)
    assert to_it.any()


def test_other_goals_come_from_other_samples_and_are_judged_anew():
    made = replay(Hindsight(goal_size=1, radius=0.5, others=1.0))
    made.observations[:, 1, 2] = 12.0  # the second lane's goal
    observations, _, rewards, ends, following, _ = sample(made)
    assert set(observations[:, 2]) == {GOAL, 12.0}
    low, high = observations[:, 0] - 0.5, following[:, 0] + 0.5
    near = (low <= observations[:, 2]) & (observations[:, 2] <= high)
    np.testing.assert_array_equal(rewards, near)
    np.testing.assert_array_equal(ends, near)


def test_a_goal_passed_between_two_observations_is_reached():
    made = replay(Hindsight(goal_size=1, radius=0.1, others=1.0))
    made.observations[..., 2] = 2.5
    observations, _, rewards, *_ = sample(made)
    np.testing.assert_array_equal(rewards == 1, observations[:, 0] == 2)


def test_places_come_up_evenly():
    made = replay(Hindsight(goal_size=1), capacity=1000)
    for _ in range(20):
        made.add(block())
    made.following[10:, :, 0] = 1.0  # hundreds of rows in one place
    places = made.places(4000, np.random.default_rng(0))[:, 0]
    values, counts = np.unique(places, return_counts=True)
    assert len(values) == 16
    assert counts.min() > 150


def test_goals_of_exploration_take_their_share_of_the_time():
    made, exploration = replay(Hindsight(goal_size=1)), GoalExploration(1, steps=5.0)
    rng = np.random.default_rng(0)
    observations = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (50, 1))
    sent = np.array([exploration.send(observations, made, 0.3, rng)[:, 2] for _ in range(600)])
    away = sent != -1.0
    assert away.mean() == pytest.approx(0.3, abs=0.05)
    assert set(np.unique(sent[away])) <= set(np.unique(made.following[:STEPS, :, 0]))
    changes = (sent[1:] != sent[:-1])[away[:-1]].mean()
    assert changes == pytest.approx(1 / 5, abs=0.03)
    assert (observations[:, 2] == -1.0).all()
