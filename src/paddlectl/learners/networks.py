"""The paper's networks: three fully connected layers of 400 ReLU units (Table 1)."""

import inspect
import math

import torch
from torch import nn
from torch.optim import Optimizer

# Optimisers load torch's compiler only to say that it is to leave them alone: a second, and 70 MB a process.
# These take themselves for what that would have given; gradient_step goes past the rest of it.
for _function in (
    Optimizer.add_param_group,
    Optimizer.zero_grad,
    Optimizer.state_dict,
    Optimizer.load_state_dict,
):
    _plain = inspect.unwrap(_function)
    _plain.__dynamo_disable = _plain

HIDDEN = (400, 400, 400)
_CODE_WEIGHT = 2.0  # beside the coordinates, which lie in [-1, 1]


def mlp(
    inputs: int,
    outputs: int,
    *,
    hidden: tuple[int, ...] = HIDDEN,
    output_gain: float = 1.0,
    normalised: bool = False,
) -> nn.Sequential:
    """A ReLU network with orthogonal weights and zero biases.

    Args:
        inputs: Size of an observation.
        outputs: Size of the output.
        hidden: Units of each hidden layer.
        output_gain: Scale of the last layer's weights; small for a policy that starts uniform.
        normalised: Each hidden layer is normalised before its ReLU (Ba, Kiros & Hinton, 2016).
    """
    layers: list[nn.Module] = []
    for size in hidden:
        layers += [_linear(inputs, size, math.sqrt(2.0))]
        layers += [nn.LayerNorm(size)] if normalised else []
        layers += [nn.ReLU(inplace=True)]
        inputs = size
    return nn.Sequential(*layers, _linear(inputs, outputs, output_gain))


class GoalFeatures(nn.Module):
    """An observation for a network: the offset to its goal, and a code of where it is and where it wants to.

    A point's code has a number for each point of a grid a unit apart around (0, 0): 1 on it, falling to 0 a
    unit away along either axis. Linear in the code is bilinear interpolation between the grid's points. From
    coordinates alone a network takes far longer to tell the two sides of a wall apart.

    Args:
        observation_size: D.
        goal_size: G numbers at either end of an observation: what is achieved, what is desired.
        grid: Points along each of the G axes; empty leaves observations as they are.

    Attributes:
        size: Numbers that come out.
    """

    def __init__(self, observation_size: int, goal_size: int, grid: tuple[int, ...]) -> None:
        super().__init__()
        self.goal_size = goal_size
        self.size = observation_size + (2 * math.prod(grid) + goal_size) * bool(grid)
        self._axes = [torch.arange(points) - (points - 1) / 2 for points in grid]
        self._extent = max(grid, default=2) / 2

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """[n, D] -> [n, size]"""
        if not self._axes:
            return observations
        g = self.goal_size
        achieved, rest, desired = observations[:, :g], observations[:, g:-g], observations[:, -g:]
        places = torch.cat([achieved, desired, desired - achieved], -1) / self._extent
        codes = _CODE_WEIGHT * torch.cat([self._code(achieved), self._code(desired)], -1)
        return torch.cat([rest, places, codes], -1)

    def _code(self, points: torch.Tensor) -> torch.Tensor:
        code = torch.ones(len(points), 1)
        for axis, places in enumerate(self._axes):
            near = (1.0 - (points[:, axis, None] - places).abs()).clamp_min(0.0)
            code = (code[:, :, None] * near[:, None, :]).flatten(1)
        return code


def _linear(inputs: int, outputs: int, gain: float) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


def gradient_step(optimiser: Optimizer, loss: torch.Tensor, max_norm: float | None = None) -> None:
    """One descent step on `loss`, its gradient's norm cut to `max_norm`."""
    optimiser.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    if max_norm is not None:
        parameters = [p for group in optimiser.param_groups for p in group["params"]]
        nn.utils.clip_grad_norm_(parameters, max_norm)
    with torch.no_grad():
        inspect.unwrap(type(optimiser).step)(optimiser)


def load_named(networks: nn.Module, state: dict[str, torch.Tensor]) -> None:
    """Takes the networks' tensors from `state`, which may hold others too.

    Raises:
        RuntimeError: If one is missing or has another shape.
    """
    own = networks.state_dict()
    networks.load_state_dict({name: value for name, value in state.items() if name in own})
