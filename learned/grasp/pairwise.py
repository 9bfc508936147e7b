"""The pairwise blocker network in torch: one logit for "the neighbour blocks the required part"."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from learned.grasp.pairs import PAIR_FEATURES


class PairNet(nn.Module):
    """A small committee of perceptrons over the features of one pair; their logits are averaged."""

    def __init__(self, hidden: int, members: int) -> None:
        super().__init__()
        self.members = nn.ModuleList(_perceptron(hidden) for _ in range(members))

    def forward(self, pairs: Tensor) -> Tensor:
        """Logits (p,) of features (p, PAIR_FEATURES)."""
        return torch.stack([member(pairs).squeeze(-1) for member in self.members]).mean(0)


def free_log_probability(logits: Tensor, owner: Tensor, count: int) -> Tensor:
    """Noisy-or: log probability (count,) that none of a part's neighbours blocks it.

    Args:
        logits: (p,) of pairs.
        owner: (p,) index of the required part of each pair.
    """
    return torch.zeros(count).index_add(0, owner, nn.functional.logsigmoid(-logits))


def _perceptron(hidden: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(PAIR_FEATURES, hidden),
        nn.SiLU(),
        nn.Linear(hidden, hidden),
        nn.SiLU(),
        nn.Linear(hidden, 1),
    )
