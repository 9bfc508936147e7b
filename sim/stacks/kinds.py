"""The 31 kinds of everyday object in VMRD's order, each made of convex pieces that differ from copy to copy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sim.stacks.pieces import (
    ALONG_X,
    ALONG_Y,
    BLACK,
    STEEL,
    UPRIGHT,
    WHITE,
    Piece,
    Quaternion,
    ball,
    box,
    colour,
    cone,
    disc,
    near,
    one_of,
    rod,
    tube,
)

Rng = np.random.Generator
BROWN, LEATHER, RED, GREEN, YELLOW = (
    (0.55, 0.38, 0.20),
    (0.30, 0.17, 0.09),
    (0.75, 0.10, 0.08),
    (0.35, 0.62, 0.15),
    (0.92, 0.76, 0.12),
)
GREY, SKY = (0.45, 0.46, 0.48), (0.25, 0.45, 0.75)
ON_ITS_SIDE = (ALONG_X, ALONG_Y)


@dataclass(frozen=True)
class Thing:
    """One object.

    Attributes:
        pieces: 2 to 6; z is up where it lies as it usually does.
        stances: ways in which it is set down: world_from_object without place and heading.
    """

    pieces: tuple[Piece, ...]
    stances: tuple[Quaternion, ...] = (UPRIGHT,)


def draw_thing(name: str, rng: Rng) -> Thing:
    """A copy of a kind."""
    return _KINDS[name](rng)


def _box(rng: Rng) -> Thing:
    x, y, z = (float(value) for value in rng.uniform((0.11, 0.08, 0.04), (0.19, 0.13, 0.09)))
    rgb = one_of(rng, BROWN, BROWN, colour(rng))
    body = replace(box((x, y, z), (0, 0, z / 2), rgb), pattern="label", ink_rgb=near(WHITE, rng))
    lid = box((x + 0.004, y + 0.004, 0.014), (0, 0, z - 0.004), near(rgb, rng, 0.06))
    return Thing((body, lid))


def _banana(rng: Rng) -> Thing:
    rgb, radius, thick = (
        one_of(rng, YELLOW, YELLOW, (0.72, 0.74, 0.15)),
        rng.uniform(0.08, 0.11),
        rng.uniform(0.03, 0.036),
    )
    angles = np.linspace(-0.85, 0.85, 5) * rng.uniform(0.85, 1.1)
    spots = [(radius * math.sin(a), radius * (1 - math.cos(a)), thick / 2) for a in angles]
    fat = [0.85, 1.0, 1.0, 0.8]
    bows = [rod(a, b, thick * f, rgb) for a, b, f in zip(spots[:-1], spots[1:], fat, strict=True)]
    x, y, z = spots[-1]
    stem = rod((x, y, z), (x + 0.012, y + 0.018, z), 0.012, (0.35, 0.27, 0.08))
    return Thing((*bows, stem))


def _notebook(rng: Rng) -> Thing:
    x, y, z = (float(value) for value in rng.uniform((0.15, 0.11, 0.010), (0.22, 0.16, 0.020)))
    rgb, cover = colour(rng), 0.0025
    front = replace(box((x, y, cover), (0, 0, z - cover / 2), rgb), pattern="label", ink_rgb=near(WHITE, rng))
    pages = box((x - 0.008, y - 0.008, z - 2 * cover), (0, 0, z / 2), WHITE)
    back = box((x, y, cover), (0, 0, cover / 2), rgb)
    spine = tube(z + 0.003, x, (0, -y / 2, z / 2 + 0.0015), BLACK if rng.random() < 0.6 else STEEL)
    return Thing((front, pages, back, spine))


def _screwdriver(rng: Rng) -> Thing:
    grip, length, d = rng.uniform(0.09, 0.115), rng.uniform(0.08, 0.13), rng.uniform(0.026, 0.034)
    rgb, mid = one_of(rng, RED, YELLOW, SKY, GREEN), d / 2
    handle = replace(tube(d, grip, (-grip / 2, 0, mid), rgb), pattern="stripes", ink_rgb=near(BLACK, rng))
    collar = tube(0.7 * d, 0.018, (0.005, 0, mid), BLACK)
    shaft = tube(0.008, length, (length / 2, 0, mid), STEEL)
    tip = box((0.012, 0.010, 0.003), (length + 0.003, 0, mid), GREY)
    end = ball((0.02, d * 0.96, d * 0.96), (-grip, 0, mid), rgb)
    return Thing((handle, collar, shaft, tip, end))


def _toothpaste(rng: Rng) -> Thing:
    length, wide, thick = rng.uniform(0.11, 0.15), rng.uniform(0.045, 0.055), rng.uniform(0.026, 0.034)
    ink, mid = one_of(rng, RED, SKY, GREEN), thick / 2
    body = box((length, wide, 0.7 * thick), (0, 0, 0.35 * thick), WHITE)
    body = replace(body, pattern="stripes", ink_rgb=ink)
    belly = ball((length * 0.9, wide * 0.95, thick), (0.01, 0, 0.62 * thick), near(WHITE, rng, 0.03))
    crimp = box((0.014, wide + 0.006, 0.006), (-length / 2, 0, mid), ink)
    cap = tube(0.026, 0.024, (length / 2 + 0.012, 0, mid), one_of(rng, WHITE, ink))
    return Thing((body, belly, crimp, cap))


def _apple(rng: Rng) -> Thing:
    d, rgb = rng.uniform(0.065, 0.085), one_of(rng, RED, RED, GREEN, (0.85, 0.65, 0.20))
    body = replace(ball((d, d, 0.9 * d), (0, 0, 0.45 * d), rgb), pattern="speckles", ink_rgb=near(YELLOW, rng))
    dent = disc(0.3 * d, 0.004, (0, 0, 0.885 * d), near((0.25, 0.30, 0.08), rng, 0.03))
    foot = disc(0.45 * d, 0.006, (0, 0, 0.005), rgb)
    stem = rod((0, 0, 0.87 * d), (0.005, 0.003, 1.08 * d), 0.005, BROWN)
    return Thing((body, dent, foot, stem))


def _stapler(rng: Rng) -> Thing:
    length, wide, rgb = rng.uniform(0.12, 0.15), rng.uniform(0.030, 0.038), one_of(rng, BLACK, SKY, RED, GREEN)
    base = box((length, wide, 0.010), (0, 0, 0.005), near(BLACK, rng, 0.03))
    rail = box((0.9 * length, 0.5 * wide, 0.014), (0, 0, 0.024), STEEL)
    arm = box((length, 0.8 * wide, 0.016), (0, 0, 0.038), rgb)
    hinge = box((0.025, 0.8 * wide, 0.042), (-0.42 * length, 0, 0.022), rgb)
    nose = ball((0.05, 0.8 * wide, 0.018), (0.40 * length, 0, 0.045), rgb)
    return Thing((base, rail, arm, hinge, nose))


def _mobile_phone(rng: Rng) -> Thing:
    x, y, z = rng.uniform(0.135, 0.16), rng.uniform(0.066, 0.076), rng.uniform(0.008, 0.011)
    body = box((x, y, z), (0, 0, z / 2), one_of(rng, BLACK, BLACK, STEEL))
    lit = one_of(rng, BLACK, (0.05, 0.10, 0.25), colour(rng))
    screen = replace(box((x - 0.018, y - 0.006, 0.0012), (0, 0, z), lit), pattern="dots", ink_rgb=colour(rng))
    button = disc(0.010, 0.0016, (x / 2 - 0.005, 0, z), GREY)
    return Thing((body, screen, button))


def _bottle(rng: Rng) -> Thing:
    d, h = rng.uniform(0.058, 0.072), rng.uniform(0.11, 0.15)
    rgb = one_of(rng, (0.55, 0.75, 0.85), (0.15, 0.40, 0.20), (0.45, 0.25, 0.08))
    body = disc(d, h, (0, 0, h / 2), rgb)
    label = replace(disc(d + 0.002, 0.45 * h, (0, 0, 0.5 * h), colour(rng)), pattern="label", ink_rgb=near(WHITE, rng))
    shoulder = cone(d, 0.026, 0.035, (0, 0, h + 0.0175), rgb)
    neck = disc(0.026, 0.02, (0, 0, h + 0.042), rgb)
    cap = disc(0.032, 0.018, (0, 0, h + 0.056), one_of(rng, WHITE, RED, SKY))
    return Thing((body, label, shoulder, neck, cap), (UPRIGHT, *ON_ITS_SIDE, *ON_ITS_SIDE))


def _pen(rng: Rng) -> Thing:
    d, length, rgb = rng.uniform(0.009, 0.013), rng.uniform(0.12, 0.14), one_of(rng, SKY, BLACK, RED, WHITE)
    body = tube(d, length, (0, 0, d / 2), rgb)
    cap = tube(d + 0.003, 0.4 * length, (-0.3 * length, 0, d / 2), near(rgb, rng))
    tip = tube(0.005, 0.018, (length / 2 + 0.008, 0, d / 2), STEEL)
    clip = box((0.3 * length, 0.003, 0.003), (-0.32 * length, 0, d + 0.002), STEEL)
    return Thing((body, cap, tip, clip))


def _mouse(rng: Rng) -> Thing:
    x, y, z = rng.uniform(0.095, 0.115), rng.uniform(0.055, 0.065), rng.uniform(0.034, 0.042)
    rgb = one_of(rng, BLACK, GREY, WHITE)
    base = box((0.8 * x, 0.8 * y, 0.010), (0, 0, 0.005), BLACK)
    shell = ball((x, y, 0.96 * z), (0, 0, 0.52 * z), rgb)
    wheel = disc(0.02, 0.008, (0.28 * x, 0, 0.80 * z), one_of(rng, GREY, RED))
    wheel = replace(wheel, turn=ALONG_Y)
    seam = box((0.3 * x, 0.003, 0.006), (0.28 * x, 0, 0.88 * z), BLACK)
    return Thing((base, shell, wheel, seam))


def _umbrella(rng: Rng) -> Thing:
    length, d, rgb = rng.uniform(0.19, 0.25), rng.uniform(0.040, 0.052), colour(rng, 0.2, 0.7)
    body = replace(tube(d, length, (0, 0, d / 2), rgb), pattern="stripes", ink_rgb=near(rgb, rng, 0.15))
    strap = tube(d + 0.004, 0.018, (0.15 * length, 0, d / 2), near(BLACK, rng, 0.05))
    top = ball((0.05, d, d), (length / 2, 0, d / 2), rgb)
    shaft = tube(0.012, 0.03, (-length / 2 - 0.01, 0, d / 2), STEEL)
    grip = tube(0.028, 0.06, (-length / 2 - 0.05, 0, d / 2), one_of(rng, BLACK, BROWN))
    return Thing((body, strap, top, shaft, grip))


def _remote(rng: Rng) -> Thing:
    x, y, z = rng.uniform(0.16, 0.20), rng.uniform(0.042, 0.050), rng.uniform(0.018, 0.024)
    rgb = one_of(rng, BLACK, GREY, (0.75, 0.75, 0.76))
    body = box((x, y, z), (0, 0, z / 2), rgb)
    field = box((0.66 * x, 0.8 * y, 0.0024), (-0.08 * x, 0, z), near(rgb, rng, 0.03))
    field = replace(field, pattern="keys", ink_rgb=near(WHITE, rng) if sum(rgb) < 1.4 else near(BLACK, rng, 0.03))
    power = disc(0.012, 0.006, (0.40 * x, 0.2 * y, z), RED)
    ring = disc(0.026, 0.005, (0.30 * x, 0, z), one_of(rng, GREY, SKY))
    return Thing((body, field, power, ring))


def _can(rng: Rng) -> Thing:
    d, h = rng.uniform(0.060, 0.070), rng.uniform(0.09, 0.12)
    body = replace(disc(d, h, (0, 0, h / 2), colour(rng)), pattern="stripes", ink_rgb=colour(rng))
    rim = disc(0.9 * d, h + 0.006, (0, 0, h / 2), STEEL)
    tab = box((0.022, 0.012, 0.003), (0.004, 0, h + 0.004), near(STEEL, rng, 0.1))
    return Thing((body, rim, tab), (UPRIGHT, UPRIGHT, *ON_ITS_SIDE))


def _tape(rng: Rng) -> Thing:
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


def _knife(rng: Rng) -> Thing:
    grip, blade, rgb = rng.uniform(0.10, 0.12), rng.uniform(0.11, 0.15), one_of(rng, BLACK, BROWN, RED)
    handle = box((grip, 0.024, 0.016), (-grip / 2, 0, 0.008), rgb)
    ring = box((0.010, 0.026, 0.014), (0.002, 0, 0.008), STEEL)
    steel = box((blade, 0.026, 0.003), (blade / 2, 0.002, 0.008), (0.75, 0.76, 0.78))
    point = box((0.026, 0.016, 0.0026), (blade, 0.004, 0.008), (0.75, 0.76, 0.78), 0.7)
    rivets = [disc(0.006, 0.018, (-share * grip, 0, 0.008), STEEL) for share in (0.3, 0.7)]
    return Thing((handle, ring, steel, point, *rivets))


def _wrench(rng: Rng) -> Thing:
    length, h, rgb = rng.uniform(0.15, 0.20), rng.uniform(0.008, 0.011), near(STEEL, rng, 0.06)
    shaft = box((length, 0.016, h), (0, 0, h / 2), rgb)
    head = disc(0.034, h + 0.003, (-length / 2, 0, (h + 0.003) / 2), rgb)
    hole = disc(0.016, h + 0.0036, (-length / 2, 0, (h + 0.0036) / 2), BLACK)
    palm = box((0.018, 0.038, h + 0.003), (length / 2, 0, (h + 0.003) / 2), rgb)
    jaws = [box((0.026, 0.011, h + 0.003), (length / 2 + 0.018, side * 0.014, (h + 0.003) / 2), rgb, side * 0.2)
            for side in (-1, 1)]  # fmt: skip
    return Thing((shaft, head, hole, palm, *jaws))


def _cup(rng: Rng) -> Thing:
    d, h, rgb = rng.uniform(0.072, 0.088), rng.uniform(0.08, 0.10), one_of(rng, WHITE, SKY, RED, YELLOW)
    body = replace(disc(d, h, (0, 0, h / 2), rgb), pattern="dots", ink_rgb=colour(rng))
    inside = disc(0.86 * d, 0.003, (0, 0, h), (0.10, 0.06, 0.04))
    out, mid = d / 2 + 0.026, d / 2 - 0.004
    high, low = 0.78 * h, 0.25 * h
    handle = [
        rod((mid, 0, high), (out, 0, high - 0.006), 0.010, rgb),
        rod((out, 0, high - 0.006), (out, 0, low + 0.006), 0.010, rgb),
        rod((out, 0, low + 0.006), (mid, 0, low), 0.010, rgb),
    ]
    return Thing((body, inside, *handle), (UPRIGHT, UPRIGHT, ALONG_Y))


def _charger(rng: Rng) -> Thing:
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


def _badminton(rng: Rng) -> Thing:
    """A shuttlecock, lying."""
    wide, length = rng.uniform(0.060, 0.068), rng.uniform(0.055, 0.065)
    feathers = Piece("cone", (0.026, wide, length), (0, 0, 0.0), near(WHITE, rng, 0.03), ALONG_X, "stripes", GREY)
    band = tube(0.034, 0.006, (-0.15 * length, 0, 0), one_of(rng, GREEN, SKY, RED))
    cork = ball((0.034, 0.027, 0.027), (-length / 2 - 0.006, 0, 0), one_of(rng, (0.85, 0.75, 0.55), WHITE))
    return Thing((feathers, band, cork), (UPRIGHT, (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)))


def _wallet(rng: Rng) -> Thing:
    x, y, z = rng.uniform(0.10, 0.12), rng.uniform(0.08, 0.095), rng.uniform(0.009, 0.013)
    rgb = one_of(rng, LEATHER, BROWN, BLACK, (0.35, 0.08, 0.10))
    low = replace(box((x, y, z), (0, 0, z / 2), rgb), pattern="grain", ink_rgb=near(BLACK, rng, 0.03))
    high = replace(box((x, y - 0.004, z), (0, 0.002, 1.5 * z), rgb), pattern="grain", ink_rgb=near(BLACK, rng, 0.03))
    fold = replace(tube(2 * z, x, (0, y / 2, z), rgb), pattern="grain")
    clasp = box((0.022, 0.030, 0.003), (0, -y / 2 + 0.012, 2 * z + 0.001), near(rgb, rng, 0.05))
    stud = disc(0.010, 0.004, (0, -y / 2 + 0.016, 2 * z + 0.003), STEEL)
    return Thing((low, high, fold, clasp, stud))


def _wrist_developer(rng: Rng) -> Thing:
    """Two grips in a V and a spring."""
    length, d, open_m = rng.uniform(0.09, 0.11), rng.uniform(0.024, 0.030), rng.uniform(0.034, 0.045)
    rgb, z = colour(rng), d / 2
    grips = [rod((0.03, side * 0.022, z), (0.03 + length, side * open_m, z), d, rgb) for side in (-1, 1)]
    grips = [replace(grip, pattern="stripes", ink_rgb=near(BLACK, rng, 0.03)) for grip in grips]
    wires = [rod((-0.012, side * 0.010, z), (0.04, side * 0.022, z), 0.008, STEEL) for side in (-1, 1)]
    spring = disc(0.032, 0.018, (-0.012, 0, z), STEEL)
    return Thing((*grips, *wires, spring))


def _glasses(rng: Rng) -> Thing:
    rgb, lens = one_of(rng, BLACK, LEATHER, RED), one_of(rng, (0.12, 0.13, 0.15), (0.70, 0.78, 0.80))
    wide, d = rng.uniform(0.030, 0.036), rng.uniform(0.044, 0.052)
    z, arm = d / 2, rng.uniform(0.11, 0.13)
    lenses = [Piece("cylinder", (d, d, 0.006), (0, side * wide, z), lens, ALONG_X, "plain") for side in (-1, 1)]
    bridge = rod((0.002, -0.010, z + 0.008), (0.002, 0.010, z + 0.008), 0.006, rgb)
    brow = box((0.008, 2 * wide + d, 0.008), (0, 0, d - 0.004), rgb)
    arms = [rod((0, side * (wide + d / 2), d - 0.004), (arm, side * (wide + d / 2 - 0.004), 0.004), 0.006, rgb)
            for side in (-1, 1)]  # fmt: skip
    return Thing((*lenses, bridge, brow, *arms))


def _pliers(rng: Rng) -> Thing:
    rgb, length = one_of(rng, RED, SKY, YELLOW, GREEN), rng.uniform(0.09, 0.11)
    open_m, z = rng.uniform(0.024, 0.034), 0.008
    grips = [rod((-0.012, side * 0.008, z), (-length, side * open_m, z), 0.015, rgb) for side in (-1, 1)]
    jaws = [
        box((0.055, 0.012, 0.013), (0.034, side * 0.0075, z), near(GREY, rng, 0.04), side * -0.08) for side in (-1, 1)
    ]
    pivot = disc(0.030, 0.017, (0, 0, 0.0085), GREY)
    bolt = disc(0.012, 0.020, (0, 0, 0.010), STEEL)
    return Thing((*grips, *jaws, pivot, bolt))


def _headset(rng: Rng) -> Thing:
    """Lying: a band between two ear cups."""
    rgb, half, d = one_of(rng, BLACK, WHITE, RED, SKY), rng.uniform(0.062, 0.074), rng.uniform(0.06, 0.07)
    z, up = 0.014, rng.uniform(0.10, 0.12)
    cups = [
        Piece("cylinder", (d, d, 0.026), (0, side * half, d / 2), near(BLACK, rng, 0.04), ALONG_Y) for side in (-1, 1)
    ]
    spots = [(0, -half, d / 2), (0.6 * up, -0.85 * half, z), (up, 0, z), (0.6 * up, 0.85 * half, z), (0, half, d / 2)]
    bows = [rod(a, b, 0.012, rgb) for a, b in pairwise(spots)]
    return Thing((*cups, *bows))


def _toothbrush(rng: Rng) -> Thing:
    rgb, length = colour(rng), rng.uniform(0.15, 0.18)
    grip = rod((-length / 2, 0, 0.006), (0.05, 0, 0.006), 0.012, rgb)
    neck = rod((0.05, 0, 0.006), (length / 2, 0, 0.006), 0.007, rgb)
    head = box((0.030, 0.013, 0.006), (length / 2, 0, 0.006), near(WHITE, rng, 0.03))
    hairs = replace(box((0.026, 0.011, 0.012), (length / 2, 0, 0.014), WHITE), pattern="stripes", ink_rgb=colour(rng))
    pad = box((0.035, 0.008, 0.004), (-0.02, 0, 0.012), one_of(rng, WHITE, colour(rng)))
    return Thing((grip, neck, head, hairs, pad))


def _card(rng: Rng) -> Thing:
    rgb = colour(rng)
    body = replace(box((0.086, 0.054, 0.0026), (0, 0, 0.0013), rgb), pattern="print", ink_rgb=near(WHITE, rng))
    stripe = box((0.086, 0.010, 0.0005), (0, 0.016, 0.0027), BLACK)
    chip = box((0.012, 0.010, 0.0006), (-0.025, -0.004, 0.0027), (0.80, 0.65, 0.25))
    return Thing((body, stripe, chip))


def _paper(rng: Rng) -> Thing:
    x, y = rng.uniform(0.18, 0.22), rng.uniform(0.13, 0.155)
    low = box((x, y, 0.0018), (0, 0, 0.0009), WHITE)
    top = box((x, y, 0.0012), (0.002, 0.002, 0.0024), WHITE, rng.uniform(-0.06, 0.06))
    return Thing((low, replace(top, pattern="print", ink_rgb=near((0.2, 0.2, 0.25), rng, 0.05))))


def _towel(rng: Rng) -> Thing:
    x, y, z = rng.uniform(0.15, 0.20), rng.uniform(0.10, 0.14), rng.uniform(0.012, 0.017)
    rgb, ink = near(colour(rng, 0.6, 0.95), rng), one_of(rng, WHITE, colour(rng))
    rgb = tuple(0.5 + 0.5 * value for value in rgb)  # type: ignore[assignment]
    layers = [
        replace(box((x, y, z), (0, 0, (k + 0.5) * z), rgb), pattern=("speckles", "stripes")[k], ink_rgb=ink)
        for k in range(2)
    ]
    fold = replace(tube(2 * z, x, (0, -y / 2, z), rgb), pattern="speckles", ink_rgb=ink)
    return Thing((*layers, fold))


def _shaver(rng: Rng) -> Thing:
    length, d, rgb = rng.uniform(0.09, 0.11), rng.uniform(0.040, 0.048), one_of(rng, BLACK, SKY, GREY)
    body = box((length, 0.8 * d, 0.7 * d), (-0.01, 0, 0.35 * d), rgb)
    belly = ball((length, d, 0.9 * d), (-0.01, 0, 0.50 * d), near(rgb, rng, 0.05))
    neck = box((0.03, 1.1 * d, 0.5 * d), (length / 2, 0, 0.45 * d), near(BLACK, rng, 0.03))
    blades = [
        disc(0.026, 0.010, (length / 2 + dx, dy, 0.72 * d), STEEL)
        for dx, dy in ((0.006, -0.013), (0.006, 0.013), (-0.016, 0))
    ]
    return Thing((body, belly, neck, *blades))


def _watch(rng: Rng) -> Thing:
    d, rgb = rng.uniform(0.038, 0.046), one_of(rng, BLACK, LEATHER, SKY, STEEL)
    case = disc(d, 0.011, (0, 0, 0.0055), one_of(rng, STEEL, (0.80, 0.65, 0.25), BLACK))
    dial = replace(
        disc(0.82 * d, 0.001, (0, 0, 0.0115), one_of(rng, WHITE, BLACK, SKY)), pattern="checks", ink_rgb=GREY
    )
    straps = [box((0.085, 0.022, 0.004), (side * (d / 2 + 0.038), 0, 0.003), rgb) for side in (-1, 1)]
    crown = disc(0.006, 0.006, (0, d / 2 + 0.002, 0.006), STEEL)
    buckle = box((0.012, 0.027, 0.005), (d / 2 + 0.078, 0, 0.0035), STEEL)
    return Thing((case, dial, *straps, crown, buckle))


_KINDS: dict[str, Callable[[Rng], Thing]] = {
    "box": _box,
    "banana": _banana,
    "notebook": _notebook,
    "screwdriver": _screwdriver,
    "toothpaste": _toothpaste,
    "apple": _apple,
    "stapler": _stapler,
    "mobile phone": _mobile_phone,
    "bottle": _bottle,
    "pen": _pen,
    "mouse": _mouse,
    "umbrella": _umbrella,
    "remote controller": _remote,
    "cans": _can,
    "tape": _tape,
    "knife": _knife,
    "wrench": _wrench,
    "cup": _cup,
    "charger": _charger,
    "badminton": _badminton,
    "wallet": _wallet,
    "wrist developer": _wrist_developer,
    "glasses": _glasses,
    "pliers": _pliers,
    "headset": _headset,
    "toothbrush": _toothbrush,
    "card": _card,
    "paper": _paper,
    "towel": _towel,
    "shaver": _shaver,
    "watch": _watch,
}
KINDS = tuple(_KINDS)
