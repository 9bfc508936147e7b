"""The networks in torch: a centre net over the whole image, and a small one that refines the pose of one part."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bracket_cell.learned.parts.maps import FURTHER, PLANES
from bracket_lab.learned.training.pretrained import GREY, PYRAMID, SPREAD, efficient_body

LYING = 9  # x axis and y axis in the crop's frame, and its middle along, across and up in centimetres
CORRECTIONS = 3  # along and across in centimetres, heading in radians


def _of_crops(widths: tuple[int, int, int]) -> nn.Sequential:
    """What the networks that look at a crop see of it."""
    first, second, third = widths
    return nn.Sequential(
        _conv(PLANES, first, 2),
        _conv(first, second, 2),
        _conv(second, second),
        _conv(second, third, 2),
        _conv(third, third // 2, size=1),
        nn.Flatten(),
    )


def _conv(inside: int, out: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    convolution = nn.Conv2d(inside, out, size, stride, size // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(out), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _conv(width, width)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width))

    def forward(self, seen: Tensor) -> Tensor:
        """(B, width, h, w) to the same."""
        answer: Tensor = torch.relu(seen + self.second(self.first(seen)))
        return answer


class CentreNet(nn.Module):
    """Four halvings, a feature pyramid back to a quarter of the input, one head (Zhou, Objects as Points, 2019)."""

    def __init__(self, types: int, widths: tuple[int, int, int, int], features: int) -> None:
        super().__init__()
        first, second, third, fourth = widths
        self.quarter = nn.Sequential(_conv(3, first, 2), _conv(first, second, 2), _conv(second, second))
        self.eighth = nn.Sequential(_conv(second, third, 2), _Residual(third))
        self.sixteenth = nn.Sequential(_conv(third, fourth, 2), _Residual(fourth))
        self.lateral = nn.ModuleList(nn.Conv2d(width, features, 1) for width in (second, third, fourth))
        self.features = _conv(features, features)
        self.heat = nn.Conv2d(features, types + 1, 1)
        self.further = nn.Conv2d(features, FURTHER, 1)
        assert self.heat.bias is not None
        nn.init.constant_(self.heat.bias, -4.0)  # at first nothing is anywhere

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Image (B, 3, 240, 320) to heat logits (B, types + 1, 60, 80), further (B, FURTHER, ...), features."""
        quarter = self.quarter(image)
        eighth = self.eighth(quarter)
        sixteenth = self.sixteenth(eighth)
        up = self.lateral[2](sixteenth)
        for lateral, finer in ((self.lateral[1], eighth), (self.lateral[0], quarter)):
            up = nn.functional.interpolate(up, scale_factor=2.0, mode="nearest") + lateral(finer)
        features = self.features(up)
        return self.heat(features), self.further(features), features


class TaughtCentreNet(nn.Module):
    """The same answers by a backbone that knows everyday pictures: a few of one's own are enough for it."""

    def __init__(self, types: int, features: int) -> None:
        super().__init__()
        self.body = efficient_body("learning parts from few pictures")
        self.features = _conv(PYRAMID, features)
        self.heat = nn.Conv2d(features, types + 1, 1)
        self.further = nn.Conv2d(features, FURTHER, 1)
        assert self.heat.bias is not None
        nn.init.constant_(self.heat.bias, -4.0)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `CentreNet.forward`."""
        features = self.features(self.body((image + 0.5 - GREY) / SPREAD)["0"])
        return self.heat(features), self.further(features), features


class CentreAnswer(nn.Module):
    """A centre net whose heat maps are probabilities, for export."""

    def __init__(self, network: CentreNet | TaughtCentreNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `CentreNet.forward`."""
        heat, further, features = self.network(image)
        return torch.sigmoid(heat), further, features


class StackNet(nn.Module):
    """How a part lies that is seen in a crop, whether it lies on another, and whether another lies on it."""

    def __init__(self, types: int, widths: tuple[int, int, int], hidden: int = 96) -> None:
        super().__init__()
        self.seen = _of_crops(widths)
        self.hidden = nn.Sequential(nn.LazyLinear(hidden), nn.ReLU(inplace=True))
        self.lies = nn.Linear(hidden, types * LYING)
        self.stacked = nn.Linear(hidden, 2)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor]:
        """Crops (n, PLANES, 64, 64) to how parts lie (n, types, LYING), and logits (n, 2) of on top and carrying."""
        return self.tell(self.seen(crops))

    def tell(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Both, of what the convolutions see."""
        hidden = self.hidden(seen)
        return self.lies(hidden).reshape(len(seen), -1, LYING), self.stacked(hidden)


class PoseNet(nn.Module):
    """How far a part is off the middle of its crop, and of which type it is."""

    def __init__(self, types: int, widths: tuple[int, int, int], hidden: int) -> None:
        super().__init__()
        self.seen = _of_crops(widths)
        self.hidden = nn.Sequential(nn.LazyLinear(hidden), nn.ReLU(inplace=True))
        self.corrections = nn.Linear(hidden, types * CORRECTIONS)
        self.kinds = nn.Linear(hidden, types + 1)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor]:
        """Crops (n, PLANES, 48, 72) to corrections (n, types, CORRECTIONS) and logits of upright types, then none."""
        return self.tell(self.seen(crops))

    def tell(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Corrections and logits, of what the convolutions see."""
        hidden = self.hidden(seen)
        return self.corrections(hidden).reshape(len(seen), -1, CORRECTIONS), self.kinds(hidden)
