"""Foreign objects: what else than parts may lie in a tray, drawn at random from a few families."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bracket_ground.files.units import Rgb
from bracket_ground.interfaces.solid import Solid

UNKNOWN = "unknown"
DENSITY_KG_M3 = 2000.0
COLOURS: dict[str, Rgb] = {
    "brass": (0.70, 0.57, 0.26),
    "zinc": (0.58, 0.60, 0.62),
    "black": (0.07, 0.07, 0.08),
    "white": (0.78, 0.78, 0.75),
    "wood": (0.58, 0.43, 0.27),
    "orange": (0.85, 0.42, 0.08),
    "violet": (0.40, 0.15, 0.50),
}
METALS = ("brass", "zinc")


@dataclass(frozen=True)
class UnknownObject:
    """An unknown object, to be touched and gripped like a part.

    Attributes:
        solids: what it is made of; its frame is that of a part, its origin in the middle of the bottom.
        finish: what its surface is.
    """

    solids: tuple[Solid, ...]
    colour_rgb: Rgb
    mass_kg: float
    finish: Literal["paint", "steel"]


def draw_unknown_object(rng: np.random.Generator) -> UnknownObject:
    """One at random: a bolt, a pipe fitting, a block, a knob or a bracket, 2 to 8 cm long."""
    solids = _FAMILIES[int(rng.integers(len(_FAMILIES)))](rng)
    name = list(COLOURS)[int(rng.integers(len(COLOURS)))]
    volume_m3 = sum(solid.volume_m3 for solid in solids)
    return UnknownObject(solids, COLOURS[name], DENSITY_KG_M3 * volume_m3, "steel" if name in METALS else "paint")


def _cylinder(diameter_m: float, length_m: float, bottom_m: float, shade: float = 1.0) -> Solid:
    """An upright cylinder on the object's axis."""
    size = (diameter_m, diameter_m, length_m)
    return Solid(solid="cylinder", size_m=size, centre_m=(0.0, 0.0, bottom_m + length_m / 2), shade=shade)


def _box(size_m: tuple[float, float, float], centre_m: tuple[float, float, float], shade: float = 1.0) -> Solid:
    return Solid(solid="box", size_m=size_m, centre_m=centre_m, shade=shade)


def _bolt(rng: np.random.Generator) -> tuple[Solid, ...]:
    shaft, length = rng.uniform(0.008, 0.016), rng.uniform(0.025, 0.060)
    head = 1.7 * shaft
    return _cylinder(head, 0.7 * shaft, 0.0), _cylinder(shaft, length, 0.7 * shaft, shade=0.85)


def _fitting(rng: np.random.Generator) -> tuple[Solid, ...]:
    pipe, arm = rng.uniform(0.012, 0.024), rng.uniform(0.030, 0.055)
    across = Solid(solid="cylinder", size_m=(arm, pipe, pipe), centre_m=(0.0, 0.0, pipe / 2), axis="x")
    return across, _cylinder(pipe, arm / 2, pipe / 2), _cylinder(1.3 * pipe, 0.006, pipe / 2 + arm / 2, shade=0.8)


def _block(rng: np.random.Generator) -> tuple[Solid, ...]:
    length, width, height = rng.uniform((0.030, 0.020, 0.012), (0.080, 0.045, 0.040))
    return (_box((length, width, height), (0.0, 0.0, height / 2)),)


def _knob(rng: np.random.Generator) -> tuple[Solid, ...]:
    ball, neck = rng.uniform(0.020, 0.038), rng.uniform(0.010, 0.020)
    middle = neck + 0.4 * ball
    top = Solid(solid="ball", size_m=(ball, ball, ball), centre_m=(0.0, 0.0, middle))
    return _cylinder(0.7 * ball, 0.006, 0.0, shade=0.8), _cylinder(0.4 * ball, neck, 0.0, shade=0.8), top


def _angle(rng: np.random.Generator) -> tuple[Solid, ...]:
    length, height, width = rng.uniform((0.030, 0.025, 0.015), (0.070, 0.050, 0.035))
    thick = 0.005
    upright = _box((thick, width, height), ((thick - length) / 2, 0.0, height / 2), shade=0.85)
    return _box((length, width, thick), (0.0, 0.0, thick / 2)), upright


_FAMILIES: tuple[Callable[[np.random.Generator], tuple[Solid, ...]], ...] = (_bolt, _fitting, _block, _knob, _angle)
