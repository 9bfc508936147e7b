"""Things of a desk and a workbench, each made anew with other sizes and colours."""

from __future__ import annotations

import math
from dataclasses import replace

from bracket_sim.stacks.pieces import (
    ALONG_Y,
    BLACK,
    BROWN,
    GREEN,
    GREY,
    RED,
    SKY,
    STEEL,
    WHITE,
    YELLOW,
    Rng,
    Thing,
    ball,
    box,
    colour,
    disc,
    near,
    one_of,
    rod,
    tube,
)


def notebook(rng: Rng) -> Thing:
    """Covers, pages and a spine."""
    x, y, z = (float(value) for value in rng.uniform((0.15, 0.11, 0.010), (0.22, 0.16, 0.020)))
    rgb, cover = colour(rng), 0.0025
    front = replace(box((x, y, cover), (0, 0, z - cover / 2), rgb), pattern="label", ink_rgb=near(WHITE, rng))
    pages = box((x - 0.008, y - 0.008, z - 2 * cover), (0, 0, z / 2), WHITE)
    back = box((x, y, cover), (0, 0, cover / 2), rgb)
    spine = tube(z + 0.003, x, (0, -y / 2, z / 2 + 0.0015), BLACK if rng.random() < 0.6 else STEEL)
    return Thing((front, pages, back, spine))


def screwdriver(rng: Rng) -> Thing:
    """Grip, collar, shaft and tip."""
    grip, length, d = rng.uniform(0.09, 0.115), rng.uniform(0.08, 0.13), rng.uniform(0.026, 0.034)
    rgb, mid = one_of(rng, RED, YELLOW, SKY, GREEN), d / 2
    handle = replace(tube(d, grip, (-grip / 2, 0, mid), rgb), pattern="stripes", ink_rgb=near(BLACK, rng))
    collar = tube(0.7 * d, 0.018, (0.005, 0, mid), BLACK)
    shaft = tube(0.008, length, (length / 2, 0, mid), STEEL)
    tip = box((0.012, 0.010, 0.003), (length + 0.003, 0, mid), GREY)
    end = ball((0.02, d * 0.96, d * 0.96), (-grip, 0, mid), rgb)
    return Thing((handle, collar, shaft, tip, end))


def stapler(rng: Rng) -> Thing:
    """Base, rail, arm and hinge."""
    length, wide, rgb = rng.uniform(0.12, 0.15), rng.uniform(0.030, 0.038), one_of(rng, BLACK, SKY, RED, GREEN)
    base = box((length, wide, 0.010), (0, 0, 0.005), near(BLACK, rng, 0.03))
    rail = box((0.9 * length, 0.5 * wide, 0.014), (0, 0, 0.024), STEEL)
    arm = box((length, 0.8 * wide, 0.016), (0, 0, 0.038), rgb)
    hinge = box((0.025, 0.8 * wide, 0.042), (-0.42 * length, 0, 0.022), rgb)
    nose = ball((0.05, 0.8 * wide, 0.018), (0.40 * length, 0, 0.045), rgb)
    return Thing((base, rail, arm, hinge, nose))


def mobile_phone(rng: Rng) -> Thing:
    """A flat body with a screen that is lit or not."""
    x, y, z = rng.uniform(0.135, 0.16), rng.uniform(0.066, 0.076), rng.uniform(0.008, 0.011)
    body = box((x, y, z), (0, 0, z / 2), one_of(rng, BLACK, BLACK, STEEL))
    lit = one_of(rng, BLACK, (0.05, 0.10, 0.25), colour(rng))
    screen = replace(box((x - 0.018, y - 0.006, 0.0012), (0, 0, z), lit), pattern="dots", ink_rgb=colour(rng))
    button = disc(0.010, 0.0016, (x / 2 - 0.005, 0, z), GREY)
    return Thing((body, screen, button))


