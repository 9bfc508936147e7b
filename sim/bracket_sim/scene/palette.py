"""Colours that are the same in every look, and helpers that add primitive shapes to a model (the rest: look.py)."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

FLOOR = (0.35, 0.35, 0.34)
FLOOR_GROUP = 5  # of geoms: drawn only where a camera looks past the table, see sim/bracket_sim/rendering/studio.py
HOLE = (0.02, 0.02, 0.02)
LINK = (0.58, 0.61, 0.64)
JOINT = (0.34, 0.42, 0.50)
GRIPPER = (0.15, 0.15, 0.16)
OBSTACLE = (0.42, 0.43, 0.45)
PAD = (0.08, 0.08, 0.08)

# Contact types (contype, conaffinity): parts touch everything; hand and robot touch each other and not themselves.
STATIC_TOUCH = (1, 9)
ROBOT_TOUCH = (8, 0)
HAND_ONLY_TOUCH = (16, 0)  # of the robot: links that never come near anything but a person
SKIN_TOUCH = (0, 24)
PART_TOUCH = (3, 13)  # bits 2 and 4 are the hand's (sim/bracket_sim/scene/hand.py)
NO_TOUCH = (0, 0)
FRICTION = 0.3  # painted metal on metal; the rubber of the pads and the skin of the hand decide their own contacts

Rgb = tuple[float, float, float]


def add_box(
    body: mujoco.MjsBody,
    centre_m: Sequence[float],
    size_m: Sequence[float],
    rgb: Rgb,
    touch: tuple[int, int] = STATIC_TOUCH,
) -> mujoco.MjsGeom:
    """Add a box of full extents `size_m`; with NO_TOUCH it is only seen."""
    return _add(body, mujoco.mjtGeom.mjGEOM_BOX, centre_m, [extent / 2 for extent in size_m], rgb, touch)


def add_cylinder(
    body: mujoco.MjsBody,
    centre_m: Sequence[float],
    diameter_m: float,
    length_m: float,
    rgb: Rgb,
    touch: tuple[int, int] = STATIC_TOUCH,
) -> mujoco.MjsGeom:
    """Add an upright cylinder; with NO_TOUCH it is only seen."""
    return _add(body, mujoco.mjtGeom.mjGEOM_CYLINDER, centre_m, [diameter_m / 2, length_m / 2, 0.0], rgb, touch)


def add_ellipsoid(
    body: mujoco.MjsBody,
    centre_m: Sequence[float],
    size_m: Sequence[float],
    rgb: Rgb,
    touch: tuple[int, int] = STATIC_TOUCH,
) -> mujoco.MjsGeom:
    """Add an ellipsoid of full extents `size_m`; with NO_TOUCH it is only seen."""
    return _add(body, mujoco.mjtGeom.mjGEOM_ELLIPSOID, centre_m, [extent / 2 for extent in size_m], rgb, touch)


def add_mesh(body: mujoco.MjsBody, mesh: str, rgb: Rgb, touch: tuple[int, int] = STATIC_TOUCH) -> mujoco.MjsGeom:
    """Add a mesh of the specification, in the frame of its file."""
    geom = _add(body, mujoco.mjtGeom.mjGEOM_MESH, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), rgb, touch)
    geom.meshname = mesh
    return geom


def _add(
    body: mujoco.MjsBody,
    shape: mujoco.mjtGeom,
    centre_m: Sequence[float],
    size: Sequence[float],
    rgb: Rgb,
    touch: tuple[int, int],
) -> mujoco.MjsGeom:
    return body.add_geom(
        type=shape,
        pos=list(centre_m),
        size=list(size),
        rgba=[*rgb, 1.0],
        contype=touch[0],
        conaffinity=touch[1],
        friction=[FRICTION, 0.005, 0.0001],
        mass=0.0,
    )
