"""Which novel subgoals the target tries, and when it stops."""

import numpy as np

from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.transfer.novel_subgoals import NovelSubgoalExploration

NOVEL = np.array([False, True, False, True])
SCENES, LANES = 3, 200
ALWAYS = GuidanceSettings(novel_subgoal_rate=1.0, trials=4, novel_subgoal_success=0.5)


def exploration(rules=ALWAYS, novel=NOVEL):
    return NovelSubgoalExploration(novel, SCENES, LANES, rules, np.random.default_rng(0))


def asked(exploring, scene=0):
    """The subgoals that all lanes are given in a scene, in new episodes."""
    for lane in range(LANES):
        exploring.ended(lane)
    return exploring.subgoals(np.arange(LANES), np.full(LANES, scene))


def tell(exploring, subgoal, reached, scene=0):
    for hit in reached:
        exploring.record(scene, subgoal, hit)


def test_novel_subgoals_and_no_others_are_explored_all_alike():
    assert np.bincount(asked(exploration()), minlength=4)[[1, 3]].min() >= 70
    assert set(asked(exploration())) == {1, 3}


def test_nothing_is_explored_where_a_source_knows_every_subgoal():
    assert set(asked(exploration(novel=np.zeros(4, bool)))) == {-1}


def test_once_an_episode():
    exploring = exploration()
    lanes = np.arange(LANES)
    assert (exploring.subgoals(lanes, lanes % SCENES) >= 0).all()
    assert (exploring.subgoals(lanes, lanes % SCENES) == -1).all()
    exploring.ended(7)
    assert np.flatnonzero(exploring.subgoals(lanes, lanes % SCENES) >= 0).tolist() == [7]


def test_in_as_many_decisions_as_the_rate_says():
    rules = GuidanceSettings(novel_subgoal_rate=0.25)
    assert 0.15 <= (asked(exploration(rules)) >= 0).mean() <= 0.35


def test_the_least_tried_comes_first():
    exploring = exploration()
    tell(exploring, 3, [True, True])
    assert set(asked(exploring)) == {1}
    assert set(asked(exploring, scene=1)) == {1, 3}, "each scene counts for itself"


def test_what_is_hardly_ever_reached_is_given_up_in_that_scene():
    exploring = exploration()
    tell(exploring, 1, [False, False, False, True])
    tell(exploring, 3, [True, True, False, False])
    assert set(asked(exploring)) == {3}
    tell(exploring, 3, [False])
    assert set(asked(exploring)) == {-1}
    assert set(asked(exploring, scene=2)) == {1, 3}
