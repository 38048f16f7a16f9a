"""The paper's networks: three fully connected layers of 400 ReLU units (Table 1)."""

import math

import torch
from torch import nn

HIDDEN = (400, 400, 400)


def mlp(
    inputs: int, outputs: int, *, hidden: tuple[int, ...] = HIDDEN, output_gain: float = 1.0
) -> nn.Sequential:
    """A ReLU network with orthogonal weights and zero biases.

    Args:
        inputs: Size of an observation.
        outputs: Size of the output.
        hidden: Units of each hidden layer.
        output_gain: Scale of the last layer's weights; small for a policy that starts uniform.
    """
    layers: list[nn.Module] = []
    for size in hidden:
        layers += [_linear(inputs, size, math.sqrt(2.0)), nn.ReLU(inplace=True)]
        inputs = size
    return nn.Sequential(*layers, _linear(inputs, outputs, output_gain))


def _linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


def gradient_step(
    optimiser: torch.optim.Optimizer, loss: torch.Tensor, max_norm: float | None = None
) -> None:
    """One descent step on `loss`, its gradient's norm cut to `max_norm`."""
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    if max_norm is not None:
        parameters = [p for group in optimiser.param_groups for p in group["params"]]
        nn.utils.clip_grad_norm_(parameters, max_norm)
    optimiser.step()
