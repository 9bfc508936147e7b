"""Where parts stand around a part, told by a network that sees its crop. Imports torch.

The paper takes the features of a node from a detector, which was trained to find parts. So does this: the network
learns from the places where the parts of the training images stand, not from what can be grasped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bracket_cell.learned.grasp.crops import CHANNELS, CROP_PX, STEP_M, Crops
from bracket_lab.learned.grasp.scenes import Scene, data_hash
from bracket_lab.learned.training.training_loop import Checkpoint, fit

MAP_PX, CELL_M = CROP_PX // 2, 2 * STEP_M
Maps = NDArray[
    np.uint8
]  # (n, types, MAP_PX, MAP_PX): share of each cell that a body of a type covers, 255 for all of it
_FINER = 4  # times finer drawn, then averaged
_SHIFT = 4  # bits of a pixel's fraction
_SPREADS = (1, 2, 4, 2, 1)  # dilations, by which a cell's answer rests on 14 cm around it
_BATCH, _PEAK_RATE, _AT_ONCE = 64, 0.004, 256


class FootprintNet(nn.Module):
    """Logits (b, types, MAP_PX, MAP_PX) that a body of a type covers a cell, of crops."""

    def __init__(self, types: int, channels: int = 24) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(CHANNELS, channels, 5, 2, 2), nn.ReLU()]
        for spread in _SPREADS:
            layers += [nn.Conv2d(channels, channels, 3, 1, spread, spread), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Conv2d(channels, types, 1))

    def forward(self, crops: Tensor) -> Tensor:
        """Of crops (b, CHANNELS, CROP_PX, CROP_PX), bytes or numbers up to 255."""
        logits: Tensor = self.layers(crops.to(torch.float32) / 255.0 - 0.5)
        return logits

    def maps(self, crops: Crops) -> Maps:
        """What it tells of crops, as bytes."""
        with torch.no_grad():
            found = [torch.sigmoid(self(some)) for some in torch.split(torch.from_numpy(crops), _AT_ONCE)]
        return (torch.cat(found) * 255).round().to(torch.uint8).numpy()


def true_maps(scene: Scene, types: Sequence[str]) -> Maps:
    """Where the bodies of a scene stand around each detected part."""
    pixels, half = MAP_PX * _FINER, scene.boxes.size_m[:, None, :2] / 2 - CELL_M / _FINER / 2  # edges are drawn, too
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cos, sin = np.cos(scene.boxes.yaw_rad)[:, None], np.sin(scene.boxes.yaw_rad)[:, None]
    x = scene.boxes.centre_m[:, :1] + corners[..., 0] * cos - corners[..., 1] * sin
    y = scene.boxes.centre_m[:, 1:] + corners[..., 0] * sin + corners[..., 1] * cos
    found = np.zeros((len(scene.parts), len(types), MAP_PX, MAP_PX), np.uint8)
    for part, map_of in zip(scene.parts, found, strict=True):
        own, pose = np.zeros((len(types), pixels, pixels), np.uint8), part.world_from_part
        east, north = x - pose.position_m[0], y - pose.position_m[1]
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        places = np.stack([east * c + north * s, north * c - east * s], axis=-1) / (CELL_M / _FINER) + (pixels - 1) / 2
        for name, body in zip(scene.boxes.types, np.round(places * 2**_SHIFT).astype(np.int32), strict=True):
            cv2.fillConvexPoly(own[types.index(name)], body, 255, shift=_SHIFT)
        for channel, drawn in zip(map_of, own, strict=True):
            channel[:] = cv2.resize(drawn, (MAP_PX, MAP_PX), interpolation=cv2.INTER_AREA)
    return found


def fit_footprints(
    crops: Sequence[Crops],
    scenes: Sequence[Scene],
    types: Sequence[str],
    seed: int,
    passes: int,
    *,
    checkpoint: Path | None = None,
    quiet: bool = True,
) -> FootprintNet:
    """A trained network; the same arguments give the same weights.

    Args:
        crops: of each scene.
        passes: crops that it sees until it has learned, each crop as often as any other.
        checkpoint: file that keeps the fit, also when it is done; it goes on from one of the same arguments.
    """
    torch.manual_seed(seed)
    network = FootprintNet(len(types))
    seen = torch.from_numpy(np.concatenate(crops))
    wanted = torch.from_numpy(np.concatenate([true_maps(scene, types) for scene in scenes]))
    optimiser = torch.optim.AdamW(network.parameters(), _PEAK_RATE)

    def losses(epoch: int) -> Iterator[Tensor]:
        torch.manual_seed(seed * 100_003 + epoch)
        for chosen in torch.split(torch.randperm(len(seen)), _BATCH):
            dims = [dim for dim in (2, 3) if torch.rand(()) < 0.5]
            target = flipped(wanted[chosen], dims).to(torch.float32) / 255.0
            yield nn.functional.binary_cross_entropy_with_logits(network(flipped_crops(seen[chosen], dims)), target)

    batches = -(-len(seen) // _BATCH)
    kept = None if checkpoint is None else Checkpoint(checkpoint, f"{data_hash(scenes)} {seed} {passes}")
    fit(network, optimiser, losses, max(1, round(passes / len(seen))), batches, checkpoint=kept, quiet=quiet)
    return network.requires_grad_(False)


def flipped(maps: Tensor, dims: Sequence[int]) -> Tensor:
    """Maps or images seen in a mirror: rows (2), columns (3), or both."""
    return maps.flip(*dims) if dims else maps


def flipped_crops(crops: Tensor, dims: Sequence[int]) -> Tensor:
    """Crops seen in a mirror; lines of sight lean the other way there."""
    mirrored = flipped(crops, dims).clone()
    for dim, channel in ((3, CHANNELS - 2), (2, CHANNELS - 1)):
        if dim in dims:
            mirrored[:, channel] = 255 - mirrored[:, channel]
    return mirrored