def pen(rng: Rng) -> Thing:
    """Barrel, cap, tip and clip."""
    d, length, rgb = rng.uniform(0.009, 0.013), rng.uniform(0.12, 0.14), one_of(rng, SKY, BLACK, RED, WHITE)
    body = tube(d, length, (0, 0, d / 2), rgb)
    cap = tube(d + 0.003, 0.4 * length, (-0.3 * length, 0, d / 2), near(rgb, rng))
    tip = tube(0.005, 0.018, (length / 2 + 0.008, 0, d / 2), STEEL)
    clip = box((0.3 * length, 0.003, 0.003), (-0.32 * length, 0, d + 0.002), STEEL)
    return Thing((body, cap, tip, clip))


def mouse(rng: Rng) -> Thing:
    """Base, shell and wheel."""
    x, y, z = rng.uniform(0.095, 0.115), rng.uniform(0.055, 0.065), rng.uniform(0.034, 0.042)
    rgb = one_of(rng, BLACK, GREY, WHITE)
    base = box((0.8 * x, 0.8 * y, 0.010), (0, 0, 0.005), BLACK)
    shell = ball((x, y, 0.96 * z), (0, 0, 0.52 * z), rgb)
    wheel = disc(0.02, 0.008, (0.28 * x, 0, 0.80 * z), one_of(rng, GREY, RED))
    wheel = replace(wheel, turn=ALONG_Y)
    seam = box((0.3 * x, 0.003, 0.006), (0.28 * x, 0, 0.88 * z), BLACK)
    return Thing((base, shell, wheel, seam))


def remote(rng: Rng) -> Thing:
    """A long body with a field of keys."""
    x, y, z = rng.uniform(0.16, 0.20), rng.uniform(0.042, 0.050), rng.uniform(0.018, 0.024)
    rgb = one_of(rng, BLACK, GREY, (0.75, 0.75, 0.76))
    body = box((x, y, z), (0, 0, z / 2), rgb)
    field = box((0.66 * x, 0.8 * y, 0.0024), (-0.08 * x, 0, z), near(rgb, rng, 0.03))
    field = replace(field, pattern="keys", ink_rgb=near(WHITE, rng) if sum(rgb) < 1.4 else near(BLACK, rng, 0.03))
    power = disc(0.012, 0.006, (0.40 * x, 0.2 * y, z), RED)
    ring = disc(0.026, 0.005, (0.30 * x, 0, z), one_of(rng, GREY, SKY))
    return Thing((body, field, power, ring))


def tape(rng: Rng) -> Thing:
    """A ring."""
    r, thick, h = rng.uniform(0.036, 0.046), rng.uniform(0.012, 0.017), rng.uniform(0.018, 0.045)
    rgb = one_of(rng, (0.72, 0.55, 0.28), (0.85, 0.80, 0.50), SKY, (0.15, 0.15, 0.15))
    side = 2 * (r + thick / 2) * math.tan(math.pi / 6)
    parts = []
    for k in range(6):
        angle = k * math.pi / 3
        spot = (r * math.cos(angle), r * math.sin(angle), h / 2)
        parts.append(box((thick, side, h), spot, rgb, angle))
    return Thing(tuple(parts))


def knife(rng: Rng) -> Thing:
    """Handle, blade and point."""
    grip, blade, rgb = rng.uniform(0.10, 0.12), rng.uniform(0.11, 0.15), one_of(rng, BLACK, BROWN, RED)
    handle = box((grip, 0.024, 0.016), (-grip / 2, 0, 0.008), rgb)
    ring = box((0.010, 0.026, 0.014), (0.002, 0, 0.008), STEEL)
    steel = box((blade, 0.026, 0.003), (blade / 2, 0.002, 0.008), (0.75, 0.76, 0.78))
    point = box((0.026, 0.016, 0.0026), (blade, 0.004, 0.008), (0.75, 0.76, 0.78), 0.7)
    rivets = [disc(0.006, 0.018, (-share * grip, 0, 0.008), STEEL) for share in (0.3, 0.7)]
    return Thing((handle, ring, steel, point, *rivets))


