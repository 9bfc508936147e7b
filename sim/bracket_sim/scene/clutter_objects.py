"""What lies about on the table: tools, boxes and unknown things. They are seen and never touched."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.look import Things
from bracket_sim.scene.palette import NO_TOUCH, Rgb, add_box, add_cylinder

REGION_M = ((0.30, 1.30), (-0.75, 0.80))  # where things lie: what the cameras see, and a little more
TRIES = 200
ARM_FOOT_M = 0.22
CLEAR_M = 0.03
STEEL = (0.42, 0.43, 0.45)
WOOD = (0.50, 0.36, 0.21)
CARDBOARD = (0.48, 0.36, 0.24)
LABEL = (0.70, 0.70, 0.66)
LABEL_M = 0.0008

Rectangle = tuple[float, float, float, float]  # least x, greatest x, least y, greatest y


def add_things(spec: mujoco.MjSpec, product: Product, bench: Bench, things: Things) -> None:
    """Lay things where neither person nor robot works; the arrangement's number chooses kinds, places and colours."""
    rng = np.random.default_rng(things.arrangement)
    makers = [
        *(_tool(rng) for _ in range(things.tools_n)),
        *(_box for _ in range(things.boxes_n)),
        *(_unknown for _ in range(things.unknown_n)),
    ]
    taken = list(kept_free(product, bench))
    for number, make in enumerate(makers):
        body = spec.worldbody.add_body(name=f"thing_{number}")
        radius_m = make(body, rng)
        spot = _free_spot(taken, radius_m, rng)
        if spot is None:
            spec.delete(body)
            continue
        x, y = spot
        taken.append((x - radius_m, x + radius_m, y - radius_m, y + radius_m))
        turn = rng.uniform(-math.pi, math.pi) / 2
        body.pos, body.quat = [x, y, 0.0], [math.cos(turn), 0.0, 0.0, math.sin(turn)]


def kept_free(product: Product, bench: Bench) -> Iterator[Rectangle]:
    """Where things would be in the way: tray, bins and bracket with all between them, hand, and the arm's foot."""
    x, y, _ = bench.tray.centre_m
    yield x - bench.tray.size_m[0] / 2, x + bench.tray.size_m[0] / 2, y - bench.tray.size_m[1] / 2, y + 0.25
    holes = [bench.bracket.position_m[:2] + np.array(hole) for hole in product.bracket.holes_m.values()]
    spots = np.array([*(hole for hole in holes), *(spot[:2] for spot in bench.bins_m.values())])
    low, high = spots.min(axis=0) - 0.08, spots.max(axis=0) + 0.08
    yield float(low[0]), float(high[0]), float(low[1]), float(high[1])
    x, y, _ = bench.hand_rest_m
    yield x - 0.15, x + 0.5, y - 0.12, y + 0.2
    yield -ARM_FOOT_M, ARM_FOOT_M, -ARM_FOOT_M, ARM_FOOT_M


def _free_spot(taken: Sequence[Rectangle], radius_m: float, rng: np.random.Generator) -> tuple[float, float] | None:
    reach = radius_m + CLEAR_M
    for _ in range(TRIES):
        x, y = (float(rng.uniform(*side)) for side in REGION_M)
        if not any(a - reach < x < b + reach and c - reach < y < d + reach for a, b, c, d in taken):
            return x, y
    return None


def _tool(rng: np.random.Generator) -> Callable[[mujoco.MjsBody, np.random.Generator], float]:
    return (_screwdriver, _hammer, _spanner)[int(rng.integers(3))]


def _screwdriver(body: mujoco.MjsBody, rng: np.random.Generator) -> float:
    """Handle and shaft along x; returns the radius of the circle that it needs."""
    length_m = float(rng.uniform(0.16, 0.24))
    _lie(add_cylinder(body, (-0.3 * length_m, 0, 0.013), 0.026, 0.4 * length_m, _colour(rng), NO_TOUCH))
    _lie(add_cylinder(body, (0.2 * length_m, 0, 0.013), 0.006, 0.6 * length_m, STEEL, NO_TOUCH))
    return length_m / 2


def _hammer(body: mujoco.MjsBody, rng: np.random.Generator) -> float:
    length_m = float(rng.uniform(0.22, 0.30))
    rgb = WOOD if rng.random() < 0.5 else _colour(rng)
    _lie(add_cylinder(body, (0, 0, 0.012), 0.024, length_m, rgb, NO_TOUCH))
    add_box(body, (length_m / 2, 0, 0.013), (0.026, 0.10, 0.026), STEEL, NO_TOUCH)
    return length_m / 2 + 0.02


def _spanner(body: mujoco.MjsBody, rng: np.random.Generator) -> float:
    length_m = float(rng.uniform(0.14, 0.22))
    add_box(body, (0, 0, 0.004), (length_m, 0.014, 0.007), STEEL, NO_TOUCH)
    for end in (-1, 1):
        add_cylinder(body, (end * length_m / 2, 0, 0.0045), 0.032, 0.009, STEEL, NO_TOUCH)
        add_cylinder(body, (end * length_m / 2, 0, 0.0048), 0.014, 0.0096, (0.1, 0.1, 0.1), NO_TOUCH)
    return length_m / 2 + 0.016


def _box(body: mujoco.MjsBody, rng: np.random.Generator) -> float:
    length_m, width_m, height_m = (float(value) for value in rng.uniform((0.07, 0.05, 0.02), (0.18, 0.12, 0.07)))
    rgb = CARDBOARD if rng.random() < 0.5 else _colour(rng)
    add_box(body, (0, 0, height_m / 2), (length_m, width_m, height_m), rgb, NO_TOUCH)
    if rng.random() < 0.6:
        top = (0.15 * length_m, 0.1 * width_m, height_m)
        add_box(body, top, (0.45 * length_m, 0.5 * width_m, 2 * LABEL_M), LABEL, NO_TOUCH)
    return math.hypot(length_m, width_m) / 2


def _unknown(body: mujoco.MjsBody, rng: np.random.Generator) -> float:
    """Two or three simple shapes grown together, each of any colour."""
    for number in range(int(rng.integers(2, 4))):
        size_m = rng.uniform(0.012, 0.032, 3)
        centre_m = [*(rng.uniform(-0.025, 0.025, 2) * (number > 0)), float(size_m[2])]
        rgb = _colour(rng)
        if rng.random() < 0.4:
            add_box(body, centre_m, list(2 * size_m), rgb, NO_TOUCH)
        elif rng.random() < 0.5:
            add_cylinder(body, centre_m, float(2 * size_m[0]), float(2 * size_m[2]), rgb, NO_TOUCH)
        else:
            ball = add_box(body, centre_m, list(2 * size_m), rgb, NO_TOUCH)
            ball.type = mujoco.mjtGeom.mjGEOM_ELLIPSOID
    return 0.06


def _lie(cylinder: mujoco.MjsGeom) -> None:
    """Turn an upright cylinder along x."""
    cylinder.quat = [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0]


def _colour(rng: np.random.Generator) -> Rgb:
    """Any hue, from dull to as saturated as the parts' paint."""
    return colorsys.hsv_to_rgb(*(float(value) for value in rng.uniform((0.0, 0.1, 0.15), (1.0, 0.95, 0.75))))
