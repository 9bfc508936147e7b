"""Places with names: grids of spots where parts stand beside tray and bracket (config/cell.yaml, `bench.places`)."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.units import Gap, Length, Point, Quaternion
from bracket_ground.interfaces.pose import Pose

EMPTY = "empty"
FRAMES = ("world", "tray", "bracket", "tool")  # that poses in tree files are given in, beside holes and places
EDGE_M = 0.03  # of a place's body beyond the parts at its outer spots
UPRIGHT = 0.999  # cosine of the largest tilt of a place that parts stand on


def spot_name(place: str, number: int) -> str:
    """Name of a spot, as in "pallet 3"."""
    return f"{place} {number}"


class Mount(Model):
    """A fixed pose.

    Attributes:
        position_m: (x, y, z).
        quaternion_wxyz: how it is turned, as a unit quaternion (w, x, y, z); not turned by default.
    """

    position_m: Point
    quaternion_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return Pose(self.position_m, self.quaternion_wxyz)


class BenchPlace(Mount):
    """A place: spots for parts, in rows and columns on one level.

    Attributes:
        position_m: of the middle of its upper side, on which parts stand (x, y, z).
        quaternion_wxyz: how it is turned about z, as a unit quaternion (w, x, y, z); not turned by default.
        holds: types of parts that it takes; any by default.
        rows: of spots, one after the other along its y.
        columns: spots in a row, along its x.
        pitch_m: from column to column, and from row to row.
        seat: `flat`: parts stand on their pegs, or on their bodies where they have none; `hole`: pegs go into holes.
        wall_m: height of a rim around it.
        filled: types that stand there when a run begins, by spot, the first row first; `empty` for a free spot.
        known_by: `counted`: by `filled` and what the robot took and put there; `felt`: any spot may hold a part, and
            fingers that close on nothing tell that it does not; `seen`: by the overhead camera, too, which must see
            holes (`seat: hole`).
        enter_from_m: from where the tool comes, seen from straight above a spot (x, y, z in the place's frame); then it
            goes there, and back again, on a straight line. By default it comes from above.
    """

    holds: tuple[str, ...] = ()
    rows: int = Field(default=1, ge=1, le=20)
    columns: int = Field(default=1, ge=1, le=20)
    pitch_m: tuple[Length, Length] = (0.1, 0.1)
    seat: Literal["flat", "hole"] = "flat"
    wall_m: Gap = 0.0
    filled: tuple[str, ...] = ()
    known_by: Literal["counted", "felt", "seen"] = "counted"
    enter_from_m: Point | None = None

    @model_validator(mode="after")
    def _can_be_filled(self) -> BenchPlace:
        problems: list[tuple[Location, str]] = []
        if self.pose.rotation[2, 2] < UPRIGHT:
            problems.append((("quaternion_wxyz",), "parts would slide off a tilted place; turn it about z alone"))
        if len(self.filled) > len(self.spots_m):
            problems.append((("filled",), f"it lists {len(self.filled)} parts for {len(self.spots_m)} spots"))
        barred = sorted(set(self.filled) - {EMPTY, *self.holds}) if self.holds else []
        if barred:
            problems.append((("filled",), f"{', '.join(barred)} cannot stand there: it holds {', '.join(self.holds)}"))
        if self.known_by == "felt" and len(self.holds) != 1:
            problems.append((("known_by",), "fingers tell that a part is there, not which: holds must name one type"))
        if self.known_by == "seen" and self.seat != "hole":
            problems.append((("known_by",), "the camera tells a free spot by its dark hole: seat must be hole"))
        if self.enter_from_m is not None and self.enter_from_m[2] < 0:
            problems.append((("enter_from_m",), "the tool cannot come from below; z must be 0 or more"))
        if problems:
            raise Disagreement(problems)
        return self

    @property
    def spots_m(self) -> tuple[tuple[float, float], ...]:
        """(x, y) of each spot in the place's frame, the first row first."""
        across, along = self.pitch_m
        xs = [(column - (self.columns - 1) / 2) * across for column in range(self.columns)]
        ys = [(row - (self.rows - 1) / 2) * along for row in range(self.rows)]
        return tuple((x, y) for y in ys for x in xs)

    def spot(self, number: int) -> Pose:
        """world_from_spot, on the upper side."""
        x, y = self.spots_m[number]
        return self.pose @ Pose((x, y, 0.0))

    def stands(self, number: int, peg_length_m: float) -> Pose:
        """world_from_part of a part at a spot."""
        x, y = self.spots_m[number]
        up_m = peg_length_m if self.seat == "flat" else 0.0
        return self.pose @ Pose((x, y, up_m))

    def takes(self, part: str) -> bool:
        """Whether parts of a type may stand there."""
        return not self.holds or part in self.holds

    def size_m(self, longest_m: float) -> tuple[float, float]:
        """(x, y) extents of its upper side, for parts up to this long."""
        room_m = longest_m + 2 * EDGE_M
        return (self.columns - 1) * self.pitch_m[0] + room_m, (self.rows - 1) * self.pitch_m[1] + room_m

    @property
    def rim_m(self) -> float:
        """Height of its rim, or of its upper side."""
        return self.position_m[2] + self.wall_m
