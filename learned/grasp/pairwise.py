"""The pairwise blocker network in torch: one logit for "the neighbour blocks the required part"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from cell.interfaces.product import Product
from learned.grasp.geometry import boxes_of
from learned.grasp.pairs import PAIR_FEATURES, near_pairs, pair_features
from learned.grasp.scenes import Scene


class PairNet(nn.Module):
    """A small committee of perceptrons over the features of one pair; their logits are averaged."""

    def __init__(self, hidden: int, members: int) -> None:
        super().__init__()
        self.members = nn.ModuleList(_perceptron(hidden) for _ in range(members))

    def forward(self, pairs: Tensor) -> Tensor:
        """Logits (...) of features (..., PAIR_FEATURES)."""
        return self.each(pairs).mean(0)

    def each(self, pairs: Tensor) -> Tensor:
        """Logits (members, ...) of every member."""
        return torch.stack([member(pairs).squeeze(-1) for member in self.members])


@dataclass(frozen=True)
class PairData:
    """All parts of many scenes with their neighbours, padded to the largest number of neighbours k.

    Attributes:
        features: (parts, k, PAIR_FEATURES).
        blocks: (parts, k) 1 where the neighbour blocks the part.
        present: (parts, k) 1 where there is a neighbour.
    """

    features: Tensor
    blocks: Tensor
    present: Tensor

    def __len__(self) -> int:
        return len(self.features)

    def loss(self, net: PairNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of every pair, and of the noisy-or over a part's neighbours; summed over the members."""
        logits = net.each(self.features[chosen])
        blocks, present = self.blocks[chosen], self.present[chosen]
        pairs = nn.functional.binary_cross_entropy_with_logits(logits, blocks.expand_as(logits), reduction="none")
        free = (nn.functional.logsigmoid(-logits) * present).sum(-1)
        blocked = (blocks * present).amax(-1).expand_as(free)
        # log(1 - exp(free)) without loss of precision; the bound keeps it finite where nothing is near.
        log_blocked = torch.log(-torch.expm1(free.clamp(max=-1e-6)))
        parts = -(blocked * log_blocked + (1 - blocked) * free)
        return (pairs * present).sum((1, 2)).sum() / present.sum() + parts.mean(1).sum()


def pair_data(scenes: Sequence[Scene], product: Product) -> PairData:
    """Features from the detections, labels from the truth."""
    widest = max(len(scene.boxes) for scene in scenes) - 1
    count = sum(len(scene.boxes) for scene in scenes)
    features = np.zeros((count, widest, PAIR_FEATURES), dtype=np.float32)
    blocks, present = np.zeros((2, count, widest), dtype=np.float32)
    first = 0
    for scene in scenes:
        boxes = boxes_of(scene.parts, product)
        required, neighbour = near_pairs(boxes)
        slot = np.array([np.count_nonzero(required[:k] == required[k]) for k in range(len(required))], dtype=np.intp)
        features[first + required, slot] = pair_features(boxes, required, neighbour)
        blocks[first + required, slot] = scene.blocks[required, neighbour]
        present[first + required, slot] = 1.0
        first += len(boxes)
    return PairData(torch.from_numpy(features), torch.from_numpy(blocks), torch.from_numpy(present))


def _perceptron(hidden: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(PAIR_FEATURES, hidden),
        nn.SiLU(),
        nn.Linear(hidden, hidden),
        nn.SiLU(),
        nn.Linear(hidden, 1),
    )
