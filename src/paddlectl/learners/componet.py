"""CompoNet's module (Malagón, Ceberio & Lozano, 2024): a policy composed of frozen policies and its own."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import nn

from paddlectl.learners.networks import HIDDEN, mlp


class Composition(NamedTuple):
    """What the logits of n states are made of.

    Attributes:
        attention: Of the output head, on each source; sums to 1. [n, K]
        tentative: v, the sources' probabilities weighed by it. [n, A]
        internal: What the internal policy adds. [n, A]
    """

    attention: torch.Tensor
    tentative: torch.Tensor
    internal: torch.Tensor


class CompoNet(nn.Module):
    """Logits of a policy that attends to what frozen policies would do.

    1. Φ: the sources' probabilities for the state s.
    2. Output head: v = softmax(q_out(s) · k_out(Φ + E)ᵀ / √d) Φ.
    3. Input head: c = softmax(q_in(s) · k_in([Φ; v] + E)ᵀ / √d) v_in([Φ; v]).
    4. The logits are v + internal(c, s).

    E encodes the place of a row; the state is its own encoding.

    Args:
        sources: K networks of logits, [n, F] -> [n, A]; they are frozen.
        size: F, numbers in a state.
        actions: A.
        width: d, of queries, keys and the input head's values.
        hidden: Units of each layer of the internal policy.
    """

    places: torch.Tensor

    def __init__(
        self,
        sources: Sequence[nn.Module],
        size: int,
        actions: int,
        width: int,
        hidden: tuple[int, ...] = HIDDEN,
    ) -> None:
        super().__init__()
        self.sources = nn.ModuleList(sources).requires_grad_(False)
        self.out_query = nn.Linear(size, width)
        self.out_key = nn.Linear(actions, width)
        self.in_query = nn.Linear(size, width)
        self.in_key = nn.Linear(actions, width)
        self.in_value = nn.Linear(actions, width)
        self.internal = mlp(width + size, actions, hidden=hidden, output_gain=0.01)
        self.register_buffer("places", encoded_places(len(sources) + 1, actions), persistent=False)

    def forward(self, states: torch.Tensor) -> torch.Tensor:
        """[n, F] -> [n, A]"""
        composition = self.compose(states)
        return composition.tentative + composition.internal

    def compose(self, states: torch.Tensor) -> Composition:
        """The parts of the logits. [n, F]"""
        known = torch.stack([source(states).softmax(-1) for source in self.sources], 1)
        attention = _attention(self.out_query(states), self.out_key(known + self.places[:-1]))
        tentative = _weighed(attention, known)
        rows = torch.cat([known, tentative[:, None]], 1)
        read = _attention(self.in_query(states), self.in_key(rows + self.places))
        context = _weighed(read, self.in_value(rows))
        return Composition(attention, tentative, self.internal(torch.cat([context, states], -1)))


def _attention(query: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
    """[n, d], [n, K, d] -> [n, K]"""
    scores = (keys @ query[:, :, None]).squeeze(-1) / math.sqrt(query.shape[-1])
    return scores.softmax(-1)


def _weighed(weights: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """[n, K], [n, K, d] -> [n, d]"""
    return (weights[:, None] @ values).squeeze(1)


def encoded_places(count: int, size: int) -> torch.Tensor:
    """Sines and cosines of the places 0, 1, … (Vaswani et al., 2017). [count, size]"""
    column = torch.arange(size)
    angles = torch.arange(count)[:, None] / 10_000 ** (2 * (column // 2) / size)
    return torch.where(column % 2 == 0, angles.sin(), angles.cos())
