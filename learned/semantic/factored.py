"""The factored semantic planner in torch: goal head over (object, position) edges, slot table, slot order."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from pydantic import Field
from torch import Tensor, nn

from cell.interfaces.model import Model
from learned.semantic.graph import Layout
from learned.semantic.scenarios import DETECTION_ERROR

SHARPNESS = 5.0  # scale of the slot table's parameters: one rate suits them and the rest, and slots become certain


class FactoredSettings(Model):
    """Settings of training.

    Attributes:
        noise: share of the placements that are misdetected while training.
        unknown: share of states that belong to no demonstrated goal.
        habit_decay: penalty on squared evidence beyond what the slot table says (ordering habits need it to be low).
    """

    steps: int = Field(default=400, gt=0)
    learning_rate: float = Field(default=0.05, gt=0)
    noise: float = Field(default=DETECTION_ERROR, ge=0, lt=1)
    unknown: float = Field(default=0.05, ge=0, lt=1)
    habit_decay: float = Field(default=0.01, ge=0)


class FactoredAnswer(NamedTuple):
    """Outputs of the exported network: belief (z + 1,), wanted (z, n, m) and next type (z, n) by goal."""

    belief: Tensor
    wanted: Tensor
    following: Tensor


class FactoredNetwork(nn.Module):
    """Goals as independent slots: what plans say about a slot is evidence for the goal wherever it is seen.

    The slot table T[g, o, p] is the probability that goal g wants o at p. The goal head is linear in the edges;
    its weights are log((1 - e) T + e / nm) for a learned error rate e, plus a penalised rest that learns what a
    table cannot know, such as the order in which people work. One more row stands for "none of these" and starts
    from the quantities alone. The next slot is a softmax over the open slots.
    """

    def __init__(self, layout: Layout) -> None:
        super().__init__()
        goals, positions = layout.types.shape
        parts = len(layout.parts)
        self.pairs = parts * positions
        share = torch.tensor(layout.quantities / layout.quantities.sum(), dtype=torch.float32)
        self.register_buffer("share", share[:, None].expand(parts, positions).clone())
        self.table = nn.Parameter(torch.zeros(goals, parts, positions))
        self.rest = nn.Parameter(torch.zeros(goals + 1, parts, positions))
        self.bias = nn.Parameter(torch.zeros(goals + 1))
        self.error = nn.Parameter(torch.tensor(math.log(DETECTION_ERROR / (1.0 - DETECTION_ERROR))))
        self.order = nn.Parameter(torch.zeros(goals, positions))

    def log_table(self) -> Tensor:
        """Logarithm of the slot table T (z, n, m)."""
        return (SHARPNESS * self.table).log_softmax(dim=1)

    def goal_logits(self, edges: Tensor) -> Tensor:
        """Edges (B, n, m) to logits (B, z + 1), the last for "none of these"."""
        error = torch.sigmoid(self.error)
        known = torch.cat([self.log_table().exp(), self.get_buffer("share")[None]])
        weights = torch.log((1.0 - error) * known + error / self.pairs) + self.rest
        return edges.flatten(1) @ weights.flatten(1).T + self.bias

    def next_slot(self, edges: Tensor) -> Tensor:
        """Edges (B, n, m) to the probabilities (B, z, m) of the slot that is filled next."""
        still = 1.0 - edges.sum(dim=1, keepdim=True).clamp(max=1.0)
        scores = torch.exp(self.order) * still
        return scores / scores.sum(dim=2, keepdim=True).clamp(min=1e-6)

    def forward(self, edges: Tensor) -> FactoredAnswer:
        """One graph, edges (n, m)."""
        wanted = self.log_table().exp()
        slots = self.next_slot(edges[None])[0]
        following = torch.einsum("gop,gp->go", wanted, slots)
        return FactoredAnswer(self.goal_logits(edges[None])[0].softmax(dim=0), wanted, following)
