"""Labelled images of trays (objects.jsonl of `cell lab data objects`), as what the networks are to say about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import PartType, Product
from cell.interfaces.solid import Solid
from learned.training.still_dataset import Still, load_stills, pose_of

UNKNOWN = "unknown"
AXIS_M = 0.01  # way along a part's x axis that is projected


@dataclass(frozen=True)
class Label:
    """One thing in an image.

    Attributes:
        part: its type, or UNKNOWN.
        pose: world_from_part.
        upright: it stands on its peg.
        outline_px: (n, 2) what its convex outline goes through, what others hide included; of an unknown thing the
            corners of its box.
        centre_px: (2,) where the middle of its body is seen; of an unknown thing the middle of its box.
        axis_px: (2,) by how many pixels AXIS_M along its x axis are seen there; zero for unknown things.
        shown: share of its box that its visible pixels take.
        on: numbers of the labels of this image that carry it.
    """

    part: str
    pose: Pose
    upright: bool
    outline_px: Array
    centre_px: Array
    axis_px: Array
    shown: float
    on: tuple[int, ...] = ()

    @property
    def box_px(self) -> Array:
        """(4,) left, top, right, bottom around all of it."""
        return np.concatenate([self.outline_px.min(axis=0), self.outline_px.max(axis=0)])


@dataclass(frozen=True)
class Scene(Still):
    """One image of a tray with everything in it."""

    labels: tuple[Label, ...]


def load_scenes(folders: Sequence[Path], product: Product) -> list[Scene]:
    """All images of some folders.

    Raises:
        InputError: a file is missing or wrong; the message names file and line.
    """

    def labelled(still: Still, row: dict[str, Any]) -> Scene:
        seen = {number: entry for number, entry in enumerate(row["parts"]) if entry["whole_box_px"]}
        number_of = {number: label for label, number in enumerate(seen)}
        labels = tuple(
            replace(
                _label(entry, still.camera, still.world_from_camera, product),
                on=tuple(number_of[one] for one in entry.get("on", ()) if one in number_of),
            )
            for entry in seen.values()
        )
        return Scene(**vars(still), labels=labels)

    return load_stills(folders, "objects", labelled)


def _label(entry: dict[str, Any], camera: CameraModel, world_from_camera: Pose, product: Product) -> Label:
    left, top, right, bottom = (float(value) for value in entry["whole_box_px"])
    outline = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    pose = pose_of(entry["world_from_part"])
    centre, axis = outline.mean(axis=0), np.zeros(2)
    if entry["part"] != UNKNOWN:
        kind = product.parts[entry["part"]]
        middle_m = kind.size_m[2] / 2
        points = np.array([[0.0, 0.0, middle_m], [AXIS_M / 2, 0.0, middle_m], [-AXIS_M / 2, 0.0, middle_m]])
        centre, ahead, behind = camera.project(world_from_camera, pose.transform(points))
        axis = ahead - behind
        surface = camera.project(world_from_camera, pose.transform(surface_of(kind)))
        outline = cv2.convexHull(surface.astype(np.float32)).reshape(-1, 2).astype(np.float64)
    shown = entry["visible_px"] / max((right - left) * (bottom - top), 1)
    return Label(entry["part"], pose, entry["posture"] == "upright", outline, centre, axis, shown)


def surface_of(kind: PartType) -> Array:
    """Points (n, 3) that the outlines of a part's body and peg go through, in the part's frame."""
    diameter, length = kind.peg_diameter_m, kind.peg_length_m
    peg = Solid(solid="cylinder", size_m=(diameter, diameter, length), centre_m=(0.0, 0.0, -length / 2))
    points: Array = np.concatenate([solid.points() for solid in (*kind.solids, peg)])
    return points
