"""Fits the hand that works to a look: its size, and whether it is a left one."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from cell.interfaces.pose import Array
from sim.scene.look import Appearance

HAND = "hand"  # all bodies of the hand begin so
ACROSS = 1  # the axis that a left hand mirrors: y
SLEEVE_M = 0.3  # what reaches further back than this is the sleeve; its end stays out of sight


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
