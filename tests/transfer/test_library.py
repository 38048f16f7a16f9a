"""ψ of very many programs: the same numbers as the pure function's, to the last bit."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl.logic.atoms import Literal, Predicate
from paddlectl.logic.clauses import Clause, Program, Scene, scenes_of
from paddlectl.logic.syntax import ProgramSyntaxError, format_program
from paddlectl.transfer import library
from paddlectl.transfer.library import library_of, mean_similarities
from paddlectl.transfer.similarity import map_scenes

ATOMS = tuple(Predicate(name, 0)() for name in "pqrstu")
HEADS = tuple(Predicate(name, 0)() for name in ("gt_key", "gt_door", "gt_ball", "gt_box"))
BODIES = st.dictionaries(st.sampled_from(ATOMS), st.booleans()).map(
    lambda signs: frozenset(Literal(atom, sign) for atom, sign in signs.items())
)
SCENES = st.builds(Scene, BODIES, st.frozensets(st.sampled_from(HEADS)))
CLAUSES = st.lists(st.builds(Clause, st.sampled_from(HEADS), BODIES), unique=True, max_size=8)
WEIGHTS = st.floats(0.0, 1.0)


def text(clauses: list[Clause]) -> str:
    return format_program(Program(tuple(clauses), tuple(0.5 for _ in clauses)))


def by_mapping(target: list[Scene], programs: list[list[Clause]], *weights: float) -> list[float]:
    sources = {str(number): scenes_of(clauses) for number, clauses in enumerate(programs)}
    mapping = map_scenes(target, sources, *weights)
    return [mapping.overall(name) for name in sources]


@given(
    st.lists(SCENES, unique_by=lambda each: each.body, max_size=5),
    st.lists(CLAUSES, max_size=6),
    WEIGHTS,
    WEIGHTS,
)
@settings(max_examples=300, deadline=None)
def test_it_says_what_the_mapping_says(
    target: list[Scene], programs: list[list[Clause]], body: float, head: float
) -> None:
    found = mean_similarities(target, library_of(map(text, programs)), body, head)
    assert found.tolist() == by_mapping(target, programs, body, head)


def test_so_it_does_for_many_programs_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(0)

    def drawn() -> Clause:
        body = {atom: rng.random() < 0.5 for atom in rng.sample(ATOMS, rng.randint(0, 6))}
        return Clause(rng.choice(HEADS), frozenset(Literal(atom, sign) for atom, sign in body.items()))

    target = list(scenes_of(drawn() for _ in range(30)))
    programs = [list({drawn() for _ in range(rng.randint(0, 6))}) for _ in range(200)]
    assert [] in programs
    monkeypatch.setattr(library, "_AT_ONCE", 33)
    assert mean_similarities(target, library_of(map(text, programs))).tolist() == by_mapping(target, programs)


def test_a_clause_that_can_not_be_read_is_told() -> None:
    with pytest.raises(ProgramSyntaxError):
        library_of(["0.5 :: gt_key() :- p()", "0.5 :: gt_key( :- p()"])


def test_impossible_weights_are_refused() -> None:
    with pytest.raises(ValueError, match="weight"):
        mean_similarities([Scene(frozenset(), frozenset(HEADS))], library_of([]), -0.1, 0.2)
