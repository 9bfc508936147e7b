"""Rows of files about the parts in a tray."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bracket_cell.learned.records import Box, PoseRow, StillRow, Vector
from bracket_ground.files.model import Model

UNKNOWN = "unknown"


class PartRow(Model):
    """A thing in an image; of a person's own pictures its type and its box are enough.

    Attributes:
        part: its type, or "unknown".
        posture, world_from_part: how and where it really is; None where nobody knows.
        on: rows of this image that carry it.
        box_px, visible_px: around what is seen of it, and how many pixels that are.
        whole_box_px: (left, top, right, bottom) of all of it, what others hide included; None where it is out of view.
    """

    part: str
    posture: Literal["upright", "lying"] | None = None
    world_from_part: PoseRow | None = None
    on: tuple[int, ...] = ()
    size_m: Vector | None = None
    box_px: Box | None = None
    visible_px: int | None = Field(default=None, ge=0)
    whole_box_px: Box | None


class TrayRow(StillRow):
    """An image of the tray, and everything in it."""

    parts: tuple[PartRow, ...]
