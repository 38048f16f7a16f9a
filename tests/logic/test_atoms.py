import pytest

from paddlectl.logic.atoms import Atom, Literal, Predicate

HAS_KEY = Predicate("has_key", 1)
GT_KEY = Predicate("gt_key", 0)


def test_atoms_and_literals_print_as_logic():
    near = Predicate("near", 2)("agent", "door_2")
    assert str(HAS_KEY("agent")) == "has_key(agent)"
    assert str(GT_KEY()) == "gt_key()"
    assert str(near) == "near(agent, door_2)"
    assert str(Literal(near)) == "near(agent, door_2)"
    assert str(~Literal(near)) == "!near(agent, door_2)"


def test_equal_values_are_equal_and_hash_alike():
    twin = Atom(Predicate("has_key", 1), ("agent",))
    assert twin == HAS_KEY("agent")
    assert len({twin, HAS_KEY("agent"), HAS_KEY("env")}) == 2


def test_printing_an_atom_does_not_change_its_identity():
    printed, fresh = HAS_KEY("agent"), HAS_KEY("agent")
    str(printed)
    assert printed == fresh and hash(printed) == hash(fresh)


def test_negation_is_its_own_inverse():
    literal = Literal(HAS_KEY("agent"))
    assert ~literal != literal
    assert ~~literal == literal


def test_literals_sort_by_name_then_terms_then_negative_first():
    a_env, a_agent, b = HAS_KEY("env"), HAS_KEY("agent"), Predicate("is_open", 1)("door")
    literals = [Literal(b), Literal(a_env), Literal(a_agent), Literal(a_agent, False)]
    expected = ["!has_key(agent)", "has_key(agent)", "has_key(env)", "is_open(door)"]
    assert [str(literal) for literal in sorted(literals)] == expected


@pytest.mark.parametrize("name", ["", "Key", "1key", "_key", "gt key", "gt-key", "schlüssel", "key\n"])
def test_a_predicate_has_a_lower_case_name(name):
    with pytest.raises(ValueError, match="predicate name"):
        Predicate(name, 0)


@pytest.mark.parametrize("term", ["", "Agent", "a b", "a,b", "agent\n"])
def test_a_constant_is_an_identifier(term):
    with pytest.raises(ValueError, match="constant"):
        HAS_KEY(term)


@pytest.mark.parametrize("terms", [(), ("agent", "env")])
def test_a_predicate_takes_as_many_terms_as_its_arity(terms):
    with pytest.raises(ValueError, match="takes 1 terms"):
        HAS_KEY(*terms)


def test_values_are_frozen():
    with pytest.raises(AttributeError):
        HAS_KEY.name = "other"
