"""Two networks of the small tracker: the finder sees the whole image, the reader one hand. Imports torch."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from bracket_cell.learned.hands.regions import CELL_PX, FINDER_PX, POINTS, REGION_PX

HEAT_PX = REGION_PX // 4
FACTS = 13  # numbers about one hand, beside what it holds
USUAL_HEIGHT_ERROR_M, USUAL_LOG_ANGLE, USUAL_ANGLE_ERROR = 0.02, -3.0, 0.02
LEAST_CONTRAST = 0.04  # of an image that is normalised
HIDDEN = 192  # of the layer from which facts are read
PAIRS = torch.triu_indices(len(POINTS) - 1, len(POINTS) - 1, 1)  # of points without what is held
LEAST_DISTANCE = 0.02  # of a region
PLACES = 2 * len(POINTS) + PAIRS.shape[1] + 2  # numbers: points, distances, place of the region


class Found(NamedTuple):
    """The finder's answer: (n, 1, rows, columns) score of a hand, and (n, 2, ...) its centre within the cell."""

    score: Tensor
    offset: Tensor


class Read(NamedTuple):
    """The reader's answer about n regions; shares are of the region, 0 to 1.

    Attributes:
        present, left, acting: (n,) probabilities.
        points: (n, 8, 2) shares, of POINTS.
        box: (n, 4) shares: left, top, right, bottom.
        heights_m: (n, 2) of palm and pinch over the table, by what is around the hand.
        height_errors_m: (n, 2) how wrong these are, on average.
        log_angle: (n,) logarithm of the angle [rad] under which the camera sees the length from palm to wrist, or
            would if it lay across the view: apparent size.
        angle_error: (n,) how wrong that is, on average.
        held: (n, 1 + types) probabilities: nothing, then the types of parts.
    """

    present: Tensor
    left: Tensor
    acting: Tensor
    points: Tensor
    box: Tensor
    heights_m: Tensor
    height_errors_m: Tensor
    log_angle: Tensor
    angle_error: Tensor
    held: Tensor


