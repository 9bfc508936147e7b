"""Light and sensor of training images, and how images are levelled, so that networks need not know the exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

LEVEL = 90.0  # mean grey level of every image that a network sees
MOST_GAIN = 6.0
EXPOSURE_EV = (-2.2, 0.8)
GAMMA = 0.45  # largest logarithm
GREY_SHARE, FADED_SHARE, LEAST_COLOUR = 0.1, 0.5, 0.35  # of images: without colour, with less of it; and how much less
SHADOW_SHARE, SHADOWS, SHADOW_LIGHT = 0.45, 3, (0.3, 0.85)
SLOPE_SHARE, SLOPE = 0.3, 0.4
BLUR_SHARE, LEAST_BLUR_PX = 0.55, 0.3
NOISE_SHARE, NOISE_LEVELS = 0.75, (1.0, 14.0)
JPEG_QUALITY = 20, 90
LEVEL_OFF = 0.12  # standard deviation of the logarithm: other things change an image's mean, too

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Camera:
    """How badly the camera that takes training images again may do so.

    Attributes:
        warmth: largest logarithm of red's gain, by which blue's is less: lamps are warm or cold.
        tint: largest logarithm of a channel's gain against green beside that.
        most_blur_px: standard deviation.
        jpeg_share: of images that are compressed.
    """

    warmth: float = 0.0
    tint: float = 0.35
    most_blur_px: float = 1.8
    jpeg_share: float = 0.3


ORDINARY = Camera()
POOR = Camera(warmth=0.6, tint=0.3, most_blur_px=2.4, jpeg_share=0.5)  # and in poor light
SOFT = replace(POOR, most_blur_px=3.5)  # beyond, the health of frames tells of a lens out of focus


def levelled(image: Image) -> Image:
    """The image as bright as all are."""
    return _amplified(image, mean_level(image))


def mean_level(image: Image) -> float:
    """Mean grey level; a grid of pixels tells it."""
    return float(image[::4, ::4].mean())


def spoiled(image: Image, rng: np.random.Generator, level: float | None = None, camera: Camera = ORDINARY) -> Image:
    """A training image in other light, as another camera takes it, levelled.

    Light, colours, lens, exposure, noise and compression come in the order in which they do in a camera, and each
    varies far more than in any data.

    Args:
        image: (height, width, 3) RGB.
        level: mean grey level of the image that this one is cut out of; its own where None.
        camera: that takes it again.
    """
    seen = image.astype(np.float32)
    _cast_shadows(seen, rng)
    seen = _coloured(seen, rng)
    seen *= (_gains(camera, rng) * 2 ** rng.uniform(*EXPOSURE_EV)).astype(np.float32)
    if rng.random() < BLUR_SHARE:
        blur_px = float(rng.uniform(LEAST_BLUR_PX, camera.most_blur_px))
        seen = np.asarray(cv2.GaussianBlur(seen, (0, 0), blur_px), np.float32)
    if rng.random() < NOISE_SHARE:
        seen += rng.standard_normal(seen.shape, np.float32) * np.float32(rng.uniform(*NOISE_LEVELS))
    taken = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    own = mean_level(taken)
    if rng.random() < camera.jpeg_share:
        taken = _compressed(taken, int(rng.integers(*JPEG_QUALITY)))
    whole = own if level is None else own * level / max(1.0, mean_level(image))
    return _amplified(taken, whole * math.exp(rng.normal(0.0, LEVEL_OFF)))


def _amplified(image: Image, level: float) -> Image:
    gain = min(MOST_GAIN, LEVEL / max(level, 1.0))
    return cv2.convertScaleAbs(image, alpha=gain).astype(np.uint8, copy=False)


def _gains(camera: Camera, rng: np.random.Generator) -> NDArray[np.float64]:
    """Of the three channels."""
    warm = rng.uniform(-camera.warmth, camera.warmth)
    red, blue = rng.uniform(-camera.tint, camera.tint, 2)
    gains: NDArray[np.float64] = np.exp([red + warm, 0.0, blue - warm])
    return gains


def _coloured(seen: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Another gamma, and less colour or none."""
    draw = rng.random()
    if draw < GREY_SHARE + FADED_SHARE:
        share = 0.0 if draw < GREY_SHARE else rng.uniform(LEAST_COLOUR, 1.1)
        grey = seen.mean(axis=2, keepdims=True)
        seen = grey + np.float32(share) * (seen - grey)
    gamma = math.exp(rng.uniform(-GAMMA, GAMMA))
    table = (255.0 * (np.arange(256) / 255.0) ** gamma).astype(np.float32)
    curved: NDArray[np.float32] = table[np.clip(seen, 0, 255).astype(np.uint8)]
    return curved


def _cast_shadows(seen: NDArray[np.float32], rng: np.random.Generator) -> None:
    """Light that falls off across the image, and shadows of things that are out of sight, in place."""
    height, width = seen.shape[:2]
    if rng.random() < SLOPE_SHARE:
        across, down = (np.linspace(-1, 1, size, dtype=np.float32) for size in (width, height))
        slope = rng.uniform(-SLOPE, SLOPE, 2).astype(np.float32)
        seen *= (1 + slope[0] * across + slope[1] * down[:, np.newaxis])[..., np.newaxis].clip(0.2)
    if rng.random() < SHADOW_SHARE:
        lit = np.ones((height, width), np.float32)
        for _ in range(int(rng.integers(1, SHADOWS + 1))):
            middle = (rng.uniform(-0.1, 1.1, 2) * (width, height)).astype(int)
            axes = (rng.uniform(0.08, 0.6, 2) * width).astype(int) + 1
            light, angle = rng.uniform(*SHADOW_LIGHT), float(rng.uniform(0, 180))
            cv2.ellipse(lit, (int(middle[0]), int(middle[1])), (int(axes[0]), int(axes[1])), angle, 0, 360, light, -1)
        seen *= cv2.GaussianBlur(lit, (0, 0), float(rng.uniform(0.5, 3.0)))[..., np.newaxis]


def _compressed(image: Image, quality: int) -> Image:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)
