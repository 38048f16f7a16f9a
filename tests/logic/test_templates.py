import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Clause, body_text
from paddlectl.logic.templates import all_clauses, scenes

A, B, C = (Predicate(name, 0)() for name in "abc")
GT_KEY, GT_DOOR = Predicate("gt_key", 0)(), Predicate("gt_door", 0)()


def texts(bodies):
    return [body_text(body) for body in bodies]


def test_scenes_count_in_binary_with_the_first_atom_most_significant():
    assert texts(scenes((A, B), ())) == ["!a(), !b()", "!a(), b()", "a(), !b()", "a(), b()"]
    assert texts(scenes((B, A), ())) == ["!a(), !b()", "a(), !b()", "!a(), b()", "a(), b()"]


def test_an_exclusion_removes_the_scenes_that_contain_it():
    never_both = frozenset({Literal(A), Literal(B)})
    neither_a_nor_c = frozenset({Literal(A, False), Literal(C, False)})
    assert texts(scenes((A, B, C), (never_both, neither_a_nor_c))) == [
        "!a(), !b(), c()",
        "!a(), b(), c()",
        "a(), !b(), !c()",
        "a(), !b(), c()",
    ]


def test_without_atoms_there_is_one_empty_scene():
    assert scenes((), ()) == (frozenset(),)


def test_exclusions_may_leave_nothing():
    assert scenes((A,), (frozenset({Literal(A)}), frozenset({~Literal(A)}))) == ()


@given(st.lists(st.dictionaries(st.sampled_from((A, B, C)), st.booleans(), min_size=1), max_size=4))
@settings(deadline=None)
def test_exactly_the_consistent_scenes_are_left(signs):
    exclusions = [frozenset(Literal(atom, sign) for atom, sign in each.items()) for each in signs]
    left = scenes((A, B, C), exclusions)
    assert all(body in left or any(e <= body for e in exclusions) for body in scenes((A, B, C)))
    assert not any(e <= body for e in exclusions for body in left)


def test_all_clauses_go_scene_by_scene():
    never = (frozenset({Literal(A), Literal(B)}),)
    clauses = all_clauses((A, B), never, (GT_KEY, GT_DOOR))
    bodies = scenes((A, B), never)
    assert clauses == tuple(Clause(head, body) for body in bodies for head in (GT_KEY, GT_DOOR))
    assert len(clauses) == 6
    assert str(clauses[1]) == "gt_door() :- !a(), !b()"


@pytest.mark.parametrize(
    ("atoms", "exclusions", "what"),
    [
        ((A, B, A), (), "an atom stands twice"),
        ((A,), (frozenset(),), "empty exclusion"),
        ((A,), (frozenset({Literal(A), Literal(B)}),), r"names b\(\)"),
    ],
)
def test_a_faulty_vocabulary_is_refused(atoms, exclusions, what):
    with pytest.raises(ValueError, match=what):
        scenes(atoms, exclusions)


def test_a_head_that_stands_twice_is_refused():
    with pytest.raises(ValueError, match="a head stands twice"):
        all_clauses((A,), (), (GT_KEY, GT_KEY))
