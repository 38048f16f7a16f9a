"""Programs as text, one clause a line in ProbLog's style, and back: an exact round trip.

    program = {[probability "::" clause] newline}
    clause  = atom [":-" literal {"," literal}]
    literal = ["!"] atom
    atom    = name "(" [name {"," name}] ")"

A name is `[a-z][a-z0-9_]*`, `%` starts a comment, and a clause never spans lines. Text may come from
anywhere: it is read in one pass, without recursion, and at most `LONGEST_TEXT` characters of it.
"""

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeVar

from paddlectl.errors import InvalidFileError
from paddlectl.logic.atoms import Atom, Literal, Predicate
from paddlectl.logic.clauses import Body, Clause, Program

LONGEST_TEXT = 1_000_000
_LONGEST_NUMBER = 40
_LONGEST_QUOTE = 30

# Classes that repeat stand alone and never nest, so matching is linear.
_TOKEN = re.compile(
    r"(?P<blank>[ \t\r]+|%.*)"
    r"|(?P<name>[a-z][a-z0-9_]*)|(?P<number>[-+.0-9][-+.0-9eE]*)|(?P<mark>::|:-|[!(),])"
)

_T = TypeVar("_T")


class ProgramSyntaxError(InvalidFileError):
    """Text that is no program. Logic knows no files: a caller that read one puts its name in front.

    Attributes:
        line: Counted from 1.
        column: Counted from 1, in characters.
        what: The message without its position.
    """

    def __init__(self, line: int, column: int, what: str) -> None:
        super().__init__(f"{line}:{column}: {what}")
        self.line = line
        self.column = column
        self.what = what

    def __reduce__(self) -> tuple[type["ProgramSyntaxError"], tuple[int, int, str]]:
        return type(self), (self.line, self.column, self.what)  # else it can't leave a process


class _Token(NamedTuple):
    kind: str
    text: str
    line: int
    column: int

    def error(self, what: str) -> ProgramSyntaxError:
        return ProgramSyntaxError(self.line, self.column, what)

    def __str__(self) -> str:
        if self.kind == "end":
            return "the line ends"
        return f"found {_short(self.text)!r}"


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST_QUOTE else text[:_LONGEST_QUOTE] + "…"


def _tokens(text: str, line: int) -> Iterator[_Token]:
    """The tokens of one line, an `end` last."""
    at = end = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ProgramSyntaxError(line, at + 1, f"unexpected character {text[at]!r}")
        kind = match.lastgroup or ""
        at = match.end()
        if kind != "blank":
            end = at
            yield _Token(kind, match.group(), line, match.start() + 1)
    yield _Token("end", "", line, end + 1)


class _Reader:
    """Reads one line from left to right; each method takes one thing of the grammar."""

    def __init__(self, text: str, line: int) -> None:
        self._rest = _tokens(text, line)
        self.next = next(self._rest)

    def _advance(self) -> _Token:
        token = self.next
        self.next = next(self._rest, token)
        return token

    def _accept(self, mark: str) -> bool:
        if self.next.text != mark:
            return False
        self._advance()
        return True

    def _expect(self, mark: str, where: str) -> None:
        if not self._accept(mark):
            raise self.next.error(f"expected {mark!r} {where}, {self.next}")

    def at_end(self) -> bool:
        return self.next.kind == "end"

    def end(self) -> None:
        if not self.at_end():
            raise self.next.error(f"expected the end of the clause, {self.next}")

    def name(self, what: str) -> str:
        if self.next.kind != "name":
            raise self.next.error(f"expected {what}, {self.next}")
        return self._advance().text

    def probability(self) -> float:
        token = self._advance()
        value = _number(token)
        if value is None:
            raise token.error(f"expected a probability, {token}")
        if not 0.0 <= value <= 1.0:
            raise token.error(f"a probability lies in [0, 1], {token}")
        self._expect("::", "after the probability")
        return value

    def atom(self) -> Atom:
        name = self.name("a predicate")
        self._expect("(", f"after {_short(name)!r}")
        terms: list[str] = []
        if not self._accept(")"):
            terms = self._separated(lambda: self.name("a constant"))
            self._expect(")", "after a constant")
        return Predicate(name, len(terms))(*terms)

    def literal(self) -> Literal:
        positive = not self._accept("!")
        return Literal(self.atom(), positive)

    def body(self) -> Body:
        found: set[Literal] = set()

        def add() -> None:
            start = self.next
            literal = self.literal()
            if literal in found:
                raise start.error(f"{_short(str(literal))} stands twice in the body")
            if ~literal in found:
                raise start.error(f"{_short(str(literal))} contradicts its negation in the same body")
            found.add(literal)

        self._separated(add)
        return frozenset(found)

    def clause(self) -> Clause:
        head = self.atom()
        body = self.body() if self._accept(":-") else frozenset()
        self.end()
        return Clause(head, body)

    def _separated(self, item: Callable[[], _T]) -> list[_T]:
        found = [item()]
        while self._accept(","):
            found.append(item())
        return found


def _number(token: _Token) -> float | None:
    if token.text in ("nan", "inf"):
        return float(token.text)
    if token.kind != "number" or len(token.text) > _LONGEST_NUMBER:
        return None
    try:
        return float(token.text)
    except ValueError:
        return None


def _check_length(text: str) -> None:
    if len(text) > LONGEST_TEXT:
        raise ProgramSyntaxError(1, 1, f"longer than {LONGEST_TEXT:,} characters")


def parse_clause(text: str) -> Clause:
    """Reads one clause without a probability, `gt_key() :- !has_key(agent), has_key(env)`.

    Raises:
        ProgramSyntaxError: With the place of the first mistake.
    """
    _check_length(text)
    return _Reader(text, 1).clause()


def parse_program(text: str) -> Program:
    """Reads a program; `parse_program(format_program(p)) == p` for every p.

    Raises:
        ProgramSyntaxError: With the place of the first mistake; also for a clause that stands twice, a
            probability outside [0, 1], and a body that repeats or contradicts a literal.
    """
    _check_length(text)
    found: dict[Clause, float] = {}
    for number, line in enumerate(text.split("\n"), start=1):
        reader = _Reader(line, number)
        if reader.at_end():
            continue
        start = reader.next
        probability, clause = reader.probability(), reader.clause()
        if clause in found:
            raise start.error("the same clause stands above")
        found[clause] = probability
    return Program(tuple(found), tuple(found.values()))


def format_program(program: Program) -> str:
    """The program as text in its own order, `0.98 :: gt_key() :- has_key(env)`; no newline at the end."""
    pairs = zip(program.probabilities, program.clauses, strict=True)
    return "\n".join(f"{float(probability)!r} :: {clause}" for probability, clause in pairs)
