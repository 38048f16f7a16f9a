"""A policy's program: as a document, and for people."""

from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import RenderableType

from paddlectl.experiments.similar import stored_program
from paddlectl.logic.clauses import Body, Program
from paddlectl.logic.minimise import MOST_ATOMS, minimise
from paddlectl.logic.templates import scenes
from paddlectl.registry.records import PolicyRecord
from paddlectl.report.grid import Grid, Head, Row
from paddlectl.report.output import clean

MAIN = 0.5
"""Probability from which a clause stands in the minimised program: what is done more often than not."""


def program_document(policy: PolicyRecord) -> dict[str, Any]:
    """`{policy, task, clauses: [{head, body, probability}], minimised: [text]}`."""
    program = stored_program(policy)
    return {
        "policy": policy.id,
        "task": policy.task,
        "clauses": [
            {
                "head": str(clause.head),
                "body": [str(literal) for literal in sorted(clause.body)],
                "probability": probability,
            }
            for clause, probability in zip(program.clauses, program.probabilities, strict=True)
        ],
        "minimised": [str(clause) for clause in minimise(program, unmet_scenes(program), MAIN)],
    }


def unmet_scenes(program: Program) -> tuple[Body, ...]:
    """The scenes that the program is silent on: they can't occur in its task, or not on its path, or it
    has no subgoal there that it takes more often than not.

    None of a vocabulary that `minimise` leaves alone for its size.
    """
    clauses = zip(program.clauses, program.probabilities, strict=True)
    met = {clause.body for clause, probability in clauses if probability >= MAIN}
    atoms = sorted({literal.atom for clause in program.clauses for literal in clause.body})
    if len(atoms) > MOST_ATOMS:
        return ()
    return tuple(body for body in scenes(atoms) if body not in met)


def program_parts(document: Mapping[str, Any]) -> list[RenderableType]:
    """The raw program with its probabilities, and the minimised one."""
    if not document["clauses"]:
        return [f"{clean(document['policy'])} for {clean(document['task'])} has no clause program."]
    raw = [
        (f"{clause['probability']:.2f} ::", clause["head"], ", ".join(clause["body"]))
        for clause in document["clauses"]
    ]
    return [
        f"{clean(document['policy'])} for {clean(document['task'])}",
        "",
        "Learned, with the probability that each clause is executed, from 0.1 on:",
        _grid(raw),
        "",
        "What it mostly does, in the shortest clauses for the scenes that it meets:",
        minimised_grid(document["minimised"]),
    ]


def minimised_grid(clauses: Iterable[str]) -> RenderableType:
    """Clauses without probabilities, their bodies below each other."""
    return _grid(("", head, body) for head, _, body in (text.partition(" :- ") for text in clauses))


def _grid(clauses: Iterable[tuple[str, str, str]]) -> RenderableType:
    """Probability, head and body below each other, so that a body that is too long hangs."""
    rows = [
        Row([clean(probability), clean(f"{head} :-" if body else head), clean(body)])
        for probability, head, body in clauses
    ]
    return Grid((Head(), Head(), Head(breaks=True)), rows, indent=2) if rows else "  (no clause)"
