"""Convex pieces that everyday objects are made of, with colours and patterns."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bracket_ground.files.units import Rgb

Shape = Literal["box", "cylinder", "capsule", "ball", "cone"]
Pattern = Literal["plain", "stripes", "checks", "dots", "print", "grain", "speckles", "keys", "label"]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

TILE_PX = 64  # side of a pattern
FACES = 6  # of a cube, whose sides have the pattern each
ROUND = 14  # corners of a cone's rings
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
ALONG_X: Quaternion = (HALF, 0.0, HALF, 0.0)
ALONG_Y: Quaternion = (HALF, -HALF, 0.0, 0.0)
STEEL: Rgb = (0.62, 0.63, 0.66)
WHITE: Rgb = (0.90, 0.90, 0.88)
BLACK: Rgb = (0.06, 0.06, 0.07)
BROWN: Rgb = (0.55, 0.38, 0.20)
LEATHER: Rgb = (0.30, 0.17, 0.09)
RED: Rgb = (0.75, 0.10, 0.08)
GREEN: Rgb = (0.35, 0.62, 0.15)
YELLOW: Rgb = (0.92, 0.76, 0.12)
GREY: Rgb = (0.45, 0.46, 0.48)
SKY: Rgb = (0.25, 0.45, 0.75)
ON_ITS_SIDE = (ALONG_X, ALONG_Y)
Rng = np.random.Generator


@dataclass(frozen=True)
class Piece:
    """A convex piece in its object's frame.

    Attributes:
        size_m: extents of a box or ball; else diameter (of a cone's bottom), diameter (of its top) and length.
        turn: object_from_piece (w, x, y, z); round pieces are long along their z.
        ink_rgb: second colour of its pattern.
    """

    shape: Shape
    size_m: Vector
    centre_m: Vector
    rgb: Rgb
    turn: Quaternion = UPRIGHT
    pattern: Pattern = "plain"
    ink_rgb: Rgb = BLACK

    @property
    def volume_m3(self) -> float:
        """Of the piece alone."""
        a, b, c = self.size_m
        if self.shape in ("cylinder", "capsule"):
            return math.pi / 4 * a * a * c
        if self.shape == "cone":
            return math.pi / 12 * (a * a + a * b + b * b) * c
        return a * b * c * (1.0 if self.shape == "box" else math.pi / 6)


@dataclass(frozen=True)
class Thing:
    """One object.

    Attributes:
        pieces: 2 to 6; z is up where it lies as it usually does.
        stances: ways in which it is set down: world_from_object without place and heading.
    """

    pieces: tuple[Piece, ...]
    stances: tuple[Quaternion, ...] = (UPRIGHT,)


def box(size_m: Sequence[float], centre_m: Sequence[float], rgb: Rgb, yaw_rad: float = 0.0) -> Piece:
    """A box, turned about z."""
    return Piece("box", _three(size_m), _three(centre_m), rgb, about_z(yaw_rad))


def disc(diameter_m: float, height_m: float, centre_m: Sequence[float], rgb: Rgb) -> Piece:
    """An upright cylinder."""
    return Piece("cylinder", (diameter_m, diameter_m, height_m), _three(centre_m), rgb)


def tube(diameter_m: float, length_m: float, centre_m: Sequence[float], rgb: Rgb) -> Piece:
    """A cylinder that lies along x."""
    return Piece("cylinder", (diameter_m, diameter_m, length_m), _three(centre_m), rgb, ALONG_X)


def ball(size_m: Sequence[float], centre_m: Sequence[float], rgb: Rgb) -> Piece:
    """An ellipsoid."""
    return Piece("ball", _three(size_m), _three(centre_m), rgb)


def cone(bottom_m: float, top_m: float, length_m: float, centre_m: Sequence[float], rgb: Rgb) -> Piece:
    """A cone without its tip, upright."""
    return Piece("cone", (bottom_m, top_m, length_m), _three(centre_m), rgb)


def rod(begin_m: Sequence[float], end_m: Sequence[float], diameter_m: float, rgb: Rgb) -> Piece:
    """A round bar with round ends between two points."""
    begin, end = np.array(begin_m, dtype=float), np.array(end_m, dtype=float)
    way = end - begin
    length = float(np.linalg.norm(way))
    axis, angle = np.array([-way[1], way[0], 0.0]), math.acos(float(way[2]) / length)
    flat = float(np.linalg.norm(axis))
    x, y, _ = (axis / flat * math.sin(angle / 2)).tolist() if flat > 1e-9 else (math.sin(angle / 2), 0.0, 0.0)
    size, turn = (diameter_m, diameter_m, length), (math.cos(angle / 2), x, y, 0.0)
    return Piece("capsule", size, _three(((begin + end) / 2).tolist()), rgb, turn)


def about_z(angle_rad: float) -> Quaternion:
    """A turn about z."""
    return math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)


def colour(rng: np.random.Generator, dull: float = 0.35, bright: float = 0.95) -> Rgb:
    """Any hue, fairly saturated."""
    low, high = (0.0, 0.45, dull), (1.0, 0.95, bright)
    red, green, blue = colorsys.hsv_to_rgb(*(float(value) for value in rng.uniform(low, high)))
    return red, green, blue


def near(rgb: Rgb, rng: np.random.Generator, spread: float = 0.08) -> Rgb:
    """A colour like another one."""
    red, green, blue = (float(value) for value in np.clip(np.array(rgb) + rng.normal(0, spread, 3), 0.02, 0.98))
    return red, green, blue


def one_of(rng: np.random.Generator, *colours: Rgb) -> Rgb:
    """One of some colours, a little changed."""
    return near(colours[int(rng.integers(len(colours)))], rng, 0.04)


def tile(piece: Piece, rng: np.random.Generator) -> NDArray[np.uint8]:
    """A pattern in the piece's two colours (TILE_PX, TILE_PX, 3)."""
    ink = _INK[piece.pattern](rng)[..., None]
    rgb = np.array(piece.rgb) * (1 - ink) + np.array(piece.ink_rgb) * ink
    rgb = rgb * rng.normal(1.0, 0.025, (TILE_PX, TILE_PX, 1))
    drawn: NDArray[np.uint8] = (np.clip(rgb, 0, 1) * 255).astype(np.uint8)
    return drawn


Ink = NDArray[np.float64]
_ROWS, _COLUMNS = np.mgrid[0:TILE_PX, 0:TILE_PX]


def _plain(rng: np.random.Generator) -> Ink:  # noqa: ARG001
    return np.zeros((TILE_PX, TILE_PX))


def _stripes(rng: np.random.Generator) -> Ink:
    width, across = int(rng.integers(5, 14)), rng.random() < 0.5
    stripes: Ink = ((_ROWS if across else _COLUMNS) // width % 2).astype(float)
    return stripes


def _checks(rng: np.random.Generator) -> Ink:
    width = int(rng.integers(6, 16))
    checks: Ink = ((_ROWS // width + _COLUMNS // width) % 2).astype(float)
    return checks


def _dots(rng: np.random.Generator) -> Ink:
    apart = int(rng.integers(10, 18))
    dots: Ink = ((_ROWS % apart - apart / 2) ** 2 + (_COLUMNS % apart - apart / 2) ** 2 < (0.3 * apart) ** 2) * 1.0
    return dots


def _print(rng: np.random.Generator) -> Ink:
    """Lines of text."""
    ink = np.zeros((TILE_PX, TILE_PX))
    for top in range(6, TILE_PX - 6, 6):
        ink[top : top + 2, 6 : int(rng.integers(TILE_PX // 2, TILE_PX - 5))] = rng.uniform(0.6, 1.0)
    return ink


def _grain(rng: np.random.Generator) -> Ink:
    """Of wood or leather."""
    waves = np.sin(_COLUMNS / rng.uniform(2, 5) + 2 * np.sin(_ROWS / rng.uniform(6, 14)))
    grain: Ink = 0.25 + 0.25 * waves
    return grain


def _speckles(rng: np.random.Generator) -> Ink:
    speckles: Ink = np.where(rng.random((TILE_PX, TILE_PX)) < 0.12, float(rng.uniform(0.4, 1.0)), 0.0)
    return speckles


def _keys(rng: np.random.Generator) -> Ink:
    """Rows of buttons."""
    down, across = int(rng.integers(8, 12)), int(rng.integers(16, 22))
    keys: Ink = ((_ROWS % across > across * 0.4) & (_COLUMNS % down > down * 0.4)).astype(float)
    return keys


def _label(rng: np.random.Generator) -> Ink:
    """A field with lines in it."""
    ink = np.zeros((TILE_PX, TILE_PX))
    top, left = (int(value) for value in rng.integers(6, 20, 2))
    ink[top : top + 34, left : left + 38] = 1.0
    ink[top + 6 : top + 28 : 6, left + 5 : left + 30] = 0.35
    return ink


_INK = {
    "plain": _plain,
    "stripes": _stripes,
    "checks": _checks,
    "dots": _dots,
    "print": _print,
    "grain": _grain,
    "speckles": _speckles,
    "keys": _keys,
    "label": _label,
}


def _three(values: Sequence[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
