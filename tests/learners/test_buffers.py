"""GAE and the samples of decisions that reached, against tables worked by hand and an independent oracle."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from paddlectl.learners.buffers import RolloutBuffer, generalised_advantages


def advantages(rewards, values, last_values, ends, discount, trace_decay):
    tensors = (
        torch.tensor(np.asarray(each), dtype=torch.float64) for each in (rewards, values, last_values, ends)
    )
    return generalised_advantages(*tensors, discount, trace_decay).numpy()


# One lane, γ = 0.5, λ = 0.5. δ = r + γ·V(next)·(1 - end) - V; A = δ + γλ·(1 - end)·A(next).
# reward, value, end -> δ, A
WORKED = [
    (1.0, 2.0, 0),  # δ = 1 + 0.5·4 - 2  =  1;   A =  1   + 0.25·-2     =  0.5
    (2.0, 4.0, 1),  # δ = 2 + 0     - 4  = -2;   A = -2
    (0.0, 1.0, 0),  # δ = 0 + 0.5·6 - 1  =  2;   A =  2   + 0.25·3      =  2.75
    (4.0, 6.0, 0),  # δ = 4 + 0.5·10 - 6 =  3;   A =  3   (the block's end: V(s_T) = 10, still running)
]


def test_advantages_as_worked_by_hand():
    rewards, values, ends = (np.array(column)[:, None] for column in zip(*WORKED, strict=True))
    assert advantages(rewards, values, [10.0], ends, 0.5, 0.5)[:, 0].tolist() == [0.5, -2.0, 2.75, 3.0]


def test_a_block_that_ends_with_a_decision_does_not_bootstrap():
    assert advantages([[4.0]], [[6.0]], [10.0], [[1]], 0.5, 0.5).tolist() == [[-2.0]]


def test_lanes_are_independent():
    # lane 0 ends at once, lane 1 runs on: A = 1 + 0.5·V(s_T) - 0 and, before it, 0.25 of that
    found = advantages([[3.0, 0.0], [0.0, 1.0]], np.zeros((2, 2)), [0.0, 2.0], [[1, 0], [1, 0]], 0.5, 0.5)
    assert found.tolist() == [[3.0, 0.5], [0.0, 2.0]]


def test_without_a_trace_it_is_the_one_step_error_and_with_a_full_one_the_return():
    rewards, values, ends = [[1.0], [2.0], [4.0]], [[8.0], [8.0], [8.0]], [[0], [0], [1]]
    assert advantages(rewards, values, [9.0], ends, 0.5, 0.0)[:, 0].tolist() == [-3.0, -2.0, -4.0]
    assert advantages(rewards, values, [9.0], ends, 0.5, 1.0)[:, 0].tolist() == [-5.0, -4.0, -4.0]


def recursive(rewards, values, last_value, ends, discount, trace_decay, t=0):
    """GAE of one lane by its definition: the sum of (γλ)^k·δ up to the decision's end."""
    if t == len(rewards):
        return []
    following = values[t + 1] if t + 1 < len(values) else last_value
    error = rewards[t] - values[t] + (0.0 if ends[t] else discount * following)
    rest = recursive(rewards, values, last_value, ends, discount, trace_decay, t + 1)
    carried = 0.0 if ends[t] or not rest else discount * trace_decay * rest[0]
    return [error + carried, *rest]


@st.composite
def blocks(draw):
    shape = (draw(st.integers(1, 8)), draw(st.integers(1, 3)))
    numbers = st.floats(-10, 10, width=32)
    share = st.floats(0.0, 1.0)
    rewards, values = (draw(arrays.arrays(np.float64, shape, elements=numbers)) for _ in range(2))
    last = draw(arrays.arrays(np.float64, shape[1:], elements=numbers))
    return rewards, values, last, draw(arrays.arrays(np.bool_, shape)), draw(share), draw(share)


@given(blocks())
def test_advantages_agree_with_the_definition(block):
    rewards, values, last, ends, discount, trace_decay = block
    found = advantages(rewards, values, last, ends, discount, trace_decay)
    for lane in range(rewards.shape[1]):
        expected = recursive(
            rewards[:, lane], values[:, lane], last[lane], ends[:, lane], discount, trace_decay
        )
        assert found[:, lane] == pytest.approx(expected, abs=1e-9)


# ends, reached and whether the sample belongs to a decision known to have reached; r: reached, f: failed,
# ".": goes on
REACHED = [
    ("..r", "111"),
    ("..f", "000"),
    ("...", "000"),  # not known yet
    ("r..", "100"),
    (".fr", "001"),
    ("r.f", "100"),
    (".r.r.", "11110"),
    ("f.r.", "0110"),
]


@pytest.mark.parametrize(("steps", "member"), REACHED)
def test_samples_of_decisions_that_reached(steps, member):
    buffer = RolloutBuffer.empty(len(steps), 2, 1)
    buffer.ends[:, 0] = [step != "." for step in steps]
    buffer.reached[:, 0] = [step == "r" for step in steps]
    found = buffer.of_reached_decisions()
    assert "".join(str(int(each)) for each in found[:, 0]) == member
    assert not found[:, 1].any()
