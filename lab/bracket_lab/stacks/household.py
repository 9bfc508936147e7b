"""Things of kitchen, bathroom and wardrobe, each made anew with other sizes and colours."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from bracket_sim.stacks.pieces import (
    ALONG_X,
    ALONG_Y,
    BLACK,
    BROWN,
    GREEN,
    GREY,
    LEATHER,
    ON_ITS_SIDE,
    RED,
    SKY,
    STEEL,
    UPRIGHT,
    WHITE,
    YELLOW,
    Piece,
    Rng,
    Thing,
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


def carton(rng: Rng) -> Thing:
    """A carton with its lid."""
    x, y, z = (float(value) for value in rng.uniform((0.11, 0.08, 0.04), (0.19, 0.13, 0.09)))
    rgb = one_of(rng, BROWN, BROWN, colour(rng))
    body = replace(box((x, y, z), (0, 0, z / 2), rgb), pattern="label", ink_rgb=near(WHITE, rng))
    lid = box((x + 0.004, y + 0.004, 0.014), (0, 0, z - 0.004), near(rgb, rng, 0.06))
    return Thing((body, lid))


def banana(rng: Rng) -> Thing:
    """A bow of bars, and its stem."""
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


def toothpaste(rng: Rng) -> Thing:
    """A tube with crimp and cap."""
    length, wide, thick = rng.uniform(0.11, 0.15), rng.uniform(0.045, 0.055), rng.uniform(0.026, 0.034)
    ink, mid = one_of(rng, RED, SKY, GREEN), thick / 2
    body = box((length, wide, 0.7 * thick), (0, 0, 0.35 * thick), WHITE)
    body = replace(body, pattern="stripes", ink_rgb=ink)
    belly = ball((length * 0.9, wide * 0.95, thick), (0.01, 0, 0.62 * thick), near(WHITE, rng, 0.03))
    crimp = box((0.014, wide + 0.006, 0.006), (-length / 2, 0, mid), ink)
    cap = tube(0.026, 0.024, (length / 2 + 0.012, 0, mid), one_of(rng, WHITE, ink))
    return Thing((body, belly, crimp, cap))


def apple(rng: Rng) -> Thing:
    """With foot and stem."""
    d, rgb = rng.uniform(0.065, 0.085), one_of(rng, RED, RED, GREEN, (0.85, 0.65, 0.20))
    body = replace(ball((d, d, 0.9 * d), (0, 0, 0.45 * d), rgb), pattern="speckles", ink_rgb=near(YELLOW, rng))
    dent = disc(0.3 * d, 0.004, (0, 0, 0.885 * d), near((0.25, 0.30, 0.08), rng, 0.03))
    foot = disc(0.45 * d, 0.006, (0, 0, 0.005), rgb)
    stem = rod((0, 0, 0.87 * d), (0.005, 0.003, 1.08 * d), 0.005, BROWN)
    return Thing((body, dent, foot, stem))


def bottle(rng: Rng) -> Thing:
    """Body, label, shoulder, neck and cap."""
    d, h = rng.uniform(0.058, 0.072), rng.uniform(0.11, 0.15)
    rgb = one_of(rng, (0.55, 0.75, 0.85), (0.15, 0.40, 0.20), (0.45, 0.25, 0.08))
    body = disc(d, h, (0, 0, h / 2), rgb)
    label = replace(disc(d + 0.002, 0.45 * h, (0, 0, 0.5 * h), colour(rng)), pattern="label", ink_rgb=near(WHITE, rng))
    shoulder = cone(d, 0.026, 0.035, (0, 0, h + 0.0175), rgb)
    neck = disc(0.026, 0.02, (0, 0, h + 0.042), rgb)
    cap = disc(0.032, 0.018, (0, 0, h + 0.056), one_of(rng, WHITE, RED, SKY))
    return Thing((body, label, shoulder, neck, cap), (UPRIGHT, *ON_ITS_SIDE, *ON_ITS_SIDE))


def umbrella(rng: Rng) -> Thing:
    """Folded, with strap and grip."""
    length, d, rgb = rng.uniform(0.19, 0.25), rng.uniform(0.040, 0.052), colour(rng, 0.2, 0.7)
    body = replace(tube(d, length, (0, 0, d / 2), rgb), pattern="stripes", ink_rgb=near(rgb, rng, 0.15))
    strap = tube(d + 0.004, 0.018, (0.15 * length, 0, d / 2), near(BLACK, rng, 0.05))
    top = ball((0.05, d, d), (length / 2, 0, d / 2), rgb)
    shaft = tube(0.012, 0.03, (-length / 2 - 0.01, 0, d / 2), STEEL)
    grip = tube(0.028, 0.06, (-length / 2 - 0.05, 0, d / 2), one_of(rng, BLACK, BROWN))
    return Thing((body, strap, top, shaft, grip))


def can(rng: Rng) -> Thing:
    """A cylinder with rims and a tab."""
    d, h = rng.uniform(0.060, 0.070), rng.uniform(0.09, 0.12)
    body = replace(disc(d, h, (0, 0, h / 2), colour(rng)), pattern="stripes", ink_rgb=colour(rng))
    rim = disc(0.9 * d, h + 0.006, (0, 0, h / 2), STEEL)
    tab = box((0.022, 0.012, 0.003), (0.004, 0, h + 0.004), near(STEEL, rng, 0.1))
    return Thing((body, rim, tab), (UPRIGHT, UPRIGHT, *ON_ITS_SIDE))


def cup(rng: Rng) -> Thing:
    """With a handle of three bars."""
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


def badminton(rng: Rng) -> Thing:
    """A shuttlecock, lying."""
    wide, length = rng.uniform(0.060, 0.068), rng.uniform(0.055, 0.065)
    feathers = Piece("cone", (0.026, wide, length), (0, 0, 0.0), near(WHITE, rng, 0.03), ALONG_X, "stripes", GREY)
    band = tube(0.034, 0.006, (-0.15 * length, 0, 0), one_of(rng, GREEN, SKY, RED))
    cork = ball((0.034, 0.027, 0.027), (-length / 2 - 0.006, 0, 0), one_of(rng, (0.85, 0.75, 0.55), WHITE))
    return Thing((feathers, band, cork), (UPRIGHT, (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)))


def wallet(rng: Rng) -> Thing:
    """Folded leather with a clasp."""
    x, y, z = rng.uniform(0.10, 0.12), rng.uniform(0.08, 0.095), rng.uniform(0.009, 0.013)
    rgb = one_of(rng, LEATHER, BROWN, BLACK, (0.35, 0.08, 0.10))
    low = replace(box((x, y, z), (0, 0, z / 2), rgb), pattern="grain", ink_rgb=near(BLACK, rng, 0.03))
    high = replace(box((x, y - 0.004, z), (0, 0.002, 1.5 * z), rgb), pattern="grain", ink_rgb=near(BLACK, rng, 0.03))
    fold = replace(tube(2 * z, x, (0, y / 2, z), rgb), pattern="grain")
    clasp = box((0.022, 0.030, 0.003), (0, -y / 2 + 0.012, 2 * z + 0.001), near(rgb, rng, 0.05))
    stud = disc(0.010, 0.004, (0, -y / 2 + 0.016, 2 * z + 0.003), STEEL)
    return Thing((low, high, fold, clasp, stud))


def wrist_developer(rng: Rng) -> Thing:
    """Two grips in a V and a spring."""
    length, d, open_m = rng.uniform(0.09, 0.11), rng.uniform(0.024, 0.030), rng.uniform(0.034, 0.045)
    rgb, z = colour(rng), d / 2
    grips = [rod((0.03, side * 0.022, z), (0.03 + length, side * open_m, z), d, rgb) for side in (-1, 1)]
    grips = [replace(grip, pattern="stripes", ink_rgb=near(BLACK, rng, 0.03)) for grip in grips]
    wires = [rod((-0.012, side * 0.010, z), (0.04, side * 0.022, z), 0.008, STEEL) for side in (-1, 1)]
    spring = disc(0.032, 0.018, (-0.012, 0, z), STEEL)
    return Thing((*grips, *wires, spring))


def glasses(rng: Rng) -> Thing:
    """Two lenses, brow and arms."""
    rgb, lens = one_of(rng, BLACK, LEATHER, RED), one_of(rng, (0.12, 0.13, 0.15), (0.70, 0.78, 0.80))
    wide, d = rng.uniform(0.030, 0.036), rng.uniform(0.044, 0.052)
    z, arm = d / 2, rng.uniform(0.11, 0.13)
    lenses = [Piece("cylinder", (d, d, 0.006), (0, side * wide, z), lens, ALONG_X, "plain") for side in (-1, 1)]
    bridge = rod((0.002, -0.010, z + 0.008), (0.002, 0.010, z + 0.008), 0.006, rgb)
    brow = box((0.008, 2 * wide + d, 0.008), (0, 0, d - 0.004), rgb)
    arms = [rod((0, side * (wide + d / 2), d - 0.004), (arm, side * (wide + d / 2 - 0.004), 0.004), 0.006, rgb)
            for side in (-1, 1)]  # fmt: skip
    return Thing((*lenses, bridge, brow, *arms))


def headset(rng: Rng) -> Thing:
    """Lying: a band between two ear cups."""
    rgb, half, d = one_of(rng, BLACK, WHITE, RED, SKY), rng.uniform(0.062, 0.074), rng.uniform(0.06, 0.07)
    z, up = 0.014, rng.uniform(0.10, 0.12)
    cups = [
        Piece("cylinder", (d, d, 0.026), (0, side * half, d / 2), near(BLACK, rng, 0.04), ALONG_Y) for side in (-1, 1)
    ]
    spots = [(0, -half, d / 2), (0.6 * up, -0.85 * half, z), (up, 0, z), (0.6 * up, 0.85 * half, z), (0, half, d / 2)]
    bows = [rod(a, b, 0.012, rgb) for a, b in pairwise(spots)]
    return Thing((*cups, *bows))


def toothbrush(rng: Rng) -> Thing:
    """Grip, neck, head and hairs."""
    rgb, length = colour(rng), rng.uniform(0.15, 0.18)
    grip = rod((-length / 2, 0, 0.006), (0.05, 0, 0.006), 0.012, rgb)
    neck = rod((0.05, 0, 0.006), (length / 2, 0, 0.006), 0.007, rgb)
    head = box((0.030, 0.013, 0.006), (length / 2, 0, 0.006), near(WHITE, rng, 0.03))
    hairs = replace(box((0.026, 0.011, 0.012), (length / 2, 0, 0.014), WHITE), pattern="stripes", ink_rgb=colour(rng))
    pad = box((0.035, 0.008, 0.004), (-0.02, 0, 0.012), one_of(rng, WHITE, colour(rng)))
    return Thing((grip, neck, head, hairs, pad))


def towel(rng: Rng) -> Thing:
    """Folded once."""
    x, y, z = rng.uniform(0.15, 0.20), rng.uniform(0.10, 0.14), rng.uniform(0.012, 0.017)
    rgb, ink = near(colour(rng, 0.6, 0.95), rng), one_of(rng, WHITE, colour(rng))
    rgb = tuple(0.5 + 0.5 * value for value in rgb)  # type: ignore[assignment]
    layers = [
        replace(box((x, y, z), (0, 0, (k + 0.5) * z), rgb), pattern=("speckles", "stripes")[k], ink_rgb=ink)
        for k in range(2)
    ]
    fold = replace(tube(2 * z, x, (0, -y / 2, z), rgb), pattern="speckles", ink_rgb=ink)
    return Thing((*layers, fold))


def shaver(rng: Rng) -> Thing:
    """A body with three round blades."""
    length, d, rgb = rng.uniform(0.09, 0.11), rng.uniform(0.040, 0.048), one_of(rng, BLACK, SKY, GREY)
    body = box((length, 0.8 * d, 0.7 * d), (-0.01, 0, 0.35 * d), rgb)
    belly = ball((length, d, 0.9 * d), (-0.01, 0, 0.50 * d), near(rgb, rng, 0.05))
    neck = box((0.03, 1.1 * d, 0.5 * d), (length / 2, 0, 0.45 * d), near(BLACK, rng, 0.03))
    blades = [
        disc(0.026, 0.010, (length / 2 + dx, dy, 0.72 * d), STEEL)
        for dx, dy in ((0.006, -0.013), (0.006, 0.013), (-0.016, 0))
    ]
    return Thing((body, belly, neck, *blades))


def watch(rng: Rng) -> Thing:
    """Case, dial and straps."""
    d, rgb = rng.uniform(0.038, 0.046), one_of(rng, BLACK, LEATHER, SKY, STEEL)
    case = disc(d, 0.011, (0, 0, 0.0055), one_of(rng, STEEL, (0.80, 0.65, 0.25), BLACK))
    dial = replace(
        disc(0.82 * d, 0.001, (0, 0, 0.0115), one_of(rng, WHITE, BLACK, SKY)), pattern="checks", ink_rgb=GREY
    )
    straps = [box((0.085, 0.022, 0.004), (side * (d / 2 + 0.038), 0, 0.003), rgb) for side in (-1, 1)]
    crown = disc(0.006, 0.006, (0, d / 2 + 0.002, 0.006), STEEL)
    buckle = box((0.012, 0.027, 0.005), (d / 2 + 0.078, 0, 0.0035), STEEL)
    return Thing((case, dial, *straps, crown, buckle))
