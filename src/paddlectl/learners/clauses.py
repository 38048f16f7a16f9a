"""Differentiable deduction over a complete clause set, and its Monte-Carlo policy gradient (Eq. 1)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from paddlectl.learners.networks import gradient_step
from paddlectl.logic.atoms import Atom, Literal
from paddlectl.logic.clauses import Body
from paddlectl.ranges import NotNegative, Positive, PositiveShare, Share


@dataclass(frozen=True)
class ClauseSettings:
    """Table 1's values for the high level where it has them.

    Attributes:
        learning_rate: Of RMSProp.
        discount: γ_h per decision.
        step_discount: And per environment step, in planned returns: about what a step costs of a score
            of 1 - 0.9 t / T. Without it a guide that takes twice the time is worth as much.
        entropy_coef: Weight of the entropy of a scene's head distribution (Eq. 1's last term). A larger one
            leaves a head that wastes a single step a share of its scene.
        initial_deviation: Of the normal distribution that the clause weights are drawn from.
        baseline_step: Smallest step of the running mean return of a scene.
    """

    learning_rate: Positive = 0.05
    discount: Share = 0.95
    step_discount: Share = 0.997
    entropy_coef: NotNegative = 0.005
    initial_deviation: NotNegative = 0.1
    baseline_step: PositiveShare = 0.02

    def discounts(self, steps: NDArray[np.intp]) -> NDArray[np.float64]:
        """γ of decisions that took `steps` steps. [n]"""
        return np.asarray(self.discount * self.step_discount**steps, np.float64)


class ClauseLearner:
    """One weight for each clause of the complete set, S scenes by H heads.

    Attributes:
        atoms: The vocabulary. [P]
        bodies: The scenes. [S]
        heads: [H]
        weights: Clause weights. [S, H]
    """

    def __init__(
        self,
        atoms: Sequence[Atom],
        bodies: Sequence[Body],
        heads: Sequence[Atom],
        seed: int,
        settings: ClauseSettings | None = None,
    ) -> None:
        self.atoms = tuple(atoms)
        self.bodies = tuple(bodies)
        self.heads = tuple(heads)
        self.settings = settings or ClauseSettings()
        generator = torch.Generator().manual_seed(seed)
        self.weights = self.settings.initial_deviation * torch.randn(
            len(self.bodies), len(self.heads), generator=generator
        )
        self.weights.requires_grad_()
        self.baseline = torch.zeros(len(self.bodies))
        self._visits = torch.zeros(len(self.bodies))
        self._positive = torch.tensor([[Literal(a) in body for a in self.atoms] for body in self.bodies])
        self._scene_of = _scene_table(self._positive.numpy())
        self._optimiser = torch.optim.RMSprop([self.weights], lr=self.settings.learning_rate)

    def deduce(self, valuation: torch.Tensor) -> torch.Tensor:
        """One step of forward chaining with soft valuations.

        A clause's activation is the product of its literals' valuations (product t-norm); a head's
        valuation is the sum over its clauses of activation times softmax weight, normalised over
        heads. With a crisp valuation exactly one scene is active and this is `probabilities`.

        Args:
            valuation: Degree of truth of each atom, in [0, 1]. [B, P]

        Returns:
            Probabilities of the heads, differentiable in weights and valuation. [B, H]
        """
        literals = torch.where(self._positive, valuation[:, None, :], 1.0 - valuation[:, None, :])
        activation = literals.prod(-1)
        heads = activation @ self.weights.softmax(-1)
        return heads / heads.sum(-1, keepdim=True).clamp_min(1e-12)

    def scenes(self, valuation: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Index of the scene that each crisp valuation [B, P] activates; -1 if none does. [B]"""
        return self._scene_of[_codes(valuation)]

    @torch.no_grad()
    def probabilities(self) -> NDArray[np.float32]:
        """The closed form of `deduce` for a crisp encoder: each scene's softmax over heads. [S, H]"""
        probabilities: NDArray[np.float32] = self.weights.softmax(-1).numpy()
        return probabilities

    @torch.no_grad()
    def prefer(self, probabilities: NDArray[np.floating]) -> None:
        """Adds to the weights what makes these probabilities [S, H] of equal ones."""
        self.weights += torch.from_numpy(np.log(probabilities * len(self.heads)).astype(np.float32))

    def update(
        self,
        scenes: NDArray[np.intp],
        heads: NDArray[np.intp],
        returns: NDArray[np.float32],
        imitate: NDArray[np.bool_],
    ) -> None:
        """One step of Eq. 1 over the decisions of finished episodes.

        Args:
            scenes: Scene of each decision. [N]
            heads: Head taken. [N]
            returns: Discounted extrinsic return from it on. [N]
            imitate: Weight by the return itself, not by the advantage: a guided decision that
                reached its subgoal. A crisp guide always takes the same head, whose advantage
                is zero on average, so with the advantage nothing is learned from it. [N]
        """
        if not len(scenes):
            return
        scene, head, return_ = (torch.from_numpy(x) for x in (scenes, heads, returns))
        advantage = torch.where(torch.from_numpy(imitate), return_, return_ - self.baseline[scene])
        log_probs = self.weights.log_softmax(-1)
        chosen = log_probs[scene, head]
        entropy = -(log_probs.exp() * log_probs).sum(-1)[scene]
        loss = -(chosen * advantage).mean() - self.settings.entropy_coef * entropy.mean()
        gradient_step(self._optimiser, loss)
        self._update_baseline(scene, return_)

    def expected_update(
        self,
        advantages: NDArray[np.float64],
        imitation: NDArray[np.float64],
        visits: NDArray[np.float64],
        steps: int,
    ) -> None:
        """Steps of Eq. 1 in expectation over the heads, from advantages that are known for all of them.

        Args:
            advantages: Sum over a scene's decisions of each head's advantage there. [S, H]
            imitation: Sum of the returns of the decisions to imitate. [S, H]
            visits: Decisions made in each scene. [S]
            steps: Of gradient descent.
        """
        advantage, imitated, share = (
            torch.from_numpy((table / visits.sum()).astype(np.float32))
            for table in (advantages, imitation, visits)
        )
        for _ in range(steps):
            log_probs = self.weights.log_softmax(-1)
            policy = log_probs.exp()
            gain = (policy * advantage).sum() + (log_probs * imitated).sum()
            entropy = -(policy * log_probs).sum(-1)
            gradient_step(self._optimiser, -gain - self.settings.entropy_coef * (share * entropy).sum())

    def state(self) -> dict[str, torch.Tensor]:
        """The tensors by name."""
        return {"clauses.weights": self.weights.detach(), "clauses.baseline": self.baseline}

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Takes the tensors from `state`."""
        with torch.no_grad():
            self.weights.copy_(state["clauses.weights"])
            self.baseline.copy_(state["clauses.baseline"])

    def _update_baseline(self, scene: torch.Tensor, return_: torch.Tensor) -> None:
        count = torch.zeros_like(self._visits).index_add_(0, scene, torch.ones_like(return_))
        total = torch.zeros_like(self._visits).index_add_(0, scene, return_)
        self._visits += count
        seen = count > 0
        step = (count / self._visits.clamp_min(1.0)).clamp_min(self.settings.baseline_step)[seen]
        self.baseline[seen] += step * (total[seen] / count[seen] - self.baseline[seen])


def _codes(valuation: NDArray[np.bool_]) -> NDArray[np.intp]:
    powers = 1 << np.arange(valuation.shape[-1])[::-1]
    return valuation @ powers


def _scene_table(positive: NDArray[np.bool_]) -> NDArray[np.intp]:
    table = np.full(1 << positive.shape[1], -1, np.intp)
    table[_codes(positive)] = np.arange(len(positive))
    return table
