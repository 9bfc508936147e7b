"""The networks of action detectors. Imports torch.

`LstmFcn` after Karim et al. 2017 (LSTM Fully Convolutional Networks for Time Series Classification): the LSTM sees
time as its feature axis. All answer logits over the classes, and one of "the fingers have opened".
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from bracket_cell.learned.actions.segments import TRACK_FEATURES
from bracket_cell.learned.inference.exposure import LEVEL, MOST_GAIN

KINDS_N = 3
VGG16 = (64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0)  # channels; 0: pooling


class LstmFcn(nn.Module):
    """Track (n, features, frames) to features (n, width)."""

    def __init__(self, cells: int, channels: tuple[int, int, int], frames: int = 45, dropout: float = 0.8) -> None:
        super().__init__()
        self.lstm = nn.LSTM(frames, cells, batch_first=True)
        self.dropout = nn.Dropout(dropout)
        layers: list[nn.Module] = []
        for before, after, kernel in zip((TRACK_FEATURES, *channels[:2]), channels, (8, 5, 3), strict=True):
            convolution = nn.Conv1d(before, after, kernel)
            nn.init.kaiming_normal_(convolution.weight)
            same = nn.ConstantPad1d(((kernel - 1) // 2, kernel // 2), 0.0)
            layers += [same, convolution, nn.BatchNorm1d(after), nn.ReLU()]
        self.fcn = nn.Sequential(*layers)
        self.width = cells + channels[2]

    def forward(self, track: Tensor) -> Tensor:
        state = self.lstm(track)[0][:, -1]
        return torch.cat([self.dropout(state), self.fcn(track).mean(dim=2)], dim=1)


class SlimTrack(nn.Module):
    """As LstmFcn, smaller, and with the features of the last frame beside their mean: when matters as much as what."""

    def __init__(self, cells: int = 32, channels: tuple[int, int, int] = (64, 96, 64)) -> None:
        super().__init__()
        self.base = LstmFcn(cells, channels, dropout=0.3)
        self.width = self.base.width + channels[2]

    def forward(self, track: Tensor) -> Tensor:
        state = self.base.lstm(track)[0][:, -1]
        found = self.base.fcn(track)
        return torch.cat([self.base.dropout(state), found.mean(dim=2), found[:, :, -1]], dim=1)


class SmallCnn(nn.Module):
    """Crops (n, 3, 64, 64) to features (n, width)."""

    def __init__(self, channels: tuple[int, ...] = (16, 32, 64, 96)) -> None:
        super().__init__()
        sizes = zip((3, *channels), channels, strict=False)
        self.layers = nn.Sequential(
            *(nn.Sequential(nn.Conv2d(i, o, 3, stride=2, padding=1), nn.BatchNorm2d(o), nn.ReLU()) for i, o in sizes)
        )
        self.squeeze = nn.Conv2d(channels[-1], 12, 1)
        self.width = channels[-1] + 12 * 16

    def forward(self, crops: Tensor) -> Tensor:
        found = self.layers(crops)
        where = self.squeeze(found).flatten(1)
        return torch.cat([found.mean(dim=(2, 3)), where], dim=1)


class Vgg16(nn.Module):
    """The convolutions of VGG16 (with batch norm, as it is trained from scratch), averaged; `share` narrows them all.

    Args:
        share: of VGG16's channels; 1 for its own.
    """

    def __init__(self, share: float = 1.0) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 3
        for channels in VGG16:
            if channels == 0:
                layers.append(nn.MaxPool2d(2))
                continue
            width = max(8, round(channels * share))
            layers += [nn.Conv2d(before, width, 3, padding=1), nn.BatchNorm2d(width), nn.ReLU()]
            before = width
        self.layers = nn.Sequential(*layers)
        self.width = before

    def forward(self, crops: Tensor) -> Tensor:
        found: Tensor = self.layers(crops).mean(dim=(2, 3))
        return found


class Head(nn.Module):
    """Features to logits: of an assembly part and position add up, so that rare pairs learn from common ones."""

    def __init__(self, width: int, parts: int, positions: int, hidden: int = 128, dropout: float = 0.3) -> None:
        super().__init__()
        self.parts, self.positions = parts, positions
        self.layers = nn.Sequential(nn.Linear(width, hidden), nn.ReLU(), nn.Dropout(dropout))
        self.out = nn.Linear(hidden, 1 + parts + positions + KINDS_N)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        found = self.out(self.layers(features))
        released, part, position, kinds = found.split([1, self.parts, self.positions, KINDS_N], dim=1)
        pairs = (part[:, :, None] + position[:, None, :]).flatten(1)
        return torch.cat([pairs, kinds], dim=1), released[:, 0]


class ActionNet(nn.Module):
    """A track network, a network for each crop, and a head; any of the first two may be missing.

    Args:
        track: sees (n, features, frames).
        crop: sees one crop; it is asked about each of the crops in turn.
        crops: which of the two crops: 0 the hand now, 1 where it was last at a hole.
    """

    def __init__(
        self, track: nn.Module | None, crop: nn.Module | None, crops: tuple[int, ...], parts: int, positions: int
    ) -> None:
        super().__init__()
        self.track, self.crop, self.crops = track, crop, crops
        width = int(track.width) if track is not None else 0  # type: ignore[arg-type]
        width += len(crops) * int(crop.width) if crop is not None else 0  # type: ignore[arg-type]
        self.head = Head(width, parts, positions)

    def forward(self, track: Tensor, crops: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (n, classes) and of "released" (n,).

        Args:
            track: (n, features, frames).
            crops: (n, 2, height, width, 3), uint8.
        """
        features = [] if self.track is None else [self.track(track)]
        if self.crop is not None:
            images = levelled(crops.to(track.dtype)).permute(0, 1, 4, 2, 3) / 127.5 - 1.0
            features += [self.crop(images[:, index]) for index in self.crops]
        logits, released = self.head(torch.cat(features, dim=1))
        return logits, released


