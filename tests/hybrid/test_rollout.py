"""Decisions and episodes of the scripted corridor, step by step as worked by hand."""

from dataclasses import replace

import numpy as np
import pytest

from paddlectl.agents.interaction import Interaction
from paddlectl.hybrid.rollout import PROGRESS, DecisionSettings, Rollout
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.logic.templates import scenes
from scripted import (
    DOMAIN_SUBGOALS,
    END,
    FAR,
    FAR_SCENE,
    HORIZON,
    LEFT,
    MOON,
    NEAR_SCENE,
    OTHER,
    RIGHT,
    STAY,
    TASK,
    TWO,
    ByScript,
    Corridor,
    Teller,
    block,
)

SETTINGS = DecisionSettings(max_steps=5, reached_reward=1.0, delay_cost=0.5, failed_reward=-0.1)


class Run:
    """A rollout at work in corridors, a block at a time."""

    def __init__(self, num_envs, selector, *actors, settings=SETTINGS):
        reader = ClauseLearner((FAR,), scenes((FAR,)), TASK.subgoals, 0)
        rng = np.random.default_rng(0)
        self.environment = Corridor(num_envs, 0)
        self._rollout = Rollout(
            num_envs, reader, selector, actors, settings, 0.9, block(1, num_envs), rng, [selector]
        )
        self._interaction = Interaction(self.environment, self._rollout)

    @property
    def frames(self):
        return self._interaction.frames

    def collect(self, buffer):
        self._rollout.buffer = buffer
        episodes = self._interaction.run(len(buffer.actions))
        assert self._rollout.close(self.environment) is buffer
        return episodes


