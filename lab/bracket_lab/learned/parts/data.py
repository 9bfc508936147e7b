"""Labelled images of trays: objects.jsonl of `cell lab data objects` or `cell label`, as networks shall see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.learned.parts.maps import surface_of
from bracket_cell.learned.records import UNKNOWN, PartRow, TrayRow, one_of
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.training.still_dataset import Still, load_stills

AXIS_M = 0.01  # way along a part's x axis that is projected
NEAREST_M = 0.02  # to the camera, of a part that can be seen


@dataclass(frozen=True, eq=False)
class Label:
    """One thing in an image.

    Attributes:
        part: its type, or UNKNOWN.
        pose: world_from_part; None where nobody knows.
        upright: it stands on its peg; None where nobody knows.
        outline_px: (n, 2) what its convex outline goes through, what others hide included; where the pose is unknown,
            and of an unknown thing, the corners of its box.
        centre_px: (2,) where the middle of its body is seen, or the middle of its box.
        axis_px: (2,) by how many pixels AXIS_M along its x axis are seen there; zero where that is unknown.
        shown: share of its box that its visible pixels take.
        on: numbers of the labels of this image that carry it.
    """

    part: str
    pose: Pose | None
    upright: bool | None
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

    def labelled(still: Still, row: TrayRow) -> Scene:
        for number, entry in enumerate(row.parts):
            one_of(f"parts.{number}: no part", entry.part, (*product.parts, UNKNOWN))
            if wrong := [below for below in entry.on if not 0 <= below < len(row.parts) or below == number]:
                raise ValueError(f"parts.{number}.on: {wrong} are no numbers of other parts")
        seen = {number: entry for number, entry in enumerate(row.parts) if entry.whole_box_px}
        number_of = {number: label for label, number in enumerate(seen)}
        labels = tuple(
            replace(_label(number, entry, still, product), on=tuple(number_of[i] for i in entry.on if i in number_of))
            for number, entry in seen.items()
        )
        return Scene(**vars(still), labels=labels)

    return load_stills(folders, "objects", TrayRow, labelled)


def _label(number: int, entry: PartRow, still: Still, product: Product) -> Label:
    left, top, right, bottom = entry.whole_box_px or (0.0,) * 4
    if right <= left or bottom <= top:
        raise ValueError(f"parts.{number}.whole_box_px: must be left, top, right, bottom, with right and bottom larger")
    outline = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)
    pose = None if entry.world_from_part is None else entry.world_from_part.pose
    centre, axis = outline.mean(axis=0), np.zeros(2)
    if pose is not None and entry.part != UNKNOWN:
        kind, camera, world_from_camera = product.parts[entry.part], still.camera, still.world_from_camera
        middle_m = kind.size_m[2] / 2
        points = np.array([[0.0, 0.0, middle_m], [AXIS_M / 2, 0.0, middle_m], [-AXIS_M / 2, 0.0, middle_m]])
        surface_m = pose.transform(surface_of(kind))
        if float(world_from_camera.inverse().transform(surface_m)[:, 2].min()) < NEAREST_M:
            raise ValueError(f"parts.{number}.world_from_part: is behind the camera, or in it")
        centre, ahead, behind = camera.project(world_from_camera, pose.transform(points))
        axis = ahead - behind
        surface = camera.project(world_from_camera, surface_m)
        outline = cv2.convexHull(surface.astype(np.float32)).reshape(-1, 2).astype(np.float64)
    shown = 1.0 if entry.visible_px is None else entry.visible_px / max((right - left) * (bottom - top), 1)
    upright = None if entry.posture is None else entry.posture == "upright"
    return Label(entry.part, pose, upright, outline, centre, axis, shown)