def levelled(crops: Tensor) -> Tensor:
    """Crops (n, k, height, width, 3) as bright as all are; black ones stay black."""
    mean = crops.mean(dim=(2, 3, 4), keepdim=True)
    return (crops * (LEVEL / mean.clamp(min=LEVEL / MOST_GAIN))).clamp(max=255.0)


class Lrcn(nn.Module):
    """VGG16 on whole frames, an LSTM over time, its answers averaged (Donahue 2015), as in the paper's baseline.

    Args:
        share: of VGG16's channels.
    """

    def __init__(self, share: float, parts: int, positions: int, cells: int = 256) -> None:
        super().__init__()
        self.frame = Vgg16(share)
        self.lstm = nn.LSTM(self.frame.width, cells, batch_first=True)
        self.head = Head(cells, parts, positions)

    def forward(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """As ActionNet, of frames (n, t, height, width, 3), uint8."""
        images = frames.permute(0, 1, 4, 2, 3).float() / 127.5 - 1.0
        features = self.frame(images.flatten(0, 1)).unflatten(0, (-1, frames.shape[1]))
        logits, released = self.head(self.lstm(features)[0].mean(dim=1))
        return logits, released


class PlainLstm(nn.Module):
    """An LSTM over time, as in the paper's baseline CNN + LSTM."""

    def __init__(self, cells: int = 64) -> None:
        super().__init__()
        self.lstm = nn.LSTM(TRACK_FEATURES, cells, batch_first=True)
        self.width = cells

    def forward(self, track: Tensor) -> Tensor:
        found: Tensor = self.lstm(track.transpose(1, 2))[0][:, -1]
        return found


def build(kind: str, parts: int, positions: int, share: float = 1.0) -> ActionNet | Lrcn:
    """The network of a kind of detector.

    Args:
        kind: slim; paper; cnn_lstm (plain LSTM instead of LSTM-FCN); hand (the crop alone); lrcn (whole frames);
            track (the track alone).
        share: of VGG16's channels.

    Raises:
        KeyError: there is no such kind.
    """
    makers: dict[str, Callable[[], ActionNet | Lrcn]] = {
        "slim": lambda: ActionNet(SlimTrack(), SmallCnn(), (0, 1), parts, positions),
        "paper": lambda: ActionNet(LstmFcn(64, (128, 256, 128)), Vgg16(share), (0,), parts, positions),
        "cnn_lstm": lambda: ActionNet(PlainLstm(), Vgg16(share), (0,), parts, positions),
        "hand": lambda: ActionNet(None, Vgg16(share), (0,), parts, positions),
        "lrcn": lambda: Lrcn(share, parts, positions),
        "track": lambda: ActionNet(SlimTrack(), None, (), parts, positions),
    }
    return makers[kind]()
