"""What stands out from the floor around a detection, and what a part at some pose would cover of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, rest_on

Mask = NDArray[np.uint8]

AROUND_PX = 26  # of the image around a detection, in which its part and its floor are looked for
FLOOR_PX = 3  # so far from the detection its floor begins
SHADED = (0.25, 1.08)  # of the floor's brightness: shadows, and light that is not even
LIT_PERCENT = 80
LEAST_CONTRAST, NOISES = 14.0, 5.0  # of what stands out, in grey levels and in what the floor differs by itself
LEAST_FLOOR_PX, LEAST_SHOWN_PX = 50, 50
LEAST_PX = 12  # of peg and body each, to compare their colours
SHIFT = 4  # binary digits of a pixel's fraction, in which outlines are drawn


class Model:
    """A type's solids, and the poses in which it can lie."""

    def __init__(self, part: str, kind: PartType) -> None:
        self.part, self._kind = part, kind
        clouds = [solid.points() for solid in kind.whole]
        ends = np.cumsum([0, *map(len, clouds)]).tolist()
        self.points: Array = np.concatenate(clouds)
        self.solids = [slice(first, last) for first, last in pairwise(ends)]

    @cached_property
    def rests(self) -> tuple[tuple[str, Pose], ...]:
        """floor_from_part by the side that is up; of two that look alike only one."""
        sides = SIDES if not self._kind.alike_after_half_turn else ("+y", "+x", "-z")
        return tuple((side, rest) for side in sides if (rest := rest_on(self._kind, side)) is not None)


@dataclass(frozen=True, eq=False)
class Poses:
    """Several poses of one part.

    Attributes:
        rotations: (n, 3, 3).
        positions_m: (n, 3).
    """

    rotations: Array
    positions_m: Array

    @staticmethod
    def one(pose: Pose) -> Poses:
        """A single one."""
        return Poses(pose.rotation[np.newaxis], np.array([pose.position_m]))

    def moved(self, index: int, by_m: Array, turns_rad: Array) -> Poses:
        """One of them moved on the floor by (n, 2), and turned about the vertical through its own origin."""
        positions = np.repeat(self.positions_m[index : index + 1], len(turns_rad), axis=0)
        positions[:, :2] += by_m
        return Poses(about_vertical(turns_rad) @ self.rotations[index], positions)

    def only(self, index: int) -> Poses:
        """One of them."""
        return Poses(self.rotations[index : index + 1], self.positions_m[index : index + 1])

    def pose(self, index: int) -> Pose:
        """One of them, as a pose."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotations[index], self.positions_m[index]
        return Pose.from_matrix(matrix)


def about_vertical(turns_rad: Array) -> Array:
    """Rotations (n, 3, 3)."""
    rotations = np.zeros((len(turns_rad), 3, 3))
    cosine, sine = np.cos(turns_rad), np.sin(turns_rad)
    rotations[:, 0, 0], rotations[:, 0, 1], rotations[:, 1, 0], rotations[:, 1, 1] = cosine, -sine, sine, cosine
    rotations[:, 2, 2] = 1.0
    return rotations


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of the image.

    Attributes:
        corner_px: (column, row) of its first pixel in the image.
        piece: (height, width, 3), smoothed.
        shown: (height, width), 1 where it stands out from the floor.
        counts: 1 where that says something.
    """

    corner_px: Array
    piece: NDArray[np.float32]
    shown: Mask
    counts: Mask

    @cached_property
    def middle_px(self) -> Array:
        """Of what stands out (2,), in the image."""
        return middle_of(self.shown) + self.corner_px

    @cached_property
    def shown_px(self) -> int:
        """How many pixels stand out."""
        return cv2.countNonZero(self.shown)

    @staticmethod
    def around(image: NDArray[np.uint8], box_px: Sequence[int], hidden: Mask) -> Window | None:
        """The window of one detection; None where hardly anything stands out from its floor."""
        height, width = image.shape[:2]
        left, top = max(box_px[0] - AROUND_PX, 0), max(box_px[1] - AROUND_PX, 0)
        right, bottom = min(box_px[2] + AROUND_PX, width), min(box_px[3] + AROUND_PX, height)
        piece = cv2.GaussianBlur(image[top:bottom, left:right], (3, 3), 0).astype(np.float32)
        counts = 1 - hidden[top:bottom, left:right]
        floor = counts.copy()
        floor[
            max(box_px[1] - FLOOR_PX - top, 0) : box_px[3] + FLOOR_PX - top,
            max(box_px[0] - FLOOR_PX - left, 0) : box_px[2] + FLOOR_PX - left,
        ] = 0
        if int(floor.sum()) < LEAST_FLOOR_PX:
            return None
        colour = np.median(piece[floor == 1], axis=0)
        share = piece @ colour / max(float(colour @ colour), 1.0)
        lit = max(1.0, float(np.percentile(share[floor == 1], LIT_PERCENT)))  # where half of the floor is in a shadow
        share = np.clip(share, SHADED[0], SHADED[1] * lit)
        apart = np.linalg.norm(piece - share[..., None] * colour, axis=2)
        contrast = max(LEAST_CONTRAST, NOISES * float(np.median(apart[floor == 1])))
        shown = np.asarray(cv2.medianBlur((apart > contrast).astype(np.uint8), 3), np.uint8) * counts
        shown = _largest(shown)
        enough = int(shown.sum()) >= LEAST_SHOWN_PX
        return Window(np.array([left, top], float), piece, shown, counts) if enough else None


