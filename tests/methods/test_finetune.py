"""What a target takes from its source before it learns."""

import pytest
import torch

from paddlectl.errors import UsageError
from paddlectl.learners.clauses import ClauseLearner
from paddlectl.logic.atoms import Predicate
from paddlectl.logic.templates import scenes
from paddlectl.methods.base import Setup
from paddlectl.methods.finetune import FINETUNE, take_clauses
from paddlectl.methods.hdm import HDM
from paddlectl.tasks.suite import load
from scripted import FAR, GT_END, GT_MOON, GT_OTHER, GT_TWO

LIT = Predicate("lit", 0)()


def clauses(atoms, heads, first):
    """Weights `first`, `first` + 1, …"""
    made = ClauseLearner(atoms, scenes(atoms), heads, 0)
    with torch.no_grad():
        made.weights.copy_(first + torch.arange(made.weights.numel()).reshape(made.weights.shape))
    return made


def by_clause(learner):
    return {
        (body, head): learner.weights[row, column].item()
        for row, body in enumerate(learner.bodies)
        for column, head in enumerate(learner.heads)
    }


def test_a_target_that_knows_more_facts_takes_the_heads_that_it_shares():
    target, source = clauses((FAR, LIT), (GT_MOON, GT_END, GT_TWO), 0), clauses((FAR,), (GT_TWO, GT_END), 100)
    before, theirs = by_clause(target), by_clause(source)
    take_clauses(target, source)
    for (body, head), weight in by_clause(target).items():
        (known,) = (other for other in source.bodies if other <= body)
        assert weight == theirs.get((known, head), before[body, head])
    assert target.weights.requires_grad
    # !far: 100, 101, far: 102, 103, for gt_two and gt_end; gt_moon stays as it was
    taken = {tuple(row) for row in target.weights[:, 1:].tolist()}
    assert taken == {(101.0, 100.0), (103.0, 102.0)}
    assert target.weights[:, 0].tolist() == [0, 3, 6, 9]


@pytest.mark.parametrize(
    "atoms, heads",
    [((FAR, LIT), (GT_END, GT_TWO)), ((LIT,), (GT_END, GT_TWO)), ((FAR,), (GT_OTHER,))],
    ids=["a body with a fact more", "another body", "another head"],
)
def test_what_does_not_match_is_left_as_it_was(atoms, heads):
    target, source = clauses((FAR,), (GT_END, GT_TWO), 0), clauses(atoms, heads, 100)
    take_clauses(target, source)
    assert target.weights.tolist() == [[0, 1], [2, 3]]


@pytest.mark.parametrize("name", ["BoxDoor", "MailMaze"])
def test_without_a_source_it_is_refused(name):
    task = load(name)
    with pytest.raises(UsageError) as told:
        FINETUNE.make(Setup(task, FINETUNE.settings_for(task, None), 0, 100))
    assert told.value.message == f"finetune needs a source for {name}, and has none"
    assert told.value.hint == f"learn it alone: paddlectl train {name} --method hdm"


def test_the_source_stays_as_it_is():
    target, source = clauses((FAR,), (GT_END,), 0), clauses((FAR,), (GT_END,), 100)
    take_clauses(target, source)
    with torch.no_grad():
        target.weights += 1
    assert source.weights.tolist() == [[100], [101]]


def test_its_low_level_learns_on_where_there_is_nobody_to_imitate():
    maze = load("CoffeeMailMaze")
    assert HDM.settings_for(maze, None).low_level.cloning
    assert not FINETUNE.settings_for(maze, None).low_level.cloning
