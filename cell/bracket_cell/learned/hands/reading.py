"""What a network tells of one hand in one image, before anything is known of other frames or of the world."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from bracket_cell.learned.hands.regions import Image, centre_of
from bracket_ground.interfaces.pose import Array

Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class ApparentSize:
    """What one image tells of a hand's size; errors are mean absolute ones.

    Attributes:
        log_angle: logarithm of the angle [rad] under which the camera sees the length from palm to wrist.
        height_errors_m: of `Reading.heights_m`, which tell of the size together with the angle.
    """

    log_angle: float
    angle_error: float
    height_errors_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Reading:
    """One hand in one image.

    Attributes:
        confidence, left, acting: probabilities that it is a hand, a left one, the one that works.
        points_px: (2,) column and row by name: palm, pinch, thumb, index, wrist; held where something is held.
        box_px: (left, top, right, bottom).
        heights_m: of palm and pinch over the table, by this image alone.
        size: how large it looks and how sure all that is, where the network tells it.
        held_part: type of what is held; None where nothing is held, or where it is of no known type.
    """

    confidence: float
    left: float
    acting: float
    points_px: Mapping[str, Array]
    box_px: Box
    heights_m: tuple[float, float]
    held_part: str | None = None
    size: ApparentSize | None = None

    @property
    def centre_px(self) -> Array:
        """Where a region around the hand is centred."""
        return centre_of(self.points_px["palm"], self.points_px["pinch"])


def over_table(height_m: float) -> float:
    """A height that is not below the table; one that is no number stays none, as it must not become the table's."""
    return height_m if math.isnan(height_m) else max(0.0, height_m)


class RegionReader(Protocol):
    """Reads hands where others found them."""

    def read_at(self, image: Image, centres_px: Sequence[Array]) -> list[Reading]:
        """What is seen around points (column, row) of an RGB image."""
        ...


class HandReader(Protocol):
    """Reads the hands of single images."""

    def read(self, image: Image, expected_px: Sequence[Array]) -> list[Reading]:
        """All hands in an RGB image, surest first.

        Args:
            expected_px: centres (column, row) of hands that should be there, by the frames before.
        """
        ...
