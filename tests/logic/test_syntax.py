import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from paddlectl.errors import PaddlectlError
from paddlectl.logic.atoms import Atom, Literal, Predicate
from paddlectl.logic.clauses import Clause, Program
from paddlectl.logic.syntax import (
    LONGEST_TEXT,
    ProgramSyntaxError,
    format_program,
    parse_clause,
    parse_program,
)

NAMES = st.builds(str.__add__, st.sampled_from("abz"), st.text(alphabet="az09_", max_size=4))
ATOMS = st.builds(
    lambda name, terms: Atom(Predicate(name, len(terms)), tuple(terms)), NAMES, st.lists(NAMES, max_size=2)
)
BODIES = st.dictionaries(ATOMS, st.booleans(), max_size=4).map(
    lambda signs: frozenset(Literal(atom, positive) for atom, positive in signs.items())
)
CLAUSES = st.builds(Clause, ATOMS, BODIES)
PROGRAMS = st.dictionaries(CLAUSES, st.floats(0, 1), max_size=5).map(
    lambda found: Program(tuple(found), tuple(found.values()))
)

KEY = Literal(Predicate("has_key", 1)("agent"))
OPEN = Literal(Predicate("is_open", 1)("door"))
GT_KEY = Predicate("gt_key", 0)()


@given(PROGRAMS)
@settings(deadline=None)
def test_a_program_survives_its_text_exactly(program):
    text = format_program(program)
    again = parse_program(text)
    assert again == program
    assert [repr(p) for p in again.probabilities] == [repr(p) for p in program.probabilities]
    assert format_program(again) == text


@given(CLAUSES)
@settings(deadline=None)
def test_a_clause_survives_its_text(clause):
    assert parse_clause(str(clause)) == clause


def test_a_program_is_written_a_clause_a_line():
    program = Program((Clause(GT_KEY, frozenset({~KEY, OPEN})), Clause(GT_KEY, frozenset())), (0.98, 1e-07))
    assert format_program(program) == (
        "0.98 :: gt_key() :- !has_key(agent), is_open(door)\n1e-07 :: gt_key()"
    )
    assert format_program(Program((), ())) == ""


def test_blanks_comments_and_windows_line_ends_are_skipped():
    text = "% learned % twice\r\n\r\n\t 1::gt_key():-!has_key( agent )  ,is_open(door)% why\r\n\n  % end"
    assert parse_program(text) == Program((Clause(GT_KEY, frozenset({~KEY, OPEN})),), (1.0,))


