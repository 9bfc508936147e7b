"""The network that reads holes, in torch."""

from __future__ import annotations

import torch
from torch import Tensor, nn


def _conv(inside: int, out: int, stride: int) -> nn.Sequential:
    convolution = nn.Conv2d(inside, out, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(out), nn.ReLU(inplace=True))


class HoleNet(nn.Module):
    """Crops of holes to what is in them, whether it is upright, and whether something covers it."""

    def __init__(self, types: int, widths: tuple[int, int, int], hidden: int) -> None:
        super().__init__()
        first, second, third = widths
        self.seen = nn.Sequential(
            _conv(3, first, 2),
            _conv(first, second, 2),
            _conv(second, second, 1),
            _conv(second, third, 2),
            _conv(third, third // 2, 1),
            nn.Flatten(),
        )
        self.hidden = nn.Sequential(nn.LazyLinear(hidden), nn.ReLU(inplace=True), nn.Dropout(0.2))
        self.kinds = nn.Linear(hidden, types + 1)
        self.others = nn.Linear(hidden, 2)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Crops (n, 3, 48, 48) to logits: empty and types (n, types + 1), upright (n,), covered (n,)."""
        hidden = self.hidden(self.seen(crops))
        others = self.others(hidden)
        return self.kinds(hidden), others[:, 0], others[:, 1]


class HoleAnswer(nn.Module):
    """A network whose answers are probabilities, for export.

    Args:
        temperature: by which logits of kinds are divided (Guo, On Calibration of Modern Neural Networks, 2017).
    """

    def __init__(self, network: HoleNet, temperature: float) -> None:
        super().__init__()
        self.network, self.temperature = network, temperature

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `HoleNet.forward`, as probabilities."""
        kinds, upright, covered = self.network(crops)
        return torch.softmax(kinds / self.temperature, dim=1), torch.sigmoid(upright), torch.sigmoid(covered)
