"""One preallocated block of low-level experience, B lanes by T steps."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

TARGET = 0
"""The guide number of the policy that is learning; sources are 1, 2, …"""


@dataclass
class RolloutBuffer:
    """Low-level samples (s, a, r_intra) of T steps of B lanes, with the decision that each belongs to.

    No return crosses the end of a decision. An end is terminal, but for a decision that only the horizon
    cut off: what would have come of it is worth V of the state that the episode ended in (Pardo et al.,
    2018).

    Attributes:
        observations: [T, B, D]
        actions: [T, B, ...]
        log_probs: Of the acting policy. [T, B]
        rewards: Intrinsic. [T, B]
        ends: The decision ended with this step. [T, B]
        reached: The decision ended with this step by reaching its subgoal. [T, B]
        cut: The decision ended with this step for no other reason than the horizon. [T, B]
        terminated: The episode came to its end with this step. [T, B]
        truncated: The episode ended unsolved with this step, at the horizon. [T, B]
        guides: Who acted: TARGET or a source's number. [T, B]
        final_observations: Where a decision ended with this step: what followed it, under the same decision
            and in the same episode. [T, B, D]
        last_observations: After the last step, under the decision then running. [B, D]
    """

    observations: NDArray[np.float32]
    actions: NDArray[Any]
    log_probs: NDArray[np.float32]
    rewards: NDArray[np.float32]
    ends: NDArray[np.bool_]
    reached: NDArray[np.bool_]
    cut: NDArray[np.bool_]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    guides: NDArray[np.intp]
    final_observations: NDArray[np.float32]
    last_observations: NDArray[np.float32]

    @classmethod
    def empty(
        cls,
        steps: int,
        num_envs: int,
        observation_size: int,
        action_shape: tuple[int, ...] = (),
        action_dtype: type[np.generic] = np.int64,
    ) -> "RolloutBuffer":
        shape = (steps, num_envs)
        return cls(
            observations=np.zeros((*shape, observation_size), np.float32),
            actions=np.zeros((*shape, *action_shape), action_dtype),
            log_probs=np.zeros(shape, np.float32),
            rewards=np.zeros(shape, np.float32),
            ends=np.zeros(shape, np.bool_),
            reached=np.zeros(shape, np.bool_),
            cut=np.zeros(shape, np.bool_),
            terminated=np.zeros(shape, np.bool_),
            truncated=np.zeros(shape, np.bool_),
            guides=np.zeros(shape, np.intp),
            final_observations=np.zeros((*shape, observation_size), np.float32),
            last_observations=np.zeros((num_envs, observation_size), np.float32),
        )

    @property
    def done(self) -> NDArray[np.bool_]:
        """The episode ended with this step. [T, B]"""
        return self.terminated | self.truncated

    def following(self) -> NDArray[np.float32]:
        """What followed each step, under the same decision and in the same episode. [T, B, D]"""
        after = np.concatenate([self.observations[1:], self.last_observations[None]])
        return np.where(self.ends[:, :, None], self.final_observations, after)

    def of_reached_decisions(self) -> NDArray[np.bool_]:
        """Which samples belong to a decision that is known to have reached its subgoal. [T, B]"""
        member = np.zeros_like(self.reached)
        following = np.zeros_like(self.reached[0])
        for t in reversed(range(len(member))):
            following = np.where(self.ends[t], self.reached[t], following)
            member[t] = following
        return member


def generalised_advantages(
    rewards: torch.Tensor,
    values: torch.Tensor,
    last_values: torch.Tensor,
    ends: torch.Tensor,
    discount: float,
    trace_decay: float,
) -> torch.Tensor:
    """GAE(λ) of Schulman et al. (2016), where an end is terminal.

    Args:
        rewards: [T, B]
        values: V(s_t). [T, B]
        last_values: V(s_T), used where the last decision is still running. [B]
        ends: 1 where a decision ended with the step, else 0. [T, B]
        discount: γ
        trace_decay: λ

    Returns:
        Advantages. [T, B]
    """
    advantages = torch.zeros_like(rewards)
    running = torch.zeros_like(last_values)
    next_values = last_values
    for t in reversed(range(len(rewards))):
        going_on = 1.0 - ends[t]
        error = rewards[t] + discount * next_values * going_on - values[t]
        running = error + discount * trace_decay * going_on * running
        advantages[t] = running
        next_values = values[t]
    return advantages
