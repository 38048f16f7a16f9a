"""A program as Prolog text, for engines such as SWI-Prolog.

The facts of a state are given as `holds(has_key(agent))`; what isn't given doesn't hold. `subgoal/2` has one
clause for each clause of the program, `fires/1` takes the likeliest subgoal of the scene.
"""

from paddlectl.logic.atoms import Atom
from paddlectl.logic.clauses import Body, Clause, Program

_HEAD = """\
% A clause program learned by paddlectl, for any Prolog; tested with SWI-Prolog.
% Say what is true, and ask for the subgoal:
%   ?- assertz(holds(has_key(env))), fires(Subgoal).

:- dynamic(holds/1).

% fires(Subgoal): the likeliest subgoal of the present scene; the first of those that are equally likely.
fires(Subgoal) :-
    findall(P-S, subgoal(S, P), Found),
    likeliest(Found, Subgoal).

likeliest([P-S|Rest], Subgoal) :-
    likeliest(Rest, P, S, Subgoal).

likeliest([], _, Subgoal, Subgoal).
likeliest([P-S|Rest], Most, _, Subgoal) :-
    P > Most, !,
    likeliest(Rest, P, S, Subgoal).
likeliest([_|Rest], Most, Best, Subgoal) :-
    likeliest(Rest, Most, Best, Subgoal).

% subgoal(Subgoal, Probability): one clause for each of the program's, in its order.
:- discontiguous(subgoal/2).
:- dynamic(subgoal/2).
"""


def format_prolog(program: Program) -> str:
    """The program as Prolog text that loads without a warning."""
    clauses = zip(program.clauses, program.probabilities, strict=True)
    return _HEAD + "".join(f"\n{_clause(clause, p)}" for clause, p in clauses)


def fired(program: Program, body: Body) -> Atom | None:
    """The likeliest subgoal of a scene, first of equals, as `fires/1` finds it; None in an unknown one."""
    heads = program.policy(body)
    return max(heads, key=lambda head: heads[head]) if heads else None


def prolog_atom(atom: Atom) -> str:
    """An atom as a Prolog term: `has_key(agent)`, and `gt_key` where there are no terms."""
    return f"{atom.predicate.name}({','.join(atom.terms)})" if atom.terms else atom.predicate.name


def _clause(clause: Clause, probability: float) -> str:
    head = f"subgoal({prolog_atom(clause.head)}, {_number(probability)})"
    literals = [
        f"holds({prolog_atom(literal.atom)})"
        if literal.positive
        else f"\\+ holds({prolog_atom(literal.atom)})"
        for literal in sorted(clause.body)
    ]
    return f"{head} :-\n    " + ",\n    ".join(literals) + ".\n" if literals else f"{head}.\n"


def _number(probability: float) -> str:
    """With a point, which some engines ask for before an exponent: 1e-05 is 1.0e-05."""
    mantissa, exponent, rest = repr(float(probability)).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{rest}"
