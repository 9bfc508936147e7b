"""The network that looks at each hand once more, in a close-up: how large it really is, and where. Imports torch."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from bracket_cell.learned.hands.refinement import REFINED
from bracket_lab.learned.hands.network import PAIRS, attended, conv, log_distances, normalised, soft_argmax

USUAL_RATIO, USUAL_ERROR = 0.1, 0.01  # of the logarithm of the size
WIDTHS, FINE, HIDDEN = (32, 72, 120, 168), 72, 128


class Refined(NamedTuple):
    """The refiner's answer about n close-ups.

    Attributes:
        points: (n, 7, 2) shares of the close-up, of REFINED.
        log_ratio: (n,) logarithm of how much larger the hand is than was thought.
        error: (n,) how wrong that is, on average.
    """

    points: Tensor
    log_ratio: Tensor
    error: Tensor


class Maps(NamedTuple):
    """What the convolutions see of n close-ups: detail (n, 6, 12, 12), coarse (n, 16, 6, 6), the mean (n, 168) of the
    deepest, fine (n, 72, 24, 24), and the heatmaps (n, 7, 24, 24)."""

    detail: Tensor
    coarse: Tensor
    mean: Tensor
    fine: Tensor
    heat: Tensor


class Refiner(nn.Module):
    """Size and points of one hand, from a close-up (n, 3, 96, 96) and where in the image that is (n, 2)."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third, fourth = WIDTHS
        self.stem = nn.Sequential(conv(3, first, 2), conv(first, second, 2), conv(second, second))  # 24 x 24
        self.middle = nn.Sequential(conv(second, third, 2), conv(third, third))  # 12 x 12
        self.deep = nn.Sequential(conv(third, fourth, 2), conv(fourth, fourth))  # 6 x 6
        ways = (nn.Conv2d(width, FINE, 1) for width in (fourth, third, second))
        self.from_deep, self.from_middle, self.from_stem = ways
        self.mix = conv(FINE, FINE)
        self.fine = conv(FINE, FINE)
        self.heat = nn.Conv2d(FINE, len(REFINED), 1)
        self.coarse = nn.Conv2d(fourth, 16, 1)
        self.detail = nn.Conv2d(third, 6, 1)
        seen = fourth + 16 * 6**2 + 6 * 12**2 + FINE * len(REFINED) + 2 * len(REFINED) + PAIRS.shape[1] + 2
        self.size = nn.Sequential(nn.Linear(seen, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 2))

    def maps(self, closeup: Tensor) -> Maps:
        """What is seen."""
        stem = self.stem(normalised(closeup))
        middle = self.middle(stem)
        deep = self.deep(middle)
        up = self.mix(self.from_middle(middle) + F.interpolate(self.from_deep(deep), scale_factor=2.0))
        fine = self.fine(self.from_stem(stem) + F.interpolate(up, scale_factor=2.0))
        return Maps(self.detail(middle), self.coarse(deep), deep.mean(dim=(2, 3)), fine, self.heat(fine))

    def tell(self, maps: Maps, place: Tensor) -> Refined:
        """What the maps say."""
        points = soft_argmax(maps.heat)
        where = [F.relu(maps.coarse).flatten(1), F.relu(maps.detail).flatten(1), points.flatten(1)]
        seen = [maps.mean, *where, log_distances(points), attended(maps.heat, maps.fine), place]
        size = self.size(torch.cat(seen, dim=1))
        error = USUAL_ERROR * torch.exp(size[:, 1].clamp(-2.5, 4.0))
        return Refined(points, USUAL_RATIO * size[:, 0], error)

    def forward(self, closeup: Tensor, place: Tensor) -> Refined:
        return self.tell(self.maps(closeup), place)