@pytest.mark.parametrize("text", ["", "\n\n", "% nothing", "   "])
def test_a_text_without_clauses_is_the_empty_program(text):
    assert parse_program(text) == Program((), ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gt_key()", "1:1: expected a probability, found 'gt_key'"),
        ("\n 1.2 :: gt_key()", "2:2: a probability lies in [0, 1], found '1.2'"),
        ("-0.1 :: gt_key()", "1:1: a probability lies in [0, 1], found '-0.1'"),
        ("nan :: gt_key()", "1:1: a probability lies in [0, 1], found 'nan'"),
        ("inf :: gt_key()", "1:1: a probability lies in [0, 1], found 'inf'"),
        ("1e999 :: gt_key()", "1:1: a probability lies in [0, 1], found '1e999'"),
        ("0.5.5 :: gt_key()", "1:1: expected a probability, found '0.5.5'"),
        ("0.5 gt_key()", "1:5: expected '::' after the probability, found 'gt_key'"),
        ("0.5 :: ", "1:7: expected a predicate, the line ends"),
        ("0.5 :: % gt_key()", "1:7: expected a predicate, the line ends"),
        ("0.5 :: gt_key", "1:14: expected '(' after 'gt_key', the line ends"),
        ("0.5 :: gt_key(", "1:15: expected a constant, the line ends"),
        ("0.5 :: gt_key(a,)", "1:17: expected a constant, found ')'"),
        ("0.5 :: gt_key(a b)", "1:17: expected ')' after a constant, found 'b'"),
        ("0.5 :: gt_key() :-", "1:19: expected a predicate, the line ends"),
        ("0.5 :: gt_key() :- a(),", "1:24: expected a predicate, the line ends"),
        ("0.5 :: gt_key() :- !!a()", "1:21: expected a predicate, found '!'"),
        ("0.5 :: gt_key().", "1:16: expected the end of the clause, found '.'"),
        ("0.5 :: gt_key() 0.5 :: a()", "1:17: expected the end of the clause, found '0.5'"),
        ("0.5 :: Key()", "1:8: unexpected character 'K'"),
        ("0.5 : gt_key()", "1:5: unexpected character ':'"),
        ("0.5 :: gt_key() :- has_key(X)", "1:28: unexpected character 'X'"),
        ("٠.5 :: gt_key()", "1:1: unexpected character '٠'"),
        ("0.5 :: a() :- b(x), !b(x)", "1:21: !b(x) contradicts its negation in the same body"),
        ("0.5 :: a() :- !b(x), b(x)", "1:22: b(x) contradicts its negation in the same body"),
        ("0.5 :: a() :- b(x), b(x)", "1:21: b(x) stands twice in the body"),
        ("0.5 :: a() :- b(), c()\n%\n  0.1 :: a() :- c(), b()", "3:3: the same clause stands above"),
        (f"0.5 :: {'a' * 50}", f"1:58: expected '(' after '{'a' * 30}…', the line ends"),
    ],
)
def test_a_mistake_is_told_with_its_place(text, message):
    with pytest.raises(ProgramSyntaxError) as caught:
        parse_program(text)
    assert str(caught.value) == message
    assert message == f"{caught.value.line}:{caught.value.column}: {caught.value.what}"
    assert isinstance(caught.value, PaddlectlError) and caught.value.exit_code == 3


@pytest.mark.parametrize(
    "text", ["", "gt_key()\ngt_door()", "gt_key() % x\ngt_door()", "0.5 :: gt_key()", "!gt_key()"]
)
def test_parse_clause_takes_one_clause_and_no_more(text):
    with pytest.raises(ProgramSyntaxError):
        parse_clause(text)


def _read(text):
    """Whether the text is a program; anything but the documented error falls through."""
    try:
        parse_program(text)
    except ProgramSyntaxError as error:
        assert error.line >= 1 and error.column >= 1 and "\n" not in str(error)
        return False
    return True


@given(st.one_of(st.text(), st.text(alphabet="ab(),:-!%.019e+ \n\t\r\x00", max_size=200)))
@settings(deadline=None, max_examples=300)
def test_random_text_raises_nothing_but_the_documented_error(text):
    _read(text)


@given(PROGRAMS, st.data())
@settings(deadline=None, max_examples=100)
def test_a_damaged_program_raises_nothing_but_the_documented_error(program, data):
    text = format_program(program)
    at = data.draw(st.integers(0, len(text)))
    _read(text[:at] + data.draw(st.text(max_size=2)) + text[at + data.draw(st.integers(0, 3)) :])


@pytest.mark.parametrize(
    "unit",
    [
        "a",
        "0",
        ".",
        ":",
        "::",
        "(",
        "((((",
        "a(",
        "!",
        ",",
        " ",
        "\t",
        "\r",
        "%",
        "\n",
        "a,",
        "0.5 ::",
        "e+",
        "é",
    ],
)
@pytest.mark.parametrize("start", ["", "0.5 :: a() :- ", "0.5 :: a("])
def test_a_million_hostile_characters_are_read_in_linear_time(start, unit):
    text = (start + unit * LONGEST_TEXT)[:LONGEST_TEXT]
    began = time.process_time()
    _read(text)
    assert time.process_time() - began < 5.0


def test_a_body_of_hostile_length_is_read():
    literals = ", ".join(f"a{index}()" for index in range(100_000))
    program = parse_program(f"0.5 :: b() :- {literals}")
    assert len(program.clauses[0].body) == 100_000


def test_longer_text_is_refused():
    assert parse_program(" " * LONGEST_TEXT) == Program((), ())
    for parse in (parse_program, parse_clause):
        with pytest.raises(ProgramSyntaxError, match=r"^1:1: longer than 1,000,000 characters"):
            parse(" " * (LONGEST_TEXT + 1))
