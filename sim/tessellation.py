"""Cylinders that are only seen, as meshes: MuJoCo's own have five times as many triangles, most of an image's cost."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.parts import HIDDEN_GROUP

SLICES = 18  # as many as MuJoCo's own, so that outlines stay


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
