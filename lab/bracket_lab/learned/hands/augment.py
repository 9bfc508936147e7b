"""What training does to images so that networks do not rely on colour, light or sharpness. Imports torch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from bracket_cell.learned.hands.regions import turning
from bracket_ground.interfaces.pose import Array

MIX_SHARE, BLUR_SHARE, GAMMA_SHARE, COVER_SHARE, DARK_SHARE = 0.6, 0.5, 0.4, 0.3, 0.5
NEGATIVE_SHARE = 0.15  # of images whose bright and dark are swapped: a dark hand over a bright table
LARGEST_NOISE, NOISY_SHARE = 0.08, 0.7  # the others keep the noise that they have: cameras may be good, too
SHADE_SHARE, SHADE_LIGHT, SHADE_SOFT = 0.3, (0.3, 0.9), (0.005, 0.1)  # of images partly in shadow; edge, in widths
COARSE_SHARE = 0.3  # of images whose noise is as coarse as two pixels: what JPEG leaves of it
DARKEST = 0.15  # of the light: noise counts more in the dark
BLURS = 4  # passes of 3 x 3 pixels
GAMMA = 0.35  # standard deviation of its logarithm
COVER = (0.08, 0.3)  # sides of what covers a piece, as shares of the image's


def varied(
    images: Tensor, rng: np.random.Generator, largest_noise: float = LARGEST_NOISE, *, shades: bool = True
) -> tuple[Tensor, Tensor]:
    """Images (n, 3, height, width) of 0 to 1 with other colours, gamma, blur, light, shadow, noise and a piece covered.

    Args:
        shades: some are partly in shadow.

    Returns:
        The images, and how much the channels of each were mixed, (n,), 0 to 1.
    """
    count = len(images)
    amount = rng.uniform(0.0, 1.0, count) * (rng.random(count) < MIX_SHARE)
    mixing = _mixing(amount, rng)
    images = torch.einsum("nij,njhw->nihw", mixing, images).clamp(0.0, 1.0)
    negative = torch.from_numpy(rng.random(count) < NEGATIVE_SHARE)[:, None, None, None]
    images = torch.where(negative, 1.0 - images, images)
    if shades:
        _shade(images, rng)
    gamma = np.exp(rng.normal(0.0, GAMMA, count) * (rng.random(count) < GAMMA_SHARE))
    images = images + 1e-4
    curved = torch.from_numpy(gamma != 1.0)
    images[curved] = images[curved] ** _each(gamma)[curved]
    softness = rng.uniform(0.0, BLURS, count) * (rng.random(count) < BLUR_SHARE)
    for passed in range(BLURS):
        rows = torch.from_numpy(softness > passed)  # the others stay as they are: blurring costs most of this
        sharp = images[rows]
        soft = F.avg_pool2d(F.pad(sharp, (1, 1, 1, 1), mode="replicate"), 3, 1)
        images[rows] = sharp + _each(np.clip(softness - passed, 0.0, 1.0))[rows] * (soft - sharp)
    images = images * _each(np.where(rng.random(count) < DARK_SHARE, rng.uniform(DARKEST, 1.0, count), 1.0))
    noise = torch.from_numpy(rng.standard_normal(images.shape, dtype=np.float32))
    coarse = torch.from_numpy(rng.random(count) < COARSE_SHARE)
    noise[coarse] = F.avg_pool2d(F.pad(noise[coarse], (0, 1, 0, 1)), 2, 1) * 2.0
    strength = largest_noise * rng.random(count) ** 1.5 * (rng.random(count) < NOISY_SHARE)
    images = (images + _each(strength) * noise).clamp(0.0, 1.0)
    _cover(images, rng)
    return images, torch.from_numpy(amount.astype(np.float32))


def _mixing(amount: np.ndarray[tuple[int], np.dtype[np.float64]], rng: np.random.Generator) -> Tensor:
    """Matrices (n, 3, 3) from the identity (amount 0) to channels swapped, mixed and weighed at random (1)."""
    random = rng.dirichlet((0.6, 0.6, 0.6), (len(amount), 3)) * rng.uniform(0.6, 1.4, (len(amount), 3, 1))
    share = amount[:, np.newaxis, np.newaxis]
    return torch.from_numpy(((1 - share) * np.eye(3) + share * random).astype(np.float32))


def _shade(images: Tensor, rng: np.random.Generator) -> None:
    """Let a shadow with a straight edge fall on some of the images, in place."""
    rows = np.flatnonzero(rng.random(len(images)) < SHADE_SHARE)
    height, width = images.shape[2:]
    line, column = np.mgrid[0:height, 0:width] / width
    for row in rows:
        angle, (x, y) = rng.uniform(0, 2 * np.pi), rng.random(2) * (1.0, height / width)
        beyond = np.cos(angle) * (column - x) + np.sin(angle) * (line - y)
        share = 1 / (1 + np.exp(-np.clip(beyond / rng.uniform(*SHADE_SOFT), -30, 30)))
        light = 1 - (1 - rng.uniform(*SHADE_LIGHT)) * share
        images[row] *= torch.from_numpy(light.astype(np.float32))


def _cover(images: Tensor, rng: np.random.Generator) -> None:
    """Lay a plain rectangle over some of the images, in place."""
    height, width = images.shape[2:]
    for row in np.flatnonzero(rng.random(len(images)) < COVER_SHARE):
        tall, wide = (rng.uniform(*COVER, 2) * (height, width)).astype(int) + 1
        top, left = int(rng.integers(height - tall)), int(rng.integers(width - wide))
        colour = torch.from_numpy(rng.random(3).astype(np.float32))
        images[row, :, top : top + tall, left : left + wide] = colour[:, None, None]


def _each(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))[:, None, None, None]


TURNED_SHARE = 0.4  # of training images
LARGEST_TURN_RAD = math.pi / 2


def drawn_turns(count: int, rng: np.random.Generator) -> Array:
    """(count,) Angles [rad] from right to down of training images; some stay as they are."""
    chosen = rng.random(count) < TURNED_SHARE
    angles: Array = rng.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD, count) * chosen
    return angles


def turned_images(images: NDArray[np.uint8], turns: Array) -> NDArray[np.uint8]:
    """Images (n, height, width, 3), each turned about its middle; what comes in continues their edges."""
    height, width = images.shape[1:3]
    middle = (np.array([width, height]) - 1) / 2
    answer = images.copy()
    for row in np.flatnonzero(turns):
        turn = turning(turns[row])
        there = np.column_stack([turn, middle - turn @ middle])
        answer[row] = cv2.warpAffine(images[row], there, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return answer


def turned_points(points: Array, turns: Array, size: Sequence[float] | Array = (1.0, 1.0)) -> Array:
    """Points (n, ..., 2) about the middle of an image, each row turned.

    Args:
        turns: (n,) [rad].
        size: (width, height) of the image, where points are shares of it.
    """
    turn = np.array([turning(angle) for angle in turns]).reshape(len(turns), 2, 2)
    moved: Array = np.einsum("nij,n...j->n...i", turn, points * np.asarray(size)) / np.asarray(size)
    return moved
