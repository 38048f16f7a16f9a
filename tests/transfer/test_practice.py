"""What the target practises, and when it stops."""

import numpy as np

from paddlectl.transfer.guidance import GuidanceSettings
from paddlectl.transfer.practice import Practice

NOVEL = np.array([False, True, False, True])
SCENES, LANES = 3, 200
ALWAYS = GuidanceSettings(practice_rate=1.0, trials=4, practice_reached=0.5)


def practice(rules=ALWAYS, novel=NOVEL):
    return Practice(novel, SCENES, LANES, rules, np.random.default_rng(0))


def asked(practising, scene=0):
    """The heads that all lanes are given in a scene, in new episodes."""
    for lane in range(LANES):
        practising.ended(lane)
    return practising.heads(np.arange(LANES), np.full(LANES, scene))


def tell(practising, head, reached, scene=0):
    for hit in reached:
        practising.decided(scene, head, hit)


def test_novel_heads_and_no_others_are_practised_all_alike():
    assert np.bincount(asked(practice()), minlength=4)[[1, 3]].min() >= 70
    assert set(asked(practice())) == {1, 3}


def test_nothing_is_practised_where_a_source_knows_every_head():
    assert set(asked(practice(novel=np.zeros(4, bool)))) == {-1}


def test_once_an_episode():
    practising = practice()
    lanes = np.arange(LANES)
    assert (practising.heads(lanes, lanes % SCENES) >= 0).all()
    assert (practising.heads(lanes, lanes % SCENES) == -1).all()
    practising.ended(7)
    assert np.flatnonzero(practising.heads(lanes, lanes % SCENES) >= 0).tolist() == [7]


def test_in_as_many_decisions_as_the_rate_says():
    rules = GuidanceSettings(practice_rate=0.25)
    assert 0.15 <= (asked(practice(rules)) >= 0).mean() <= 0.35


def test_the_least_tried_comes_first():
    practising = practice()
    tell(practising, 3, [True, True])
    assert set(asked(practising)) == {1}
    assert set(asked(practising, scene=1)) == {1, 3}, "each scene counts for itself"


def test_what_is_hardly_ever_reached_is_given_up_in_that_scene():
    practising = practice()
    tell(practising, 1, [False, False, False, True])
    tell(practising, 3, [True, True, False, False])
    assert set(asked(practising)) == {3}
    tell(practising, 3, [False])
    assert set(asked(practising)) == {-1}
    assert set(asked(practising, scene=2)) == {1, 3}
