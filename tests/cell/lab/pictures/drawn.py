"""Photographs of plate and tray as another program draws them: flat shapes, a grainy table, light from one side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.bench import CameraSetup

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
LARGER = 2  # than the camera's frames, as photographs are
SKIN_BGR = (120, 160, 220)
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Drawn:
    """What a photograph shows, in pixels of the camera's frames.

    Attributes:
        holes: by position, the part's type or None.
        hand, parts: boxes.
    """

    holes: dict[str, str | None]
    hand: Box | None
    parts: tuple[tuple[str, Box], ...]


def photograph_plate(path: Path, seed: int) -> Drawn:
    """A plate with coloured parts and dark holes, and now and then a hand beside it."""
    rng = np.random.default_rng(seed)
    setup = BENCH.overhead
    image = _table(setup, rng)
    places = BENCH.bracket.pose.transform(np.array([[*xy, 0.0] for xy in PRODUCT.bracket.holes_m.values()]))
    pixels = setup.model.project(setup.mount.pose, places)
    low, high = pixels.min(axis=0) - 25, pixels.max(axis=0) + 25
    cv2.rectangle(image, _scaled(low), _scaled(high), (190, 190, 185), -1)
    holes: dict[str, str | None] = {}
    for position, middle in zip(PRODUCT.positions, pixels, strict=True):
        part = [None, *PRODUCT.parts][int(rng.integers(1 + len(PRODUCT.parts)))]
        holes[position] = part
        if part is None:
            cv2.circle(image, _scaled(middle), 3 * LARGER, (15, 15, 15), -1)
        else:
            turned = cv2.boxPoints(((0.0, 0.0), (13.0 * LARGER, 10.0 * LARGER), float(rng.uniform(0, 180))))
            corners = (turned + np.array(_scaled(middle))).astype(np.int32)
            cv2.fillPoly(image, [corners], _bgr(part))
    hand = None
    if seed % 3 == 0:
        x, y = float(rng.uniform(60, setup.width_px - 60)), 45.0
        cv2.ellipse(image, _scaled((x, y)), (16 * LARGER, 34 * LARGER), 0, 0, 360, SKIN_BGR, -1)
        hand = (x - 16, y - 34, x + 16, y + 34)
    _write(path, image, rng)
    return Drawn(holes, hand, ())


def photograph_tray(path: Path, seed: int) -> Drawn:
    """Coloured parts that lie apart from each other."""
    rng = np.random.default_rng(seed)
    setup = BENCH.wrist
    image, parts = _table(setup, rng), []
    cells = rng.permutation(4)[: int(rng.integers(2, 5))]
    for cell in cells:
        name = list(PRODUCT.parts)[int(rng.integers(len(PRODUCT.parts)))]
        x, y = (0.3 + 0.4 * (cell % 2)) * setup.width_px, (0.3 + 0.4 * (cell // 2)) * setup.height_px
        half = np.array([rng.uniform(14, 26), rng.uniform(14, 26)])
        low, high = np.array([x, y]) - half, np.array([x, y]) + half
        cv2.rectangle(image, _scaled(low), _scaled(high), _bgr(name), -1)
        parts.append((name, (float(low[0]), float(low[1]), float(high[0]), float(high[1]))))
    _write(path, image, rng)
    return Drawn({}, None, tuple(parts))


def _table(setup: CameraSetup, rng: np.random.Generator) -> NDArray[np.uint8]:
    size = setup.height_px * LARGER, setup.width_px * LARGER
    grain = cv2.GaussianBlur(rng.normal(0, 30, size), (0, 0), 5)
    light = np.linspace(0.8, 1.1, size[1])
    return np.clip((90 + grain)[..., np.newaxis] * light[:, np.newaxis] * (0.9, 1.0, 1.1), 0, 255).astype(np.uint8)


def _bgr(part: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * level) for level in PRODUCT.parts[part].colour_rgb)
    return blue, green, red


def _scaled(point: Any) -> tuple[int, int]:
    return round(float(point[0]) * LARGER), round(float(point[1]) * LARGER)


def _write(path: Path, image: NDArray[np.uint8], rng: np.random.Generator) -> None:
    noisy = np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), noisy)