def decided(teller):
    """scene, subgoal, steps, extrinsic reward, reached: of each episode that ended, in order of ending."""
    going_on, ended = {}, []
    for told in teller.told:
        columns = (told.scene_states // PROGRESS, told.subgoals, told.steps, told.rewards, told.reached)
        for lane, done, *decision in zip(told.lanes, told.done, *columns, strict=True):
            going_on.setdefault(lane, []).append(tuple(value.item() for value in decision))
            if done:
                ended.append(going_on.pop(lane))
    return ended


# The first episode of one lane: subgoal asked for; action; whether the decision ends, has reached; intrinsic
# reward, 1 - 0.5·k/5 after k steps.
EPISODE = [
    (TWO, RIGHT, 0, 0, 0.0),
    (None, RIGHT, 1, 1, 0.8),  # cell 2 in two steps
    (MOON, STAY, 1, 0, -0.1),  # holds already: given up after a step
    (END, RIGHT, 1, 0, -0.1),  # cell 3: another scene
    (END, STAY, 0, 0, 0.0),
    (None, STAY, 0, 0, 0.0),
    (None, STAY, 0, 0, 0.0),
    (None, STAY, 0, 0, 0.0),
    (None, STAY, 1, 0, -0.1),  # five steps are the most
    (END, RIGHT, 0, 0, 0.0),
    (None, RIGHT, 1, 1, 0.8),  # cell 5: solved in step 11
    (OTHER, STAY, 1, 0, -0.1),  # the next episode; nothing of this task to act on
]
# scene, subgoal, steps, extrinsic reward, reached
DECIDED = [
    (NEAR_SCENE, TWO, 2, 0.1, True),
    (NEAR_SCENE, MOON, 1, 0.0, False),
    (NEAR_SCENE, END, 1, 0.0, False),
    (FAR_SCENE, END, 5, 0.0, False),
    (FAR_SCENE, END, 2, 0.5, True),
]


@pytest.fixture
def played():
    subgoals, actions, *_ = zip(*EPISODE, strict=True)
    teller = Teller(subgoal for subgoal in subgoals if subgoal is not None)
    run = Run(1, teller, ByScript(*actions))
    buffer = block(len(EPISODE), 1)
    return run, teller, buffer, run.collect(buffer)


def test_when_decisions_end_and_what_they_pay_the_low_level(played):
    _, _, buffer, _ = played
    _, actions, ends, reached, rewards = zip(*EPISODE, strict=True)
    assert buffer.actions[:, 0].tolist() == list(actions)
    assert buffer.ends[:, 0].tolist() == list(map(bool, ends))
    assert buffer.reached[:, 0].tolist() == list(map(bool, reached))
    assert buffer.rewards[:, 0] == pytest.approx(rewards)
    assert (buffer.log_probs == -0.5).all()
    assert not buffer.guides.any()


def test_shaping_adds_what_a_step_does_to_the_potential():
    # Φ = -0.1 · cells to the goal, γ = 0.9; after an end Φ is 0, and END is 3 cells away where it fails first
    shaped = [0.11, 0.1, 0.0, 0.3, *[0.02] * 4, 0.2, 0.11, 0.1, 0.0]
    subgoals, actions, _, _, rewards = zip(*EPISODE, strict=True)
    teller = Teller(subgoal for subgoal in subgoals if subgoal is not None)
    buffer = block(len(EPISODE), 1)
    Run(1, teller, ByScript(*actions), settings=replace(SETTINGS, shaping=0.1)).collect(buffer)
    assert buffer.rewards[:, 0] == pytest.approx(np.array(rewards) + shaped)


def test_what_the_horizon_cuts_off_keeps_its_potential():
    buffer = block(HORIZON, 1)
    settings = replace(SETTINGS, max_steps=HORIZON + 1, shaping=0.1)
    Run(1, Teller([END]), ByScript(STAY), settings=settings).collect(buffer)
    assert buffer.cut[-1, 0]
    assert buffer.rewards[:, 0] == pytest.approx(0.9 * -0.5 + 0.5)


def test_what_the_low_level_sees_is_of_the_decision_then_running(played):
    _, _, buffer, _ = played
    places = [0, 1, 2, 2, 3, 3, 3, 3, 3, 3, 4, 0]
    subgoals = [TWO, TWO, MOON, *[END] * 8, OTHER]
    assert buffer.observations[:, 0, 0] == pytest.approx(np.array(places) / 10)
    assert buffer.observations[:, 0, 2:].argmax(-1).tolist() == subgoals


def test_the_episode_and_its_decisions(played):
    run, teller, _, (episode,) = played
    assert (episode.order, episode.started, episode.finished, episode.length) == (0, 0, 11, 11)
    assert episode.score == 0.5
    assert run.frames == 12
    assert decided(teller) == [[(*each[:3], pytest.approx(each[3]), each[4]) for each in DECIDED]]
    assert [told.guides.tolist() for told in teller.told[:5]] == [[0]] * 5
    assert episode.scenes == (NEAR_SCENE, FAR_SCENE), "each once, however many decisions were taken there"


def test_the_selector_is_asked_when_a_decision_has_ended_and_told_what_came_of_it(played):
    _, teller, _, _ = played
    scenes_asked = [NEAR_SCENE] * 3 + [FAR_SCENE] * 2 + [NEAR_SCENE]
    assert teller.asked == [[(0, scene)] for scene in scenes_asked]
    told = [
        (*map(int, (o.scene_states[0] // PROGRESS, o.subgoals[0], o.steps[0])), o.done[0])
        for o in teller.told
    ]
    assert told[:5] == [(*each[:3], done) for each, done in zip(DECIDED, [False] * 4 + [True], strict=True)]
    led_to = [int(o.next_scene_states[0] // PROGRESS) for o in teller.told[:4]]
    assert led_to == [NEAR_SCENE, NEAR_SCENE, FAR_SCENE, FAR_SCENE]


def test_a_situation_tells_how_many_decisions_were_paid(played):
    _, teller, _, _ = played
    assert teller.progress == [[0], [1], [1], [1], [1], [0]]
    assert [int(o.scene_states[0] % PROGRESS) for o in teller.told] == [0, 1, 1, 1, 1, 0]
    assert [int(o.next_scene_states[0] % PROGRESS) for o in teller.told[:4]] == [1, 1, 1, 1]


def test_an_episode_that_is_cut_off_ends_its_decision_unreached():
    teller = Teller([END])
    buffer = block(HORIZON, 1)
    (episode,) = Run(1, teller, ByScript(STAY)).collect(buffer)
    assert (episode.score, episode.length) == (0.0, HORIZON)
    assert episode.scenes == (NEAR_SCENE,)
    assert [(steps, reached) for _, _, steps, _, reached in decided(teller)[0]] == [
        (5, False), (5, False), (2, False),
    ]  # fmt: skip
    assert buffer.rewards[:, 0] == pytest.approx([0, 0, 0, 0, -0.1] * 2 + [0, 0])
    assert (buffer.ends & ~buffer.cut)[:, 0].nonzero()[0].tolist() == [4, 9], "the horizon is no failure"
    assert buffer.cut[:, 0].nonzero()[0].tolist() == [HORIZON - 1]
    assert [bool(outcome.cut[0]) for outcome in teller.told] == [False, False, True]
    assert [bool(outcome.done[0]) for outcome in teller.told] == [False, False, True]


def test_a_scene_that_changes_back_ends_a_decision_too():
    buffer = block(4, 1)
    Run(1, Teller([END]), ByScript(RIGHT, RIGHT, RIGHT, LEFT)).collect(buffer)
    assert buffer.ends[:, 0].tolist() == [False, False, True, True]


# order, started, finished, score, length of all that end within 14 steps of three lanes that walk right;
# layouts 0, 1, 2 end at cells 5, 6, 7, and so do 3, 4, 5
WALKS = [
    (0, 0, 15, 0.5, 5),
    (1, 0, 18, 0.505, 6),
    (2, 0, 21, 0.51, 7),
    (3, 15, 30, 0.515, 5),
    (4, 18, 36, 0.52, 6),
    (5, 21, 42, 0.525, 7),
]


@pytest.mark.parametrize("blocks", [[14], [7, 7], [4, 4, 6], [1] * 14])
def test_episodes_are_ordered_by_their_start_whatever_the_blocks(blocks):
    teller = Teller([END])
    run = Run(3, teller, ByScript(RIGHT))
    episodes = [episode for steps in blocks for episode in run.collect(block(steps, 3))]
    assert [episode[:5] for episode in episodes] == [
        (order, started, finished, pytest.approx(score), length)
        for order, started, finished, score, length in WALKS
    ]
    for episode, decisions in zip(episodes, decided(teller), strict=True):
        assert episode.scenes == (NEAR_SCENE, FAR_SCENE)
        # the milestone of cell 2 falls into the first decision of each episode, not only of the first
        assert decisions == [
            (NEAR_SCENE, END, 3, pytest.approx(0.1), False),
            (FAR_SCENE, END, episode.length - 3, pytest.approx(episode.score), True),
        ]


def test_lanes_that_end_together_start_in_their_order():
    run = Run(4, Teller([END]), ByScript(RIGHT))
    episodes = run.collect(block(12, 4))
    assert [(e.order, e.finished) for e in episodes if e.finished == 20] == [(0, 20), (3, 20)]
    # lane 0 draws layout 4 then, and lane 3 layout 5: eleven and twelve steps after the start
    assert [(e.order, e.started, e.finished) for e in episodes if e.started == 20] == [
        (4, 20, 44),
        (5, 20, 48),
    ]


def test_only_lanes_without_a_decision_are_asked_for():
    teller = Teller([END])
    Run(3, teller, ByScript(RIGHT)).collect(block(7, 3))
    every = [(lane, NEAR_SCENE) for lane in range(3)]
    far = [(lane, FAR_SCENE) for lane in range(3)]
    assert teller.asked == [every, far, [(0, NEAR_SCENE)], [(1, NEAR_SCENE)]]


def test_each_lane_is_moved_by_its_guide():
    teller = Teller([END], guides=(0, 2, 1, 2))
    own, one, two = ByScript(RIGHT), ByScript(STAY), ByScript(RIGHT, STAY)
    buffer = block(3, 4)
    run = Run(4, teller, own, one, two)
    run.collect(buffer)
    assert buffer.guides.tolist() == [[0, 2, 1, 2]] * 3
    assert run.environment.place.tolist() == [3, 1, 0, 1]
    assert [len(seen) for seen in (own.seen[0], one.seen[0], two.seen[0])] == [1, 1, 2]
    assert two.seen[0][:, 1].tolist() == [1, 0], "the observations of lanes 1 and 3"


def test_the_last_observations_are_what_comes_after_the_block():
    buffer = block(2, 2)
    Run(2, Teller([END]), ByScript(RIGHT)).collect(buffer)
    assert buffer.last_observations[:, 0] == pytest.approx([0.2, 0.2])
    assert buffer.last_observations[:, 2:].argmax(-1).tolist() == [END, END]
    assert len(DOMAIN_SUBGOALS) == buffer.last_observations.shape[1] - 2


def test_the_last_state_of_a_decision_is_kept_as_it_was_before_what_came_next():
    """Three lanes: cut off by the horizon at cell 2; solved at cell 5; and one whose decision just ends."""
    standing = [RIGHT, RIGHT, *[STAY] * (HORIZON - 2)]
    buffer, teller = block(HORIZON, 1), Teller([MOON, *[END] * 3, OTHER])
    Run(1, teller, ByScript(*standing)).collect(buffer)
    assert buffer.cut[:, 0].nonzero()[0].tolist() == [HORIZON - 1]
    # the cell, the layout and the subgoal of the decision that was cut off, not of the next episode
    assert buffer.final_observations[-1, 0] == pytest.approx([0.2, 0.0, 0, 0, 1, 0])
    assert buffer.last_observations[0, 0] == 0.0
    solved, again = block(6, 1), Teller([END, END, OTHER])
    Run(1, again, ByScript(RIGHT), settings=replace(SETTINGS, max_steps=9)).collect(solved)
    assert solved.terminated[:, 0].nonzero()[0].tolist() == [4]
    assert solved.final_observations[4, 0] == pytest.approx([0.5, 0.0, 0, 0, 1, 0])
    assert solved.final_observations[2, 0] == pytest.approx([0.3, 0.0, 0, 0, 1, 0]), "the scene changed there"
    following = solved.following()[:, 0, 0]
    assert following == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.1])


def test_a_subgoal_that_is_reached_as_the_horizon_comes_is_reached():
    """Cell 2 is come to in the last step of the episode."""
    buffer, teller = block(HORIZON, 1), Teller([TWO])
    Run(1, teller, ByScript(RIGHT, *[STAY] * (HORIZON - 2), RIGHT)).collect(buffer)
    assert buffer.truncated[-1, 0]
    assert buffer.reached[-1, 0]
    assert not buffer.cut.any()
    assert [bool(o.cut[0]) for o in teller.told] == [False] * len(teller.told)
