"""Labelled data as JSON lines: a header, then a typed row a line; every mistake is told with its file and line."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, StrictBool

from bracket_ground.errors import InputError, Place, Problem, mistakes
from bracket_ground.files.files import read_text, regular
from bracket_ground.files.model import Model
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, ActionKind
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

EXPORT = "make one with: cell log export LOG --to training --out DIR"
MOST_PROBLEMS = 20  # of a file that are told at once
OFF_PACE = 0.25  # share by which the frames of a segment may follow each other faster or slower than the camera's

Point = tuple[float, float]
Vector = tuple[float, float, float]
Box = tuple[float, float, float, float]
AnyRow = TypeVar("AnyRow", bound=Model)
Made = TypeVar("Made")


class Header(Model):
    """The first line of a file.

    Attributes:
        source: the command, log or person that the rows come from.
    """

    format: str
    version: Literal[1] = 1
    source: str = ""


class Told(Model):
    """What a program wrote; keys that nobody here reads may stand beside."""

    model_config = ConfigDict(extra="ignore")


class PoseRow(Model):
    """A pose in the world."""

    position_m: Vector
    quaternion_wxyz: tuple[float, float, float, float]

    @property
    def pose(self) -> Pose:
        """As a pose."""
        return Pose(self.position_m, self.quaternion_wxyz)


class CameraRow(PoseRow):
    """Where a camera truly is, and its true lens: what `cell setup calibrate` finds."""

    focal_px: float = Field(gt=0)
    distortion_k1: float = 0.0
    distortion_k2: float = 0.0
    focal_y_px: float | None = None
    principal_px: tuple[float, float] | None = None
    distortion_p1: float = 0.0
    distortion_p2: float = 0.0
    distortion_k3: float = 0.0


class SampleRow(Told):
    """A hand in a frame of a segment."""

    time_s: float
    fingertips_m: Point
    palm_m: Point
    fingertips_height_m: float | None = None
    thumb_m: Point | None = None
    index_m: Point | None = None


class TrueAction(Told):
    """What the hand truly did."""

    kind: ActionKind
    part: str | None = None
    position: str | None = None
    released: StrictBool = False


class DetectedAction(Told):
    """What a detector said; `shown`: a hole told it."""

    kind: ActionKind
    part: str | None = None
    position: str | None = None
    finished: StrictBool = False
    shown: StrictBool = False


class ConfirmedAction(Told):
    """What a hole showed later, or a person says; a hole without part: something else was done."""

    part: str | None
    position: str
    released: StrictBool | None = None


class SegmentRow(Told):
    """45 frames of one hand; see `cell log export --to training` and `cell lab data actions`."""

    log: str
    begin_s: float = 0.0
    guarded: StrictBool = False
    truth: TrueAction | None = None
    detected: DetectedAction | None = None
    confirmed: ConfirmedAction | None = None
    hand_crop: str | None = None
    hole_crop: str | None = None
    frames: tuple[str, ...] = ()
    holes: dict[str, str | None] = Field(default_factory=dict)
    hands: tuple[SampleRow | None, ...] = ()
    hand_before: SampleRow | None = None

    def require_whole(self, rate_hz: float) -> None:
        """Check the frames, and the pace at which they follow each other.

        Raises:
            ValueError: there are too few or too many, or the camera had another rate.
        """
        if len(self.hands) != SEGMENT_FRAMES:
            raise ValueError(f"hands: {len(self.hands)} frames; {SEGMENT_FRAMES} are needed")
        seen = [(number, hand.time_s) for number, hand in enumerate(self.hands) if hand is not None]
        if len(seen) < 2:
            return
        (first, began_s), (last, ended_s) = seen[0], seen[-1]
        if abs((ended_s - began_s) * rate_hz / (last - first) - 1) > OFF_PACE:
            rate = f"{(last - first) / (ended_s - began_s):.3g}" if ended_s > began_s else "no time, or less,"
            raise ValueError(f"hands: follow each other at {rate} frames a second; the camera takes {rate_hz:g}")


def read_rows(
    path: Path,
    row: type[AnyRow],
    made: Callable[[AnyRow], Made],
    *,
    header: Callable[[dict[str, Any]], None] | str,
    how: str = "",
) -> list[Made]:
    """What is made of each row of a file; empty lines are passed over.

    Args:
        made: of one row; raises ValueError, or InputError, for one that does not fit.
        header: the format's name, or what checks the first line and raises ValueError.
        how: what to type where there is no file, for the message.

    Raises:
        InputError: the file cannot be read or is of another format, or rows are wrong; up to MOST_PROBLEMS at once.
    """
    lines = read_text(path, how).splitlines()
    found: list[Made] = []
    problems: list[Problem] = []
    for number, line in enumerate(lines or [""], 1):
        try:
            if number == 1:
                _check_header(line, header)
            elif line.strip():
                found.append(made(row.model_validate_json(line)))
        except (ValueError, InputError) as error:
            problems += [Problem(Place(path, number), what) for what in mistakes(error)]
            if number == 1 or len(problems) >= MOST_PROBLEMS:
                break
    if problems:
        raise InputError(*problems[:MOST_PROBLEMS])
    return found


def one_of(name: str, value: str, legal: tuple[str, ...]) -> None:
    """Raises ValueError where a name is none of the legal ones."""
    if value not in legal:
        raise ValueError(f"{name} {value!r}; legal: {', '.join(legal)}")


def _check_header(line: str, wanted: Callable[[dict[str, Any]], None] | str) -> None:
    read = json.loads(line or "{}")
    read = read if isinstance(read, dict) else {}
    if callable(wanted):
        wanted(read)
        return
    if read.get("format") != wanted:
        what = wanted.removeprefix("cell.")
        raise ValueError(f'no file of {what}: its first line must be {{"format": "{wanted}", "version": 1}}')
    if read.get("version", 1) != 1:
        raise ValueError(f"{wanted.removeprefix('cell.')} of version {read['version']}; this program reads version 1")


class StillRow(Model):
    """An image and how it was taken.

    Attributes:
        log: the recording that it is of; images of one are learned from together or not at all.
        world_from_camera: where the camera was believed to be.
        source_px: (width, height) of a picture of another shape than the camera's, before it got borders.
    """

    file: str
    log: str
    camera: str = ""
    source_px: tuple[int, int] | None = None
    true_camera: CameraRow
    world_from_camera: PoseRow


def read_image(path: Path) -> NDArray[np.uint8]:
    """An image file as RGB.

    Raises:
        InputError: it is missing, damaged, or larger than OpenCV reads.
    """
    with suppress(cv2.error, OSError):
        if (read := cv2.imread(str(regular(path)), cv2.IMREAD_COLOR)) is not None:
            return np.ascontiguousarray(read[..., ::-1], np.uint8)
    raise InputError(f"{path}: cannot be read as an image: not there, damaged, too large, or of another kind")


class Hole(Model):
    """What one hole holds.

    Attributes:
        part: type of the part in or on it; None where it is empty.
        upright: it stands in the hole as it should; also where the hole is empty.
        covered: share of what is seen around it that hand, arm or a held part hides.
    """

    position: str
    part: str | None
    upright: StrictBool = True
    covered: float = Field(default=0.0, ge=0, le=1)


class PlateRow(StillRow):
    """An image of the plate and all of its holes, in any order."""

    holes: tuple[Hole, ...]


def holes_of(given: Sequence[Hole], product: Product) -> tuple[Hole, ...]:
    """Holes by their names, in the order of the product.

    Raises:
        ValueError: a hole is missing, named twice or unknown, or holds a part of no known type.
    """
    named: dict[str, Hole] = {}
    for hole in given:
        one_of("holes: no position", hole.position, product.positions)
        if hole.position in named:
            raise ValueError(f"holes: {hole.position} stands there twice")
        if hole.part is not None:
            one_of(f"holes: {hole.position}: no part", hole.part, tuple(product.parts))
        named[hole.position] = hole
    if missing := [position for position in product.positions if position not in named]:
        raise ValueError(f"holes: {', '.join(missing)} missing; each hole of the plate needs a label")
    return tuple(named[position] for position in product.positions)


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
