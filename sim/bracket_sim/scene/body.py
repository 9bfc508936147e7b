"""The person's body as a look has it: the size and side of the working hand, the other hand, head and shoulders."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene import human_hand as human
from bracket_sim.scene import human_skin
from bracket_sim.scene.look import Appearance
from bracket_sim.scene.palette import NO_TOUCH, Rgb

SECOND_HAND_M = (1.13, -0.32)  # where its knuckles lie on the table
FLAT_WRIST_M = 0.05
FLAT_PALM = (4.0, 0.0, 0.0, 0.0, 0.0, 0.022)  # as in human_hand.py, the wrist over the body's origin
PALM_M = (0.045, 0.040, 0.013)  # half axes
PALM_HEIGHT_M = 0.016
FINGERS = ((-0.030, 0.070), (-0.010, 0.082), (0.011, 0.076), (0.030, 0.058))  # (aside, length), index finger first
FINGER_RADIUS_M = 0.0085
SPLAY_RAD = 0.10  # of a finger for each centimetre that it is aside
THUMB_M = ((0.050, -0.034), (0.000, -0.072))  # root and tip
FOREARM_M = 0.24
HEAD_HEIGHT_M = 0.42
HEAD_M = (0.095, 0.075, 0.11)  # half axes; the face looks along -x
SHOULDERS_M = (0.09, 0.20, 0.06)
HAIRS: tuple[Rgb, ...] = ((0.06, 0.05, 0.04), (0.20, 0.13, 0.08), (0.42, 0.32, 0.18), (0.45, 0.44, 0.42))
HAND = "hand"  # all bodies of the hand begin so
ACROSS = 1  # the axis that a left hand mirrors: y
SLEEVE_M = 0.3  # what reaches further back than this is the sleeve; its end stays out of sight


def add_onlooker(spec: mujoco.MjSpec, bench: Bench, person: Appearance) -> None:
    """Add what a look shows of the person beside the hand that works."""
    if person.second_hand and person.hand == "human":
        x, y = SECOND_HAND_M
        body = spec.worldbody.add_body(name="second_hand", pos=[x + FLAT_WRIST_M, y, 0.0])
        lying = np.array((*FLAT_PALM, *human.FLAT))
        human_skin.add_skin(spec, body, person, lying, left=not person.left_hand, gloved=False)
    elif person.second_hand:
        _add_second_hand(spec.worldbody, person)
    if person.lean_m > 0:
        _add_head(spec.worldbody, bench, person)


def _add_second_hand(world: mujoco.MjsBody, person: Appearance) -> None:
    """A hand that lies flat, fingers along -x; a left one where the right one works, else the other way round."""
    body = world.add_body(name="second_hand", pos=[*SECOND_HAND_M, 0.0])
    size, side = person.hand_size, 1.0 if person.left_hand else -1.0
    skin, sleeve = person.hand_rgb, person.sleeve_rgb

    def bone(start: tuple[float, float], end: tuple[float, float], radius_m: float, rgb: Rgb) -> None:
        height_m = max(radius_m, PALM_HEIGHT_M * 0.8)
        points = [(size * x, size * side * y, size * height_m) for x, y in (start, end)]
        _capsule(body, points[0], points[1], size * radius_m, rgb)

    _ellipsoid(body, (0.045 * size, 0.0, PALM_HEIGHT_M * size), tuple(size * half for half in PALM_M), skin)
    for aside_m, length_m in FINGERS:
        splay = SPLAY_RAD * aside_m / 0.01
        tip = (-length_m * math.cos(splay), aside_m + length_m * math.sin(splay))
        bone((0.02, aside_m), tip, FINGER_RADIUS_M, skin)
    bone(*THUMB_M, 0.010, skin)
    bone((0.08, 0.0), (0.14, 0.0), 0.026, skin)
    bone((0.14, 0.0), (0.14 + FOREARM_M, 0.03), 0.036, sleeve)


def _add_head(world: mujoco.MjsBody, bench: Bench, person: Appearance) -> None:
    """Head and shoulders from above, as far inside the overhead view as the look says."""
    edge_m = view_edge_m(bench, HEAD_HEIGHT_M)
    middle = (edge_m + HEAD_M[0] - person.lean_m, bench.bracket.position_m[1] + person.lean_side_m)
    body = world.add_body(name="head", pos=[*middle, HEAD_HEIGHT_M])
    hair = HAIRS[round(999 * (person.skin_tone + abs(person.lean_side_m))) % len(HAIRS)]
    _ellipsoid(body, (0.0, 0.0, 0.0), HEAD_M, person.skin_rgb)
    _ellipsoid(body, (0.012, 0.0, 0.016), (0.096, 0.080, 0.107), hair)
    _ellipsoid(body, (-0.097, 0.0, -0.025), (0.018, 0.014, 0.024), person.skin_rgb)  # nose
    _ellipsoid(body, (0.11, 0.0, -0.20), SHOULDERS_M, person.sleeve_rgb)
    for side in (-1, 1):
        _capsule(body, (0.11, side * 0.15, -0.20), (0.13, side * 0.24, -0.34), 0.055, person.sleeve_rgb)


def view_edge_m(bench: Bench, height_m: float) -> float:
    """Greatest x that the overhead camera sees at a height."""
    setup = bench.overhead
    corners = np.array([[column, row] for column in (0, setup.width_px - 1) for row in (0, setup.height_px - 1)])
    return float(setup.model.onto_plane(setup.mount.pose, corners, height_m)[:, 0].max())


def _capsule(
    body: mujoco.MjsBody,
    start_m: tuple[float, float, float],
    end_m: tuple[float, float, float],
    radius_m: float,
    rgb: Rgb,
) -> None:
    _add(body, rgb, type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*start_m, *end_m), size=(radius_m, 0, 0))


def _ellipsoid(body: mujoco.MjsBody, centre_m: tuple[float, float, float], half_m: tuple[float, ...], rgb: Rgb) -> None:
    _add(body, rgb, type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, pos=centre_m, size=half_m)


def _add(body: mujoco.MjsBody, rgb: Rgb, **shape: object) -> None:
    body.add_geom(rgba=(*rgb, 1.0), contype=NO_TOUCH[0], conaffinity=NO_TOUCH[1], mass=0.0, **shape)


def fit_hand(spec: mujoco.MjSpec, person: Appearance) -> None:
    """Scale all shapes of the hand about the point between its fingertips, and mirror those of a left hand."""
    if person.hand_size == 1 and not person.left_hand:
        return
    scale = np.full(3, person.hand_size)
    if person.left_hand:
        scale[ACROSS] *= -1
    for body in spec.bodies:
        if body.name.split("_")[0] == HAND:
            for geom in body.geoms:
                _fit(geom, scale)
            if person.left_hand:
                _mirror_slides(body)


def _fit(geom: mujoco.MjsGeom, scale: Array) -> None:
    geom.pos = geom.pos * scale
    geom.size = geom.size * abs(scale[0])
    if not math.isnan(geom.fromto[0]):
        ends = geom.fromto * np.tile(scale, 2)
        if geom.fromto[3] > SLEEVE_M:
            ends[3:] = geom.fromto[3:] * np.sign(scale) * max(1.0, scale[0])
        geom.fromto = ends


def _mirror_slides(body: mujoco.MjsBody) -> None:
    """Thumb and finger of a left hand open the other way; the wrist and the arm move as before."""
    for joint in body.joints:
        if body.name != HAND and joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
            axis = np.array(joint.axis)
            axis[ACROSS] *= -1
            joint.axis = axis
