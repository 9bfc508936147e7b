"""Parts for MuJoCo: a body on a round peg, with a small fitting on top that tells types apart."""

from __future__ import annotations

import math

import mujoco

from cell.interfaces.product import PartType
from sim import palette
from sim.clutter import ScenePart
from sim.palette import add_box, add_cylinder

PEG_RGB = (0.38, 0.38, 0.36)
PEG_MASS_SHARE = 0.4  # solid steel below a hollow body: keeps the centre of mass low
FITTING_M = 0.003  # the fitting on top is inside the body's height
FITTING_SHADE = 0.75


def add_part(spec: mujoco.MjSpec, name: str, scene_part: ScenePart, kind: PartType, style: int) -> None:
    """Add one free part; its body frame is the part frame (origin at the body's bottom centre).

    Args:
        style: chooses the fitting on top; the index of the type.
    """
    pose = scene_part.world_from_part
    body = spec.worldbody.add_body(name=name, pos=list(pose.position_m), quat=list(pose.quaternion_wxyz))
    body.add_freejoint(name=name)
    length, width, height = kind.size_m
    block_height = height - FITTING_M
    block = add_box(body, (0, 0, block_height / 2), (length, width, block_height), kind.colour_rgb, palette.PART_TOUCH)
    block.mass = kind.mass_kg * (1 - PEG_MASS_SHARE)
    _add_fitting(body, kind, style)
    _add_peg(body, kind)


def _add_fitting(body: mujoco.MjsBody, kind: PartType, style: int) -> None:
    length, width, height = kind.size_m
    red, green, blue = kind.colour_rgb
    rgb = (FITTING_SHADE * red, FITTING_SHADE * green, FITTING_SHADE * blue)
    centre = (0.0, 0.0, height - FITTING_M / 2)
    if style % 3 == 0:
        add_cylinder(body, centre, 0.75 * width, FITTING_M, rgb, palette.NO_TOUCH)
    elif style % 3 == 1:
        add_box(body, centre, (0.6 * length, 0.25 * width, FITTING_M), rgb, palette.NO_TOUCH)
        add_box(body, centre, (0.2 * width, 0.8 * width, FITTING_M), rgb, palette.NO_TOUCH)
    else:
        for side in (-1, 1):
            add_cylinder(body, (side * 0.3 * length, 0, centre[2]), 0.5 * width, FITTING_M, rgb, palette.NO_TOUCH)


def _add_peg(body: mujoco.MjsBody, kind: PartType) -> None:
    """Two crossed boxes whose eight edges lie on the peg's circle.

    Boxes make up to four contacts where a cylinder on a box makes one, on which a part would wobble.
    """
    middle = (0.0, 0.0, -kind.peg_length_m / 2)
    add_cylinder(body, middle, kind.peg_diameter_m, kind.peg_length_m, PEG_RGB, palette.NO_TOUCH)
    side = kind.peg_diameter_m / math.sqrt(2.0)
    for turn in (0.0, math.pi / 4):
        edge = add_box(body, middle, (side, side, kind.peg_length_m), PEG_RGB, palette.PART_TOUCH)
        edge.quat = [math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)]
        edge.mass = kind.mass_kg * PEG_MASS_SHARE / 2
        edge.group = 3  # hidden: the cylinder is what one sees