class Scene:
    """A window and the camera that sees it."""

    def __init__(self, camera: CameraModel, world_from_camera: Pose, window: Window) -> None:
        self._camera, self._world_from_camera, self.window = camera, world_from_camera, window

    def on_floor(self, pixels: Array, height_m: float) -> Array:
        """Where pixels (n, 2) of the image meet a height, (n, 2)."""
        places: Array = self._camera.onto_plane(self._world_from_camera, pixels, height_m)[:, :2]
        return places

    def silhouettes(self, model: Model, poses: Poses) -> list[Mask]:
        """What a part covers of the window at each of some poses."""
        return [self._covered(pixels, model.solids) for pixels in self._projected(model, poses)]

    def agreements(self, model: Model, poses: Poses) -> list[float]:
        """How well a part at each of some poses agrees with what stands out."""
        return [self.agreement(mask) for mask in self.silhouettes(model, poses)]

    def agreement(self, mask: Mask) -> float:
        """What a silhouette and what stands out have in common, as a share of both together."""
        both = cv2.countNonZero(cv2.bitwise_and(mask, self.window.shown))
        counted = cv2.countNonZero(cv2.bitwise_and(mask, self.window.counts))
        return both / max(counted + self.window.shown_px - both, 1)

    def agreement_there(self, mask: Mask, by_px: Array) -> float:
        """The agreement of a silhouette that is shifted by whole pixels (column, row)."""
        across, down = (round(float(value)) for value in by_px)
        here, there = _overlapping(mask.shape, across, down)
        seen, counts = self.window.shown[there], self.window.counts[there]
        both = cv2.countNonZero(cv2.bitwise_and(mask[here], seen))
        counted = cv2.countNonZero(cv2.bitwise_and(mask[here], counts))
        return both / max(counted + self.window.shown_px - both, 1)

    def peg_contrast(self, model: Model, poses: Poses, upside_down: bool) -> float:
        """How much of the differences of colour is between peg and body, 0 to 1; a peg bears no paint.

        Args:
            poses: a single one.
        """
        pixels = self._projected(model, poses)[0]
        peg, body = (self._covered(pixels, solids) for solids in (model.solids[-1:], model.solids[:-1]))
        seen = self.window.shown & self.window.counts
        peg_px = self.window.piece[(seen & peg & (1 if upside_down else 1 - body)) == 1]
        body_px = self.window.piece[(seen & body & (1 - peg)) == 1]
        return _contrast(peg_px, body_px)

    def _projected(self, model: Model, poses: Poses) -> NDArray[np.int32]:
        """The points of a part's solids in the window, (n, points, 2), in fractions of pixels."""
        points = model.points @ poses.rotations.transpose(0, 2, 1) + poses.positions_m[:, None]
        pixels = self._camera.project(self._world_from_camera, points.reshape(-1, 3)) - self.window.corner_px
        drawn: NDArray[np.int32] = np.round(pixels * 2**SHIFT).astype(np.int32)
        return drawn.reshape(len(points), -1, 2)

    def _covered(self, pixels: NDArray[np.int32], solids: Sequence[slice]) -> Mask:
        """The silhouette of some solids; the peg is the last one."""
        mask = np.zeros(self.window.shown.shape, np.uint8)
        for solid in solids:
            cv2.fillConvexPoly(mask, cv2.convexHull(pixels[solid]), 1, lineType=8, shift=SHIFT)
        return mask


def _contrast(peg_px: NDArray[np.float32], body_px: NDArray[np.float32]) -> float:
    if min(len(peg_px), len(body_px)) < LEAST_PX:
        return 0.0
    both = np.concatenate([peg_px, body_px])
    within = ((peg_px - peg_px.mean(axis=0)) ** 2).sum() + ((body_px - body_px.mean(axis=0)) ** 2).sum()
    return float(1.0 - within / max(float(((both - both.mean(axis=0)) ** 2).sum()), 1e-6))


def _overlapping(shape: Sequence[int], across: int, down: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The part of an array that stays in it when it is shifted: where it was, and where it comes to be."""
    rows, columns = shape
    down, across = max(-rows, min(rows, down)), max(-columns, min(columns, across))
    here = slice(max(0, -down), rows - max(0, down)), slice(max(0, -across), columns - max(0, across))
    there = slice(max(0, down), rows - max(0, -down)), slice(max(0, across), columns - max(0, -across))
    return here, there


def middle_of(mask: Mask) -> Array:
    """(column, row) of the middle of what a mask covers; its own middle where it covers nothing."""
    moments = cv2.moments(mask, binaryImage=True)
    if moments["m00"] == 0:
        return np.array(mask.shape[::-1]) / 2
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def _largest(mask: Mask) -> Mask:
    """Only the largest piece that hangs together."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return mask
    return np.asarray(pieces == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()), np.uint8)
