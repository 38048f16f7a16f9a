import itertools
import random
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Clause, Program
from paddlectl.logic.minimise import minimise
from paddlectl.logic.syntax import parse_program
from paddlectl.logic.templates import scenes

ATOMS = tuple(Predicate(f"p{index}", 0)() for index in range(13))
HEADS = tuple(Predicate(name, 0)() for name in ("gt_key", "gt_door", "gt_ball"))


def texts(program, impossible=(), threshold=0.1):
    return [str(clause) for clause in minimise(program, impossible, threshold)]


def fired(clauses, body):
    return {clause.head for clause in clauses if clause.body <= body}


def assert_same_heads(program, impossible, threshold=0.1):
    original = [c for c, p in zip(program.clauses, program.probabilities, strict=True) if p >= threshold]
    short = minimise(program, impossible, threshold)
    atoms = {literal.atom for clause in program.clauses for literal in clause.body}
    for body in set(scenes(sorted(atoms))) - set(impossible):
        assert fired(short, body) == fired(original, body)
    return short


def bodies(*texts):
    return [parse_program(f"1 :: h() :- {text}").clauses[0].body for text in texts]


KEY_THEN_DOOR = parse_program(
    """
    0.97 :: gt_key()  :- !has_key(agent), !is_open(door)
    0.95 :: gt_door() :- has_key(agent), !is_open(door)
    0.05 :: gt_key()  :- has_key(agent), !is_open(door)
    0.99 :: gt_ball() :- has_key(agent), is_open(door)
    0.60 :: gt_ball() :- !has_key(agent), is_open(door)
    """
)


def test_a_program_in_its_fewest_shortest_clauses():
    assert texts(KEY_THEN_DOOR) == [
        "gt_key() :- !has_key(agent), !is_open(door)",
        "gt_door() :- has_key(agent), !is_open(door)",
        "gt_ball() :- is_open(door)",
    ]


def test_impossible_scenes_are_free_to_be_covered():
    opened_without_key = bodies("!has_key(agent), is_open(door)")
    assert texts(KEY_THEN_DOOR, opened_without_key) == [
        "gt_key() :- !has_key(agent)",
        "gt_door() :- has_key(agent), !is_open(door)",
        "gt_ball() :- is_open(door)",
    ]


def test_the_threshold_includes_its_own_value():
    program = parse_program("0.1 :: a() :- p()\n0.09 :: b() :- p()\n0.5 :: c() :- !p()")
    assert texts(program) == ["a() :- p()", "c() :- !p()"]
    assert texts(program, threshold=0.0) == ["a() :- p()", "b() :- p()", "c() :- !p()"]
    assert texts(program, threshold=0.2) == ["c() :- !p()"]


def test_a_head_of_every_possible_scene_needs_no_body():
    program = parse_program("1 :: a() :- p()\n1 :: a() :- !p()\n1 :: b() :- p()")
    assert texts(program) == ["a()", "b() :- p()"]
    assert texts(program, bodies("!p()")) == ["a()", "b()"]


def test_a_head_of_impossible_scenes_alone_vanishes():
    assert texts(parse_program("1 :: a() :- p()\n1 :: b() :- !p()"), bodies("p()")) == ["b()"]


def test_exclusive_or_keeps_two_clauses():
    program = parse_program("1 :: a() :- p(), !q()\n1 :: a() :- !p(), q()")
    assert texts(program) == ["a() :- !p(), q()", "a() :- p(), !q()"]


def test_programs_without_atoms_or_clauses():
    assert texts(Program((), ())) == []
    assert texts(parse_program("0.4 :: a()\n0.01 :: b()")) == ["a()"]


def test_bodies_over_different_atoms_are_refused():
    with pytest.raises(ValueError, match="same atoms"):
        minimise(parse_program("1 :: a() :- p()\n1 :: a() :- q()"), ())
    with pytest.raises(ValueError, match="same atoms"):
        minimise(parse_program("1 :: a() :- p()"), bodies("p(), q()"))
    with pytest.raises(ValueError, match="contradicts"):
        minimise(
            Program((Clause(HEADS[0], frozenset({Literal(ATOMS[0]), Literal(ATOMS[0], False)})),), (1.0,)), ()
        )


@st.composite
def programs(draw):
    every = scenes(ATOMS[: draw(st.integers(1, 4))])
    found = draw(
        st.dictionaries(
            st.builds(Clause, st.sampled_from(HEADS), st.sampled_from(every)), st.floats(0, 1), max_size=20
        )
    )
    return Program(tuple(found), tuple(found.values())), draw(st.sets(st.sampled_from(every)))


@given(programs())
@settings(deadline=None, max_examples=150)
def test_the_same_heads_fire_in_every_possible_scene(drawn):
    program, impossible = drawn
    short = assert_same_heads(program, impossible)
    original = [c for c, p in zip(program.clauses, program.probabilities, strict=True) if p >= 0.1]
    assert len(short) <= len(original)
    assert [h for h, _ in itertools.groupby(c.head for c in short)] == list(
        dict.fromkeys(c.head for c in program.clauses if c.head in {s.head for s in short})
    )
    assert minimise(program, sorted(impossible, key=sorted), 0.1) == short


def sparse(atoms, possible, seed):
    """A crisp program over few possible scenes, as a trained source has it."""
    every = scenes(ATOMS[:atoms])
    rng = random.Random(seed)
    some = rng.sample(every, possible)
    program = Program(tuple(Clause(rng.choice(HEADS), body) for body in some), (1.0,) * possible)
    return program, set(every) - set(some)


@pytest.mark.parametrize(("atoms", "possible"), [(7, 20), (8, 12), (8, 40), (9, 30), (10, 30), (12, 20)])
def test_many_atoms_stay_right_and_quick(atoms, possible):
    program, impossible = sparse(atoms, possible, seed=atoms)
    began = time.process_time()
    short = minimise(program, impossible)
    assert time.process_time() - began < 1.0
    assert_same_heads(program, impossible)
    assert len(short) < possible and max(len(clause.body) for clause in short) < 7


def test_a_head_that_needs_every_atom_keeps_its_clauses():
    odd = [body for body in scenes(ATOMS[:9]) if sum(literal.positive for literal in body) % 2]
    program = Program(tuple(Clause(HEADS[0], body) for body in odd), (1.0,) * len(odd))
    assert set(minimise(program, ())) == set(program.clauses)


def test_more_atoms_than_can_be_counted_keep_their_clauses():
    many = frozenset(Literal(Predicate(f"q{index}", 0)()) for index in range(60))
    program = Program((Clause(HEADS[0], many),), (1.0,))
    assert minimise(program, ()) == program.clauses
