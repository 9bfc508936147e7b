"""Parts for MuJoCo: a body of solids on a round peg; what one sees and what touches come from one description."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid
from bracket_sim.scene import palette
from bracket_sim.scene.palette import add_box, add_cylinder, add_ellipsoid
from bracket_sim.scene.unknown_objects import UnknownObject

PEG_RGB = (0.38, 0.38, 0.36)
PEG_MASS_SHARE = 0.4  # solid steel below a hollow body: keeps the centre of mass low
FITTING_M = 0.003  # the fitting on top is inside the body's height
FITTING_SHADE = 0.75
HIDDEN_GROUP = 3
STEEL = "bare steel"
STEEL_GLOSS = (1.0, 0.6)  # specular, shininess

_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_HALF = math.sqrt(0.5)
# part_from_cylinder (w, x, y, z) by axis: MuJoCo's cylinders lie along z
_ALONG = {"x": (_HALF, 0.0, _HALF, 0.0), "y": (_HALF, -_HALF, 0.0, 0.0), "z": _UPRIGHT}
SLICES = 18  # as many as MuJoCo's own, so that outlines stay


Owner = Literal["robot", "person", "place"]


@dataclass(frozen=True)
class ScenePart:
    """One part and where it starts.

    Attributes:
        part: its type.
        world_from_part: the part frame (body's bottom centre).
        owner: whose set it belongs to; of nobody what stands at a place with a name.
        foreign: what it is, where it is of no type.
    """

    part: str
    world_from_part: Pose
    owner: Owner = "robot"
    foreign: UnknownObject | None = None


def add_part(spec: mujoco.MjSpec, name: str, scene_part: ScenePart, kind: PartType, style: int) -> None:
    """Add one free part; its body frame is the part frame (origin at the body's bottom centre).

    Args:
        style: chooses the fitting on top of a plain box; the index of the type.
    """
    body = _free_body(spec, name, scene_part)
    mass_kg = kind.mass_kg * (1 - PEG_MASS_SHARE if kind.peg_length_m else 1.0)
    if kind.shape:
        add_solids(spec, body, kind.shape, kind.colour_rgb, mass_kg)
    else:
        _add_plain_box(body, kind, style, mass_kg)
    if kind.peg_length_m:
        _add_peg(body, kind)
    if kind.finish == "steel":
        _polish(spec, body)


def add_unknown_object(spec: mujoco.MjSpec, name: str, scene_part: ScenePart, foreign: UnknownObject) -> None:
    """Add one free object of no type."""
    body = _free_body(spec, name, scene_part)
    add_solids(spec, body, foreign.solids, foreign.colour_rgb, foreign.mass_kg)
    if foreign.finish == "steel":
        _polish(spec, body)


def _free_body(spec: mujoco.MjSpec, name: str, scene_part: ScenePart) -> mujoco.MjsBody:
    pose = scene_part.world_from_part
    body = spec.worldbody.add_body(name=name, pos=list(pose.position_m), quat=list(pose.quaternion_wxyz))
    body.add_freejoint(name=name)
    return body


def add_solids(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, solids: tuple[Solid, ...], rgb: palette.Rgb, mass_kg: float
) -> None:
    """Add solids that are seen and touch; their mass is spread over them by volume."""
    volume_m3 = sum(solid.volume_m3 for solid in solids)
    for solid in solids:
        red, green, blue = (solid.shade * channel for channel in rgb)
        _add_solid(spec, body, solid, (red, green, blue)).mass = mass_kg * solid.volume_m3 / volume_m3


def _add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, rgb: palette.Rgb) -> mujoco.MjsGeom:
    if solid.solid == "hull":
        return _add_hull(spec, body, solid, rgb)
    if solid.solid == "box":
        return add_box(body, solid.centre_m, solid.size_m, rgb, palette.PART_TOUCH)
    if solid.solid == "ball":
        return add_ellipsoid(body, solid.centre_m, solid.size_m, rgb, palette.PART_TOUCH)
    return _add_cylinder(body, solid.centre_m, solid.diameter_m, solid.length_m, rgb, _ALONG[solid.axis])[0]


def _add_hull(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, rgb: palette.Rgb) -> mujoco.MjsGeom:
    """A mesh with flat faces; its edges are seen."""
    name = f"hull {hashlib.sha256(repr(solid.corners_m).encode()).hexdigest()[:16]}"
    if spec.mesh(name) is None:
        points = solid.faces.corners_m.reshape(-1, 3)
        faces = np.arange(len(points), dtype=np.int32)
        spec.add_mesh(name=name, uservert=points.ravel(), userface=faces, smoothnormal=0)
    return palette.add_mesh(body, name, rgb, palette.PART_TOUCH)


def _add_cylinder(
    body: mujoco.MjsBody,
    centre_m: tuple[float, float, float],
    diameter_m: float,
    length_m: float,
    rgb: palette.Rgb,
    part_from_cylinder: tuple[float, float, float, float] = _UPRIGHT,
) -> tuple[mujoco.MjsGeom, ...]:
    """A cylinder that is seen, and two crossed boxes that touch, whose eight edges lie on its circle.

    Boxes make up to four contacts where a cylinder on a box makes one, on which a part would wobble.
    """
    seen = add_cylinder(body, centre_m, diameter_m, length_m, rgb, palette.NO_TOUCH)
    seen.quat = list(part_from_cylinder)
    side = diameter_m / math.sqrt(2.0)
    touching = []
    for turn in (0.0, math.pi / 4):
        edge = add_box(body, centre_m, (side, side, length_m), rgb, palette.PART_TOUCH)
        edge.quat = list(_turned(part_from_cylinder, turn))
        edge.group = HIDDEN_GROUP  # the cylinder is what one sees
        touching.append(edge)
    return seen, *touching


def _turned(quaternion: tuple[float, float, float, float], angle_rad: float) -> tuple[float, ...]:
    """A rotation after a turn about the local z axis."""
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, np.array(quaternion), np.array([math.cos(angle_rad / 2), 0, 0, math.sin(angle_rad / 2)]))
    return tuple(float(value) for value in turned)


def _add_plain_box(body: mujoco.MjsBody, kind: PartType, style: int, mass_kg: float) -> None:
    """A box that touches at its full height; what is seen of it carries the fitting."""
    length, width, height = kind.size_m
    below_m = height - _fitting_m(height)
    add_box(body, (0, 0, below_m / 2), (length, width, below_m), kind.colour_rgb, palette.NO_TOUCH)
    _add_fitting(body, kind, style)
    block = add_box(body, (0, 0, height / 2), kind.size_m, kind.colour_rgb, palette.PART_TOUCH)
    block.mass, block.group = mass_kg, HIDDEN_GROUP


def _fitting_m(height_m: float) -> float:
    """How high the fitting on a body is."""
    return min(FITTING_M, height_m / 2)


def _add_fitting(body: mujoco.MjsBody, kind: PartType, style: int) -> None:
    """A small fitting on top, which tells plain boxes of different types apart."""
    length, width, height = kind.size_m
    red, green, blue = kind.colour_rgb
    rgb = (FITTING_SHADE * red, FITTING_SHADE * green, FITTING_SHADE * blue)
    fitting_m = _fitting_m(height)
    centre = (0.0, 0.0, height - fitting_m / 2)
    if style % 3 == 0:
        add_cylinder(body, centre, 0.75 * width, fitting_m, rgb, palette.NO_TOUCH)
    elif style % 3 == 1:
        add_box(body, centre, (0.6 * length, 0.25 * width, fitting_m), rgb, palette.NO_TOUCH)
        add_box(body, centre, (0.2 * width, 0.8 * width, fitting_m), rgb, palette.NO_TOUCH)
    else:
        for side in (-1, 1):
            add_cylinder(body, (side * 0.3 * length, 0, centre[2]), 0.5 * width, fitting_m, rgb, palette.NO_TOUCH)


def _add_peg(body: mujoco.MjsBody, kind: PartType) -> None:
    middle = (0.0, 0.0, -kind.peg_length_m / 2)
    _, *touching = _add_cylinder(body, middle, kind.peg_diameter_m, kind.peg_length_m, PEG_RGB)
    for edge in touching:
        edge.mass = kind.mass_kg * PEG_MASS_SHARE / len(touching)


def _polish(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    """Let everything of a part shine as bare steel does; its colours stay."""
    if spec.material(STEEL) is None:
        specular, shininess = STEEL_GLOSS
        spec.add_material(name=STEEL, specular=specular, shininess=shininess)
    for geom in body.geoms:
        geom.material = STEEL


def simplify_cylinders(spec: mujoco.MjSpec) -> None:
    """Draw every cylinder that touches nothing as a mesh; for a specification that is not yet compiled.

    The cylinder stays, out of sight: the mass and inertia of its body are those of a round one.
    """
    known: set[str] = set()
    for geom in spec.geoms:
        if geom.type != mujoco.mjtGeom.mjGEOM_CYLINDER or geom.contype or geom.conaffinity:
            continue
        radius_m, half_m = (float(value) for value in geom.size[:2])
        name = f"cylinder {radius_m:.6f} {half_m:.6f}"
        if name not in known:
            known.add(name)
            _add_mesh(spec, name, radius_m, half_m)
        geom.parent.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            pos=geom.pos,
            quat=geom.quat,
            rgba=geom.rgba,
            material=geom.material,
            group=geom.group,
            contype=0,
            conaffinity=0,
            mass=0.0,
        )
        geom.group = HIDDEN_GROUP


def _add_mesh(spec: mujoco.MjSpec, name: str, radius_m: float, half_m: float) -> None:
    points, normals, triangles = cylinder(radius_m, half_m)
    spec.add_mesh(name=name, uservert=points.ravel(), usernormal=normals.ravel(), userface=triangles.ravel())


def cylinder(radius_m: float, half_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Along z around the origin: points (n, 3), their normals (n, 3), triangles (t, 3) of them.

    The side is smooth and the ends are flat, as in MuJoCo's.
    """
    angles = 2 * math.pi * np.arange(SLICES) / SLICES
    around, up = np.stack([np.cos(angles), np.sin(angles), np.zeros(SLICES)], axis=1), np.array([0.0, 0.0, 1.0])
    low, high = radius_m * around - half_m * up, radius_m * around + half_m * up
    here, there = np.arange(SLICES), (np.arange(SLICES) + 1) % SLICES
    side = [np.stack([here, there, SLICES + there], 1), np.stack([here, SLICES + there, SLICES + here], 1)]
    fan, start = np.arange(1, SLICES - 1), np.zeros(SLICES - 2, dtype=int)
    ends = [2 * SLICES + np.stack([start, fan + 1, fan], 1), 3 * SLICES + np.stack([start, fan, fan + 1], 1)]
    flat = np.repeat([-up, up], SLICES, axis=0)
    points, normals = np.concatenate([low, high, low, high]), np.concatenate([around, around, flat])
    return points, normals, np.concatenate(side + ends).astype(np.int32)
