"""The pairwise blocker network in torch: one logit for "the neighbour blocks the required part"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.candidates import CANDIDATES, as_headed, available
from bracket_cell.learned.grasp.pairs import PAIR_FEATURES, near_pairs, pair_features
from bracket_cell.learned.grasp.settings import GripperOutline
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.scenes import Scene


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
    """All parts of many scenes with their candidates and neighbours, padded to the largest scene (n parts).

    Attributes:
        features: (parts, candidates, n, PAIR_FEATURES).
        blocks: (parts, candidates, n) 1 where the neighbour blocks the candidate.
        present: (parts, candidates, n) 1 where there are such a candidate and such a neighbour within reach.
    """

    features: Tensor
    blocks: Tensor
    present: Tensor

    def __len__(self) -> int:
        return len(self.features)

    def loss(self, net: PairNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of every pair, and of the noisy-or over a candidate's neighbours; summed over the members."""
        logits = net.each(self.features[chosen])
        blocks, present = self.blocks[chosen], self.present[chosen]
        pairs = nn.functional.binary_cross_entropy_with_logits(logits, blocks.expand_as(logits), reduction="none")
        free = (nn.functional.logsigmoid(-logits) * present).sum(-1)
        blocked = (blocks * present).amax(-1).expand_as(free)
        # log(1 - exp(free)) without loss of precision; the bound keeps it finite where nothing is near.
        log_blocked = torch.log(-torch.expm1(free.clamp(max=-1e-6)))
        candidates = -(blocked * log_blocked + (1 - blocked) * free) * present.amax(-1)
        each = (pairs * present).sum((1, 2, 3)).sum() / present.sum()
        return each + candidates.sum() / present.amax(-1).sum()


def pair_data(scenes: Sequence[Scene], product: Product) -> PairData:
    """Features from the detections, labels from the truth."""
    widest = max(len(scene.boxes) for scene in scenes)
    shape = (sum(len(scene.boxes) for scene in scenes), len(CANDIDATES), widest)
    features = np.zeros((*shape, PAIR_FEATURES), dtype=np.float32)
    blocks, present = np.zeros((2, *shape), dtype=np.float32)
    first = 0
    for scene in scenes:
        boxes = boxes_of(scene.parts, product)
        pairs = near_pairs(boxes, available(boxes, GripperOutline()))
        places = first + pairs.part, pairs.candidate, pairs.neighbour
        features[places] = pair_features(boxes, pairs, product, scene.noise)
        truth = as_headed(scene.blocks, scene.boxes, boxes)
        blocks[places] = truth[pairs.part, pairs.candidate, pairs.neighbour]
        present[places] = 1.0
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
