"""Rows of files about hands in frames of the overhead camera."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field, StrictBool

from bracket_cell.learned.hands.regions import centre_of
from bracket_cell.learned.records import Box, CameraRow, Point, PoseRow, Vector
from bracket_ground.files.model import Model
from bracket_ground.interfaces.perception import Side
from bracket_ground.interfaces.pose import Array


class HandRow(Model):
    """One hand; of a person's own pictures its box is enough, and what a tracker tells of it stands beside.

    Attributes:
        acting: it is the hand that works, not one that rests.
        box_px: (left, top, right, bottom) of the hand without its sleeve, and of what it holds.
        side, held_part, visible: which hand, what it holds (None: nothing), and how much of it shows.
        points_m, points_px: (x, y, z) and (column, row) by name in POINTS; those that nobody knows are left out.
        known: false where held_part is a guess, so that nothing is learned from it.
        across: palm and wrist are as far from the camera, so that points_px tell how large the hand seems.
        joints_px: of a simulated human hand, as MediaPipe orders its landmarks; nothing is learned from them.
    """

    acting: StrictBool = True
    side: Side | None = None
    box_px: Box
    held_part: str | None = None
    visible: float = Field(default=1.0, ge=0, le=1)
    points_m: dict[str, Vector] = Field(default_factory=dict)
    points_px: dict[str, Point] = Field(default_factory=dict)
    known: StrictBool = True
    across: StrictBool = False
    joints_px: tuple[Point, ...] = ()

    @property
    def centre_px(self) -> Array:
        """Where a region around it is centred: between palm and pinch, or in the middle of its box."""
        if "palm" in self.points_px and "pinch" in self.points_px:
            return centre_of(np.array(self.points_px["palm"]), np.array(self.points_px["pinch"]))
        left, top, right, bottom = self.box_px
        return np.array([(left + right) / 2, (top + bottom) / 2])

    @property
    def palm_length_m(self) -> float:
        """From the middle of the palm to that of the wrist; not a number where that is unknown."""
        if "palm" not in self.points_m or "wrist" not in self.points_m:
            return math.nan
        return math.dist(self.points_m["palm"], self.points_m["wrist"])


class FrameRow(Model):
    """A frame and all hands in it; no hands say that there are none.

    Attributes:
        source_px: as of `StillRow`.
        decoys_px: (column, row) of what looks like a hand and is none: shadows, things. Those on a hand do not count.
        source, licence: of the photograph that was laid onto it.
    """

    file: str
    log: str
    frame: int = 0
    time_s: float = 0.0
    camera: str = ""
    source_px: tuple[int, int] | None = None
    true_camera: CameraRow | None = None
    world_from_camera: PoseRow | None = None
    hands: tuple[HandRow, ...]
    tool_px: Point | None = None
    decoys_px: tuple[Point, ...] = ()
    source: str = ""
    licence: str = ""

    @property
    def origin(self) -> str:
        """What is learned from or kept for the scores as a whole: a source of photographs, or a recording."""
        return self.source or self.log
