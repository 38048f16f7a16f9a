"""Deduction against its closed form, and Eq. 1 against the formula written out."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from paddlectl.learners.clauses import ClauseLearner, ClauseSettings
from paddlectl.logic.atoms import Predicate
from paddlectl.logic.templates import scenes
from paddlectl.tasks.suite import load

P, Q = Predicate("p", 0)(), Predicate("q", 0)()
GO, STAY = Predicate("go", 0)(), Predicate("stay", 0)()


def learner(atoms=(P, Q), exclusions=(), heads=(GO, STAY), seed=0, **settings):
    return ClauseLearner(atoms, scenes(atoms, exclusions), heads, seed, ClauseSettings(**settings))


def of_task(name, seed=0):
    task = load(name)
    return learner(task.vocabulary.atoms, task.vocabulary.exclusions, task.subgoals, seed)


def set_weights(made, rows):
    with torch.no_grad():
        made.weights.copy_(torch.tensor(rows))


def step(made, decisions):
    """One update from (scene, head, return, imitate) rows."""
    scene, head, return_, imitate = zip(*decisions, strict=True)
    made.update(np.array(scene), np.array(head), np.array(return_, np.float32), np.array(imitate))


@pytest.mark.parametrize("task", ["BlockedDoor", "GapBall", "BlockedBoxUnlockPickup"])
def test_with_a_crisp_valuation_deduction_is_the_scenes_softmax(task):
    made = of_task(task)
    crisp = np.array([[bool(body_has(body, atom)) for atom in made.atoms] for body in made.bodies])
    expected = torch.tensor(made.weights.detach().numpy()).softmax(-1)
    torch.testing.assert_close(made.deduce(torch.from_numpy(crisp).float()), expected)
    np.testing.assert_allclose(made.probabilities(), expected, rtol=1e-6)
    assert made.scenes(crisp).tolist() == list(range(len(made.bodies)))


def body_has(body, atom):
    return any(literal.atom == atom and literal.positive for literal in body)


def test_a_valuation_that_no_scene_allows_names_none():
    made = of_task("BlockedDoor")
    names = [str(atom) for atom in made.atoms]
    two_hands = np.array([[name in ("has_key(agent)", "has_blockage(agent)") for name in names]])
    assert made.scenes(two_hands).tolist() == [-1]


def test_soft_deduction_as_worked_by_hand():
    made = learner()
    half, three = math.log(1.0), math.log(3.0)  # a row (log 3, log 1) is played 3/4 : 1/4
    set_weights(made, [[half, half], [three, half], [half, three], [three, half]])
    # v(p) = 0.5, v(q) = 0.2: !p!q 0.4, !p q 0.1, p !q 0.4, p q 0.1
    # go: 0.4·1/2 + 0.1·3/4 + 0.4·1/4 + 0.1·3/4 = 0.45
    found = made.deduce(torch.tensor([[0.5, 0.2], [1.0, 0.0]]))
    assert found.tolist() == [pytest.approx([0.45, 0.55]), pytest.approx([0.25, 0.75])]


def test_what_no_scene_allows_is_shared_out_over_the_others():
    made = learner(exclusions=[frozenset(scenes((P, Q))[3])])  # never p and q
    made_weights = [[math.log(3.0), 0.0], [0.0, 0.0], [0.0, math.log(3.0)]]
    set_weights(made, made_weights)
    # v(p) = v(q) = 0.5: three scenes of 0.25 each; go: (3/4 + 1/2 + 1/4)·0.25 / 0.75 = 1/2
    assert made.deduce(torch.tensor([[0.5, 0.5]])).tolist() == [pytest.approx([0.5, 0.5])]


ONE_OF_MANY = of_task("GapBall", seed=3)


@given(st.lists(st.lists(st.floats(0.01, 0.99), min_size=5, max_size=5), min_size=1, max_size=4))
def test_soft_deduction_gives_distributions_and_is_the_expected_softmax(rows):
    valuation = torch.tensor(rows, dtype=torch.float64)
    found = ONE_OF_MANY.deduce(valuation.float()).detach().numpy()
    assert (found >= 0).all()
    np.testing.assert_allclose(found.sum(-1), 1.0, rtol=1e-5)
    for row, values in zip(found, rows, strict=True):
        chances = [
            math.prod(
                v if body_has(body, a) else 1 - v for a, v in zip(ONE_OF_MANY.atoms, values, strict=True)
            )
            for body in ONE_OF_MANY.bodies
        ]
        expected = np.array(chances) @ ONE_OF_MANY.probabilities() / sum(chances)
        np.testing.assert_allclose(row, expected, rtol=1e-4)


def test_deduction_is_differentiable_in_weights_and_valuation():
    made = learner()
    set_weights(made, [[0.0, 0.0], [math.log(3.0), 0.0], [0.0, 0.0], [0.0, 0.0]])
    valuation = torch.tensor([[0.5, 0.2]], requires_grad=True)
    made.deduce(valuation)[0, 0].backward()
    # go = 1/2 + 1/4·(1 - v(p))·v(q): by v(p) -0.05, by v(q) 0.125; by a weight: activation·p·(1 - p)
    assert valuation.grad.tolist() == [pytest.approx([-0.05, 0.125])]
    by_weight = [[0.1, -0.1], [0.1 * 3 / 16, -0.1 * 3 / 16], [0.1, -0.1], [0.025, -0.025]]
    np.testing.assert_allclose(made.weights.grad, by_weight, rtol=1e-5)


def test_one_update_follows_the_gradient_of_equation_1():
    made = learner(seed=5, entropy_coef=0.1, learning_rate=1.0)
    decisions = [(0, 0, 0.5, False), (0, 1, 1.0, False), (2, 1, 0.25, True), (0, 1, 0.0, False)]
    weights = made.weights.detach().double().clone().requires_grad_()
    # the gain of Eq. 1 by its letter, the baseline still zero
    gain = sum(
        return_ * weights[scene].softmax(-1)[head].log()
        - 0.1 * (weights[scene].softmax(-1) * weights[scene].softmax(-1).log()).sum()
        for scene, head, return_, _ in decisions
    ) / len(decisions)
    gain.backward()
    step(made, decisions)
    np.testing.assert_allclose(-made.weights.grad, weights.grad, rtol=1e-4, atol=1e-7)
    moved = made.weights.detach().double() - weights.detach()
    assert torch.equal(moved.sign(), weights.grad.sign()), "ascent"
    assert not moved[[1, 3]].any(), "scenes that weren't visited stay"


def test_gradient_of_a_uniform_scene_by_hand():
    made = learner(entropy_coef=0.0)
    set_weights(made, [[0.0, 0.0]] * 4)
    step(made, [(1, 0, 0.8, False)])
    # d log p(go) / d w = (1 - 1/2, -1/2), times the return, descended
    assert made.weights.grad[1].tolist() == pytest.approx([-0.4, 0.4])


def test_the_baseline_is_a_scenes_mean_return_and_is_taken_off():
    made = learner(entropy_coef=0.0, baseline_step=0.02)
    step(made, [(0, 0, 1.0, False), (0, 1, 0.0, False)])
    assert made.baseline.tolist() == [0.5, 0.0, 0.0, 0.0]
    step(made, [(0, 0, 0.8, False), (0, 0, 0.8, False)])  # four visits: 0.5 + 2/4·(0.8 - 0.5)
    assert made.baseline.tolist() == pytest.approx([0.65, 0.0, 0.0, 0.0])
    set_weights(made, [[0.0, 0.0]] * 4)
    step(made, [(0, 0, 0.65, False)])  # just as usual: no advantage
    assert made.weights.grad[0].tolist() == pytest.approx([0.0, 0.0], abs=1e-7)
    step(made, [(0, 0, 0.25, False)])  # worse than usual: less of it
    assert made.weights.grad[0, 0] > 0


def taught(imitate):
    """How likely the guide's head is after a hundred updates with nearly equal returns."""
    made = learner(seed=1)
    for number in range(100):
        step(made, [(0, 1, 0.9 + 0.01 * (-1) ** number, imitate)] * 8)
    return made.probabilities()[0, 1]