class Finder(nn.Module):
    """Hands in the whole image, a cell of 8 pixels at a time (heatmap and offset as in CenterNet, Zhou 2019)."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            conv(3, 16, 2), conv(16, 32, 2), conv(32, 64, 2), conv(64, 64), conv(64, 64, dilation=2), conv(64, 64)
        )
        self.head = nn.Conv2d(64, 3, 1)
        nn.init.constant_(self.head.bias, -3.0)  # type: ignore[arg-type]

    def logits(self, image: Tensor) -> Tensor:
        """(n, 3, 120, 160) -> (n, 3, 15, 20): score before the sigmoid, and two offsets before theirs."""
        answer: Tensor = self.head(self.body(normalised(image)))
        return answer

    def forward(self, image: Tensor) -> Found:
        answer = torch.sigmoid(self.logits(image))
        return Found(answer[:, :1], answer[:, 1:])


class Reader(nn.Module):
    """Points, box, heights and kind of one hand, from a region around it and what surrounds that.

    Args:
        types: of parts.
    """

    def __init__(self, types: int) -> None:
        super().__init__()
        self.stem = nn.Sequential(conv(3, 24, 2), conv(24, 48, 2), conv(48, 48))  # 32 x 32
        self.middle = nn.Sequential(conv(48, 96, 2), conv(96, 96))  # 16 x 16
        self.deep = nn.Sequential(conv(96, 128, 2), conv(128, 128))  # 8 x 8
        self.from_deep, self.from_middle, self.from_stem = (nn.Conv2d(size, 48, 1) for size in (128, 96, 48))
        self.mix = conv(48, 48)
        self.fine = conv(48, 48)
        self.heat = nn.Conv2d(48, len(POINTS), 1)
        self.whole = nn.Conv2d(128, 12, 1)  # of the region, and where in it
        self.around = nn.Sequential(
            conv(3, 16, 2), conv(16, 32, 2), conv(32, 48, 2), conv(48, 64, 2), nn.Conv2d(64, 16, 1)
        )  # 6 x 6
        self.facts = nn.Sequential(
            nn.Linear(128 + 48 + 12 * 8**2 + 16 * 6**2 + PLACES + 48 * len(POINTS), HIDDEN),
            nn.ReLU(),
            nn.Linear(HIDDEN, FACTS + 1 + types),
        )

    def maps(self, region: Tensor, around: Tensor) -> tuple[Tensor, ...]:
        """What is seen, coarse (n, 128, 8, 8) and fine (n, 48, 32, 32), the heatmaps (n, 8, 32, 32), and what is
        around (n, 16, 6, 6)."""
        stem = self.stem(normalised(region))
        middle = self.middle(stem)
        deep = self.deep(middle)
        up = self.mix(self.from_middle(middle) + F.interpolate(self.from_deep(deep), scale_factor=2.0))
        fine = self.fine(self.from_stem(stem) + F.interpolate(up, scale_factor=2.0))
        return deep, fine, self.heat(fine), self.around(normalised(around))

    def tell(self, deep: Tensor, fine: Tensor, heat: Tensor, around: Tensor, place: Tensor) -> tuple[Tensor, Tensor]:
        """Points (n, 8, 2) and facts (n, FACTS + 1 + types) as they come, of the maps."""
        points = soft_argmax(heat)
        seen = [deep.mean(dim=(2, 3)), fine.mean(dim=(2, 3)), attended(heat, fine)]
        where = [F.relu(self.whole(deep)).flatten(1), F.relu(around).flatten(1)]
        facts = self.facts(torch.cat([*seen, *where, points.flatten(1), log_distances(points), place], dim=1))
        return points, facts

    def forward(self, region: Tensor, around: Tensor, place: Tensor) -> Read:
        deep, fine, heat, surroundings = self.maps(region, around)
        points, facts = self.tell(deep, fine, heat, surroundings, place)
        facts_of = split_facts(facts)
        likely = torch.sigmoid(facts_of.likely)
        return Read(
            likely[:, 0],
            likely[:, 1],
            likely[:, 2],
            points,
            facts_of.box,
            facts_of.heights_m,
            facts_of.height_errors_m,
            facts_of.log_angle,
            facts_of.angle_error,
            torch.softmax(facts_of.held, dim=1),
        )


class Facts(NamedTuple):
    """What the last layer tells, in units: `likely` (present, left, acting) and `held` are logits."""

    likely: Tensor
    box: Tensor
    heights_m: Tensor
    height_errors_m: Tensor
    log_angle: Tensor
    angle_error: Tensor
    held: Tensor


def split_facts(facts: Tensor) -> Facts:
    """Facts of the numbers (n, FACTS + 1 + types) that the last layer gives."""
    errors = torch.exp(facts[:, 9:12].clamp(-3.0, 2.0))
    return Facts(
        facts[:, :3],
        facts[:, 3:7] + facts.new_tensor([0.2, 0.1, 0.8, 0.9]),
        0.1 + 0.1 * facts[:, 7:9],
        USUAL_HEIGHT_ERROR_M * errors[:, :2],
        USUAL_LOG_ANGLE + 0.2 * facts[:, 12],
        USUAL_ANGLE_ERROR * errors[:, 2],
        facts[:, FACTS:],
    )


def attended(heat: Tensor, features: Tensor) -> Tensor:
    """(n, k c) features (n, c, s, s) at the places of each heatmap (n, k, s, s): there one sees what is held."""
    weights = torch.softmax(heat.flatten(2), dim=2)
    return torch.bmm(weights, features.flatten(2).transpose(1, 2)).flatten(1)


def log_distances(points: Tensor) -> Tensor:
    """(n, pairs) logarithms of the distances between points (n, k, 2) that every hand has: how large it looks."""
    one, other = points[:, PAIRS[0]], points[:, PAIRS[1]]
    return (one - other).square().sum(dim=2).add(LEAST_DISTANCE**2).log() / 2


def soft_argmax(heat: Tensor) -> Tensor:
    """The mean place of each heatmap (n, k, s, s) as shares (n, k, 2) of (column, row)."""
    side = heat.shape[-1]
    weights = torch.softmax(heat.flatten(2), dim=2).view(*heat.shape)
    middles = (torch.arange(side, dtype=heat.dtype, device=heat.device) + 0.5) / side
    return torch.stack([(weights.sum(dim=2) * middles).sum(dim=2), (weights.sum(dim=3) * middles).sum(dim=2)], dim=2)


def normalised(image: Tensor) -> Tensor:
    """Each channel about its mean, all of them by one contrast: exposure and white balance leave it alone."""
    centred = image - image.mean(dim=(2, 3), keepdim=True)
    contrast = centred.pow(2).mean(dim=(1, 2, 3), keepdim=True).sqrt()
    return centred / (contrast + LEAST_CONTRAST)


def conv(inside: int, outside: int, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    """3 x 3, normalised over the batch, then what is negative becomes 0."""
    convolution = nn.Conv2d(inside, outside, 3, stride, padding=dilation, dilation=dilation, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outside), nn.ReLU())


FINDER_CELLS = (FINDER_PX[1] // CELL_PX, FINDER_PX[0] // CELL_PX)  # (rows, columns)