def wrench(rng: Rng) -> Thing:
    """Shaft, ring head and jaws."""
    length, h, rgb = rng.uniform(0.15, 0.20), rng.uniform(0.008, 0.011), near(STEEL, rng, 0.06)
    shaft = box((length, 0.016, h), (0, 0, h / 2), rgb)
    head = disc(0.034, h + 0.003, (-length / 2, 0, (h + 0.003) / 2), rgb)
    hole = disc(0.016, h + 0.0036, (-length / 2, 0, (h + 0.0036) / 2), BLACK)
    palm = box((0.018, 0.038, h + 0.003), (length / 2, 0, (h + 0.003) / 2), rgb)
    jaws = [box((0.026, 0.011, h + 0.003), (length / 2 + 0.018, side * 0.014, (h + 0.003) / 2), rgb, side * 0.2)
            for side in (-1, 1)]  # fmt: skip
    return Thing((shaft, head, hole, palm, *jaws))


def charger(rng: Rng) -> Thing:
    """A block with pins and a piece of cable."""
    side, rgb = rng.uniform(0.04, 0.05), one_of(rng, WHITE, WHITE, BLACK)
    h = rng.uniform(0.026, 0.032)
    body = box((side, side, h), (0, 0, h / 2), rgb)
    pins = [box((0.02, 0.006, 0.003), (side / 2 + 0.009, y, h / 2), STEEL) for y in (-0.008, 0.008)]
    plug = box((0.016, 0.012, 0.008), (-side / 2 - 0.006, 0, h / 2), near(rgb, rng, 0.05))
    cable = [
        rod((-side / 2 - 0.012, 0, h / 2), (-side / 2 - 0.04, 0.02, 0.004), 0.005, rgb),
        rod((-side / 2 - 0.04, 0.02, 0.004), (-side / 2 - 0.03, 0.07, 0.004), 0.005, rgb),
    ]
    return Thing((body, *pins, plug, *cable))


def pliers(rng: Rng) -> Thing:
    """Two grips, two jaws and a pivot."""
    rgb, length = one_of(rng, RED, SKY, YELLOW, GREEN), rng.uniform(0.09, 0.11)
    open_m, z = rng.uniform(0.024, 0.034), 0.008
    grips = [rod((-0.012, side * 0.008, z), (-length, side * open_m, z), 0.015, rgb) for side in (-1, 1)]
    jaws = [
        box((0.055, 0.012, 0.013), (0.034, side * 0.0075, z), near(GREY, rng, 0.04), side * -0.08) for side in (-1, 1)
    ]
    pivot = disc(0.030, 0.017, (0, 0, 0.0085), GREY)
    bolt = disc(0.012, 0.020, (0, 0, 0.010), STEEL)
    return Thing((*grips, *jaws, pivot, bolt))


def card(rng: Rng) -> Thing:
    """With a stripe and a chip."""
    rgb = colour(rng)
    body = replace(box((0.086, 0.054, 0.0026), (0, 0, 0.0013), rgb), pattern="print", ink_rgb=near(WHITE, rng))
    stripe = box((0.086, 0.010, 0.0005), (0, 0.016, 0.0027), BLACK)
    chip = box((0.012, 0.010, 0.0006), (-0.025, -0.004, 0.0027), (0.80, 0.65, 0.25))
    return Thing((body, stripe, chip))


def paper(rng: Rng) -> Thing:
    """Two sheets, printed."""
    x, y = rng.uniform(0.18, 0.22), rng.uniform(0.13, 0.155)
    low = box((x, y, 0.0018), (0, 0, 0.0009), WHITE)
    top = box((x, y, 0.0012), (0.002, 0.002, 0.0024), WHITE, rng.uniform(-0.06, 0.06))
    return Thing((low, replace(top, pattern="print", ink_rgb=near((0.2, 0.2, 0.25), rng, 0.05))))
