"""ψ of a target with very many programs: Algorithm 1, lines 8-22, counted by NumPy.

It gives what `SceneMapping.overall` gives, to the last bit. Programs share most of their clauses, and each
distinct one is parsed once.
"""

from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paddlectl.logic.clauses import Clause, Scene
from paddlectl.logic.syntax import parse_clause
from paddlectl.transfer.similarity import BODY_WEIGHT, HEAD_WEIGHT, similarity_table

_AT_ONCE = 2_000  # programs; bounds the memory

_Ints = NDArray[np.int64]


class Library(NamedTuple):
    """Programs by their clauses.

    Attributes:
        clauses: The distinct ones of all programs.
        numbers: Of clauses, one program after the other.
        lengths: How many clauses each program has.
    """

    clauses: Sequence[Clause]
    numbers: NDArray[np.int32]
    lengths: NDArray[np.int32]


def library_of(programs: Iterable[str]) -> Library:
    """Programs as `format_program` writes them. Their probabilities aren't looked at: ψ needs none.

    Raises:
        ProgramSyntaxError: If a clause can't be read.
    """
    known: dict[str, int] = {}
    clauses: list[Clause] = []
    numbers, lengths = array("i"), array("i")
    for program in programs:
        texts = dict.fromkeys(line.partition(" :: ")[2] for line in program.split("\n") if line)
        for text in texts:
            if text not in known:
                known[text] = len(clauses)
                clauses.append(parse_clause(text))
        numbers.extend([known[text] for text in texts])
        lengths.append(len(texts))
    return Library(clauses, np.array(numbers, dtype=np.int32), np.array(lengths, dtype=np.int32))


def mean_similarities(
    target: Sequence[Scene],
    library: Library,
    body_weight: float = BODY_WEIGHT,
    head_weight: float = HEAD_WEIGHT,
) -> NDArray[np.float64]:
    """For each program the mean, over the target's scenes, of the largest ψ among its scenes.

    Raises:
        ValueError: If a weight is negative or not finite.
    """
    bodies = {body: n for n, body in enumerate(dict.fromkeys(clause.body for clause in library.clauses))}
    body_of = np.array([bodies[clause.body] for clause in library.clauses], dtype=np.int64)
    literals = _shared([scene.body for scene in target], list(bodies))
    heads = _shared([scene.heads for scene in target], [{clause.head} for clause in library.clauses])
    tables = _stacked([similarity_table(scene, body_weight, head_weight) for scene in target])
    means = np.zeros(len(library.lengths))
    for programs, numbers, starts in _chunks(library):
        owner = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(numbers)))
        order = np.lexsort((body_of[numbers], owner))
        numbers, body = numbers[order], body_of[numbers[order]]
        scenes = np.flatnonzero(np.diff(body, prepend=-1) | np.diff(owner, prepend=-1))
        shared_literals = literals[:, body[scenes]]
        shared_heads = np.add.reduceat(heads[:, numbers], scenes, axis=1)
        found = tables[np.arange(len(target))[:, None], shared_literals, shared_heads]
        best = np.maximum.reduceat(found, np.searchsorted(owner[scenes], np.arange(len(starts))), axis=1)
        means[programs] = sum(best) / max(1, len(target))  # one scene after the other, as `overall` adds
    return means


def _chunks(library: Library) -> Iterator[tuple[_Ints, _Ints, _Ints]]:
    """Some programs that have clauses, the numbers of these, and where each program's begin."""
    ends = np.cumsum(library.lengths, dtype=np.int64)
    some = np.flatnonzero(library.lengths)
    for first in range(0, len(some), _AT_ONCE):
        programs = some[first : first + _AT_ONCE]
        starts = ends[programs] - library.lengths[programs]
        begin = starts[0]
        yield programs, library.numbers[begin : ends[programs[-1]]].astype(np.int64), starts - begin


def _shared(target: Sequence[Collection[Any]], others: Sequence[Collection[Any]]) -> _Ints:
    """How many members each set of the target's shares with each of the others."""
    members = {member: n for n, member in enumerate({member for each in target for member in each})}

    def rows(sets: Sequence[Collection[Any]]) -> NDArray[np.float32]:
        found = np.zeros((len(sets), len(members)), dtype=np.float32)
        for row, each in zip(found, sets, strict=True):
            row[[members[member] for member in each if member in members]] = 1.0
        return found

    return (rows(target) @ rows(others).T).astype(np.int64)


def _stacked(tables: Sequence[Sequence[Sequence[float]]]) -> NDArray[np.float64]:
    """One after the other; smaller ones are filled up."""
    most = max((len(table) for table in tables), default=0), max((len(t[0]) for t in tables), default=0)
    found = np.zeros((len(tables), *most))
    for whole, table in zip(found, tables, strict=True):
        whole[: len(table), : len(table[0])] = table
    return found
