import pytest

from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Clause, Program, Scene, body_text, scenes_of

KEY = Literal(Predicate("has_key", 1)("agent"))
OPEN = Literal(Predicate("is_open", 1)("door"))
GT_KEY, GT_DOOR = Predicate("gt_key", 0)(), Predicate("gt_door", 0)()
SHUT, BARE = frozenset({KEY, ~OPEN}), frozenset({~KEY, ~OPEN})


def test_a_body_prints_in_the_order_of_its_atoms():
    assert body_text(frozenset({~OPEN, KEY})) == "has_key(agent), !is_open(door)"
    assert body_text(frozenset()) == ""


def test_clauses_and_scenes_print_in_the_papers_style():
    assert str(Clause(GT_DOOR, SHUT)) == "gt_door() :- has_key(agent), !is_open(door)"
    assert str(Clause(GT_DOOR, frozenset())) == "gt_door()"
    scene = Scene(BARE, frozenset({GT_KEY, GT_DOOR}))
    assert str(scene) == "[gt_door(), gt_key()] :- !has_key(agent), !is_open(door)"


def test_scenes_group_clauses_by_body_in_order_of_first_appearance():
    clauses = [Clause(GT_DOOR, SHUT), Clause(GT_KEY, BARE), Clause(GT_KEY, SHUT)]
    expected = (Scene(SHUT, frozenset({GT_DOOR, GT_KEY})), Scene(BARE, frozenset({GT_KEY})))
    assert scenes_of(clauses) == expected
    assert scenes_of([]) == ()


def test_a_body_and_its_subset_are_different_scenes():
    clauses = [Clause(GT_KEY, frozenset({KEY})), Clause(GT_KEY, SHUT), Clause(GT_KEY, frozenset())]
    assert [scene.body for scene in scenes_of(clauses)] == [frozenset({KEY}), SHUT, frozenset()]


def test_the_policy_of_a_scene_is_its_heads_with_their_probabilities():
    program = Program((Clause(GT_DOOR, SHUT), Clause(GT_KEY, SHUT), Clause(GT_KEY, BARE)), (0.7, 0.2, 1.0))
    assert program.policy(SHUT) == {GT_DOOR: 0.7, GT_KEY: 0.2}
    assert program.policy(frozenset({KEY, OPEN})) == {}


@pytest.mark.parametrize("probability", [-0.01, 1.01, float("nan"), float("inf")])
def test_a_probability_outside_the_unit_interval_is_refused(probability):
    with pytest.raises(ValueError, match="probability"):
        Program((Clause(GT_KEY, BARE),), (probability,))


def test_a_program_refuses_a_clause_that_stands_twice_and_a_missing_probability():
    clause = Clause(GT_KEY, BARE)
    with pytest.raises(ValueError, match="twice"):
        Program((clause, clause), (0.5, 0.4))
    with pytest.raises(ValueError, match="one probability"):
        Program((clause,), ())
