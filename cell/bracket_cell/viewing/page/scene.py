"""The cell in three dimensions, as plain data: what stands still once, and of a tick only joints, fingers and hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from bracket_cell.recording.scene import CellModel
from bracket_cell.recording.scene_frames import FINGER_SIDES, HoleMarks
from bracket_cell.skills.motion.collision import standing_boxes
from bracket_cell.skills.motion.outline import Shape, chain
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.solid import Solid

DIGITS = 4  # a tenth of a millimetre


def scene_of(model: CellModel) -> dict[str, Any]:
    """What a browser needs to draw the cell: links with their shapes, the bench, and what parts look like."""
    product, bench, kinematics = model.product, model.bench, model.motion.kinematics
    joints = [
        {"parent": joint.parent, "child": joint.child, "pose": _pose(joint.parent_from_child), "axis": joint.axis}
        for joint in chain(kinematics.model)
    ]
    return {
        "joints": joints,
        "shapes": [_shape(shape) for shape in model.motion.robot_shapes],
        "boxes": [
            {"name": box.name, "pose": _pose(box.pose), "size_m": box.size_m}
            for box in standing_boxes(product, bench)
            if box.name != "the table"
        ],
        "bracket": _pose(bench.bracket.pose),
        "hole_radius_m": product.hole_radius_m,
        "parts": {name: [solid_of(solid) for solid in part.solids] for name, part in product.parts.items()},
    }


def solid_of(solid: Solid) -> dict[str, Any]:
    """A solid of a part; of a hull its triangles, (t, 3, 3)."""
    faces = solid.faces.corners_m.round(DIGITS + 1).tolist() if solid.solid == "hull" else None
    return {**solid.model_dump(exclude={"corners_m"}), "faces_m": faces}


def pose_of(seen: Observation) -> dict[str, Any]:
    """Where the robot is: the browser works out the rest."""
    joints = [round(angle, DIGITS) for angle in seen.arm.positions_rad]
    return {"joints_rad": joints, "opening_m": round(seen.gripper.opening_m, DIGITS)}


def marks_of(product: Product, bench: Bench) -> dict[str, Any]:
    """Where holes, bins and the tray are in the image of the camera above: [x, y] and for holes their radius."""
    camera = bench.overhead
    holes = {
        name: [round((left + right) / 2), round((top + bottom) / 2), round((right - left) / 2)]
        for name, (left, top, right, bottom) in HoleMarks(product, bench).boxes_px.items()
    }
    places = {**bench.bins_m, "": bench.tray.centre_m}
    pixels = camera.model.project(camera.mount.pose, np.array(list(places.values()))).round().astype(int).tolist()
    found = dict(zip(places, pixels, strict=True))
    tray = found.pop("")
    return {"holes": holes, "bins": found, "tray": tray}


def _shape(shape: Shape) -> dict[str, Any]:
    fields = {
        "name": shape.name,
        "frame": shape.frame,
        "pose": _pose(shape.frame_from_shape),
        "side": FINGER_SIDES.get(shape.name, 0.0),
    }
    if shape.box_m is not None:
        return {**fields, "box_m": shape.box_m}
    points, triangles = shape.points_m.round(DIGITS), shape.triangles
    return {**fields, "points_m": points.ravel().tolist(), "triangles": triangles.ravel().tolist()}


def _pose(pose: Pose) -> list[float]:
    """Position and quaternion: x, y, z, qx, qy, qz, qw."""
    w, *vector = pose.quaternion_wxyz
    return [round(value, 6) for value in (*pose.position_m, *vector, w)]
