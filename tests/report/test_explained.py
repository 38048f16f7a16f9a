"""The sentences of `explain`: who led, why, and who was dropped."""

from paddlectl.report.explained import SceneMet, Standing, sentences

BODY = ("has_key(env)",)


def sentence(*standings):
    met = SceneMet(BODY, {"early": 100}, {"early": standings})
    return sentences(met, lambda policy: policy.upper(), lambda policy, body: "gt_key()")[0]


def test_the_leader_and_its_rival_are_named_with_their_weights():
    told = sentence(Standing("good", 0.7, 0.8, 0.8, 90, 81), Standing("other", 0.6, 0.5, 0.5, 10, 1))
    assert told.startswith("Early: GOOD led 90 % of 100 decisions: ψ 0.70, Φ 0.80, the highest Λ 0.80")
    assert "before OTHER's 0.50; its subgoal gt_key() was reached in 90 %." in told
    assert "Dropped" not in told


def test_a_source_that_was_dropped_is_named():
    told = sentence(Standing("good", 0.7, 0.8, 0.8, 90, 81), Standing("wrong", 0.9, 0.3, -0.6, 10, 0))
    assert told.endswith("Dropped here, as its subgoal was hardly ever reached: WRONG.")
