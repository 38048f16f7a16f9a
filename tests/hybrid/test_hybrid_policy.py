"""Programs read off a policy, and the subgoals that it plays."""

import numpy as np
import pytest
import torch

from paddlectl.hybrid.policy import (
    HybridPolicy,
    ProgramSelector,
    domain_subgoals,
    sample_rows,
    sharpened,
    task_subgoals,
)
from paddlectl.hybrid.rollout import PROGRESS
from paddlectl.hybrid.settings import HybridSettings
from paddlectl.logic.atoms import Literal
from paddlectl.logic.clauses import Clause
from scripted import END, FAR, FAR_SCENE, GT_END, GT_MOON, GT_TWO, MOON, NEAR_SCENE, TASK, TWO

NEAR_BODY, FAR_BODY = frozenset({Literal(FAR, False)}), frozenset({Literal(FAR)})


@pytest.fixture
def policy():
    """Plays gt_end, gt_two, gt_moon near with 0.05, 0.9, 0.05 and far with 0.8, 0.1, 0.1."""
    made = HybridPolicy(TASK, 0, HybridSettings())
    with torch.no_grad():
        made.clauses.weights.copy_(torch.tensor([[0.05, 0.9, 0.05], [0.8, 0.1, 0.1]]).log())
    return made


def clauses(program):
    return dict(zip(program.clauses, program.probabilities, strict=True))


def test_the_complete_program_has_every_scene_and_subgoal(policy):
    assert clauses(policy.program()) == {
        Clause(GT_END, NEAR_BODY): 0.05,
        Clause(GT_TWO, NEAR_BODY): 0.9,
        Clause(GT_MOON, NEAR_BODY): 0.05,
        Clause(GT_END, FAR_BODY): 0.8,
        Clause(GT_TWO, FAR_BODY): 0.1,
        Clause(GT_MOON, FAR_BODY): 0.1,
    }


def test_clauses_below_the_threshold_are_left_out(policy):
    kept = clauses(policy.program(threshold=0.2))
    assert kept == {Clause(GT_TWO, NEAR_BODY): 0.9, Clause(GT_END, FAR_BODY): 0.8}


def test_scenes_that_were_not_visited_are_left_out(policy):
    assert {clause.body for clause in policy.program(np.array([FAR_SCENE])).clauses} == {FAR_BODY}
    assert clauses(policy.program(np.array([NEAR_SCENE]), 0.1)) == {Clause(GT_TWO, NEAR_BODY): 0.9}
    assert policy.program(np.array([], np.intp)).clauses == ()


def test_subgoals_are_numbered_by_the_domain():
    assert domain_subgoals(TASK).tolist() == [END, TWO, MOON]
    assert task_subgoals(TASK).tolist() == [-1, 1, 0, 2]


def test_subgoals_are_played_as_often_as_the_program_says(policy):
    selector = ProgramSelector(policy, np.random.default_rng(0))
    guides, subgoals = selector.select(np.arange(20_000), np.full(20_000, FAR_SCENE * PROGRESS + 2))
    assert not guides.any()
    assert np.bincount(subgoals, minlength=4) / 20_000 == pytest.approx([0.0, 0.1, 0.8, 0.1], abs=0.01)


def test_a_sharpened_program_is_played_crisper(policy):
    selector = ProgramSelector(policy, np.random.default_rng(0), sharpness=3.0)
    _, subgoals = selector.select(np.arange(20_000), np.full(20_000, FAR_SCENE * PROGRESS + 2))
    assert (subgoals == END).mean() == pytest.approx(0.512 / 0.514, abs=0.003)


def test_new_weights_are_played_after_a_refresh(policy):
    selector = ProgramSelector(policy, np.random.default_rng(0))
    with torch.no_grad():
        policy.clauses.weights.copy_(torch.tensor([[0.0, 0.0, 99.0]] * 2))
    selector.refresh()
    _, subgoals = selector.select(np.arange(50), np.zeros(50, np.intp))
    assert (subgoals == MOON).all()


def test_sharpening_by_hand():
    found = sharpened(np.array([[0.5, 0.25, 0.25], [0.0, 1.0, 0.0]], np.float32), 2.0)
    assert found.tolist() == [pytest.approx([2 / 3, 1 / 6, 1 / 6]), [0.0, 1.0, 0.0]]


def test_rows_are_sampled_by_their_shares_whatever_their_sum():
    rng = np.random.default_rng(0)
    rows = np.repeat(np.array([[1.0, 0.0, 3.0], [0.0, 0.2, 0.0]], np.float32), 20_000, axis=0)
    drawn = sample_rows(rows, rng)
    assert (drawn[:20_000] == 2).mean() == pytest.approx(0.75, abs=0.01)
    assert not (drawn[:20_000] == 1).any()
    assert (drawn[20_000:] == 1).all()


def test_state_is_taken_back(policy):
    other = HybridPolicy(TASK, 1, HybridSettings())
    other.load(policy.state())
    assert other.program() == policy.program()
    assert all(torch.equal(tensor, other.state()[name]) for name, tensor in policy.state().items())


def test_the_seed_makes_the_tensors():
    one, same, other = (HybridPolicy(TASK, seed, HybridSettings()).state() for seed in (3, 3, 4))
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not torch.equal(one["clauses.weights"], other["clauses.weights"])
    assert not torch.equal(one["actor.0.weight"], other["actor.0.weight"])