def test_a_crisp_guide_teaches_its_head_by_imitation_alone():
    assert taught(imitate=True) > 0.95
    assert taught(imitate=False) < 0.8


def test_decisions_that_pay_are_learned():
    made = learner(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(60):
        heads = rng.integers(2, size=16)
        step(made, [(scene := head ^ 1 ^ (i % 2), head, float(scene == head), False)
                    for i, head in enumerate(heads)])  # fmt: skip
    assert made.probabilities()[0, 0] > 0.9
    assert made.probabilities()[1, 1] > 0.9


def test_an_update_without_decisions_changes_nothing():
    made = learner()
    before = made.weights.detach().clone()
    made.update(*(np.zeros(0, kind) for kind in (np.intp, np.intp, np.float32, np.bool_)))
    assert torch.equal(made.weights, before)


def test_equal_seeds_give_equal_tensors_bit_for_bit():
    def run(seed):
        made = learner(seed=seed)
        for return_ in (0.2, 0.9, 0.4):
            step(made, [(0, 1, return_, False), (3, 0, 1.0, True)])
        return made.state()

    one, same, other = run(4), run(4), run(5)
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not torch.equal(one["clauses.weights"], other["clauses.weights"])


def test_state_is_taken_back():
    made, fresh = learner(seed=1), learner(seed=2)
    step(made, [(0, 1, 0.7, False)])
    fresh.load(made.state())
    assert torch.equal(fresh.weights, made.weights)
    assert torch.equal(fresh.baseline, made.baseline)
    kept = fresh.weights.detach().clone()
    step(made, [(0, 1, 0.7, True)])
    assert torch.equal(fresh.weights, kept), "a copy, not the other's tensors"
