"""Fits a part that lies to what stands out from the floor: every side that can be up, every heading, then finer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Tray
from cell.interfaces.camera_model import CameraModel
from cell.interfaces.perception import Frame
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import PartType
from cell.interfaces.resting import SIDES, rest_on

Mask = NDArray[np.uint8]

AROUND_PX = 26  # of the image around a detection, in which its part and its floor are looked for
FLOOR_PX = 3  # so far from the detection its floor begins
SHADED = (0.25, 1.08)  # of the floor's brightness: shadows, and light that is not even
LIT_PERCENT = 80
LEAST_CONTRAST, NOISES = 14.0, 5.0  # of what stands out, in grey levels and in what the floor differs by itself
HEADINGS = 24
LEAST_PX = 12
FINER = 6  # coarse answers that are looked at more closely
STEPS = ((0.003, 0.12), (0.0015, 0.06), (0.0008, 0.03))  # [m] and [rad]
LEAST_AGREEMENT = 0.75
LEAST_LEAD = 0.02  # over the best answer that means something else
OTHERWISE_RAD = math.radians(40)
PEG_WEIGHT = 0.15  # of how well the peg stands out from the body, beside the agreement


@dataclass(frozen=True)
class LyingFit:
    """A part as it lies.

    Attributes:
        part: its type.
        up: the side that is up, as in `cell.interfaces.resting`.
        world_from_part: its frame.
        agreement: what its silhouette and what stands out have in common, as a share of both together.
    """

    part: str
    up: str
    world_from_part: Pose
    agreement: float

    def means(self, other: LyingFit) -> bool:
        """Whether both say the same about where its peg points."""
        cosine = float(self.world_from_part.rotation[:, 2] @ other.world_from_part.rotation[:, 2])
        return cosine > math.cos(OTHERWISE_RAD)


class LyingFitter:
    """Tells how parts lie."""

    def __init__(self, camera: CameraModel, tray: Tray, parts: dict[str, PartType]) -> None:
        self._camera, self._tray = camera, tray
        self._models = {name: _Model(name, kind) for name, kind in parts.items()}

    def fit(self, frame: Frame, box_px: Sequence[int], types: Sequence[str], hidden: Mask) -> LyingFit | None:
        """How the part in a box lies, or None where that is not sure.

        Args:
            types: of which it may be.
            hidden: (height, width) of the image, 1 where something else may cover it.
        """
        window = _Window.around(frame.image, box_px, hidden)
        if window is None:
            return None
        scene = _Scene(self._camera, frame.world_from_camera, window)
        seeds = [fit for name in types if name in self._models for fit in self._coarse(scene, self._models[name])]
        seeds.sort(key=lambda fit: -fit.agreement)
        found = [self._finer(scene, fit) for fit in _various(seeds)]
        scores = [fit.agreement + PEG_WEIGHT * scene.peg_contrast(self._models[fit.part], fit) for fit in found]
        best, score = max(zip(found, scores, strict=True), key=lambda pair: pair[1], default=(None, 0.0))
        if best is None or best.agreement < LEAST_AGREEMENT:
            return None
        otherwise = (
            one for fit, one in zip(found, scores, strict=True) if fit.part != best.part or not fit.means(best)
        )
        return best if score - max(otherwise, default=0.0) > LEAST_LEAD else None

    def agreement(self, frame: Frame, box_px: Sequence[int], part: str, world_from_part: Pose, hidden: Mask) -> float:
        """How well a part at some pose agrees with what stands out in a box; 1 where nothing does."""
        window = _Window.around(frame.image, box_px, hidden)
        if window is None:
            return 1.0
        return _Scene(self._camera, frame.world_from_camera, window).agreement(self._models[part], world_from_part)

    def _coarse(self, scene: _Scene, model: _Model) -> list[LyingFit]:
        """The best place for each side and heading."""
        middle = scene.on_floor(scene.window.middle_px, self._tray.centre_m[2])
        fits = []
        for up, rest in model.rests:
            for heading in np.arange(HEADINGS) * 2 * math.pi / HEADINGS:
                pose = Pose.from_yaw((*middle, self._tray.centre_m[2]), heading) @ rest
                off = scene.window.middle_px - scene.window.corner_px - _middle(scene.covered(model, pose))
                by = scene.on_floor(scene.window.middle_px + off, self._tray.centre_m[2]) - middle
                pose = _moved(pose, by, 0.0)
                fits.append(LyingFit(model.part, up, pose, scene.agreement(model, pose)))
        return fits

    def _finer(self, scene: _Scene, fit: LyingFit) -> LyingFit:
        """The best pose near a coarse one, by ever smaller steps."""
        model = self._models[fit.part]
        for step_m, step_rad in STEPS:
            for _ in range(4):
                moves = np.concatenate([np.eye(3), -np.eye(3)]) * (step_m, step_m, step_rad)
                tried = [_moved(fit.world_from_part, move[:2], float(move[2])) for move in moves]
                best = max(((scene.agreement(model, pose), pose) for pose in tried), key=lambda pair: pair[0])
                if best[0] <= fit.agreement:
                    break
                fit = replace(fit, agreement=best[0], world_from_part=best[1])
        return fit


class _Model:
    """A type's solids, and the poses in which it can lie."""

    def __init__(self, part: str, kind: PartType) -> None:
        self.part, self._kind = part, kind
        clouds = [solid.points() for solid in kind.whole]
        self.points, self.ends = np.concatenate(clouds), np.cumsum([len(cloud) for cloud in clouds])[:-1]

    @cached_property
    def rests(self) -> tuple[tuple[str, Pose], ...]:
        """floor_from_part by the side that is up; of two that look alike only one."""
        sides = SIDES if not self._kind.alike_after_half_turn else ("+y", "+x", "-z")
        return tuple((side, rest) for side in sides if (rest := rest_on(self._kind, side)) is not None)


@dataclass(frozen=True)
class _Window:
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
        return _middle(self.shown) + self.corner_px

    @staticmethod
    def around(image: NDArray[np.uint8], box_px: Sequence[int], hidden: Mask) -> _Window | None:
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
        if int(floor.sum()) < 50:
            return None
        colour = np.median(piece[floor == 1], axis=0)
        share = piece @ colour / max(float(colour @ colour), 1.0)
        lit = max(1.0, float(np.percentile(share[floor == 1], LIT_PERCENT)))  # where half of the floor is in a shadow
        share = np.clip(share, SHADED[0], SHADED[1] * lit)
        apart = np.linalg.norm(piece - share[..., None] * colour, axis=2)
        contrast = max(LEAST_CONTRAST, NOISES * float(np.median(apart[floor == 1])))
        shown = np.asarray(cv2.medianBlur((apart > contrast).astype(np.uint8), 3), np.uint8) * counts
        shown = _largest(shown)
        return None if int(shown.sum()) < 50 else _Window(np.array([left, top], float), piece, shown, counts)


class _Scene:
    """A window and the camera that sees it."""

    def __init__(self, camera: CameraModel, world_from_camera: Pose, window: _Window) -> None:
        self._camera, self._world_from_camera, self.window = camera, world_from_camera, window

    def on_floor(self, pixel: Array, height_m: float) -> Array:
        """Where a pixel (2,) of the image meets a height, (x, y)."""
        place: Array = self._camera.onto_plane(self._world_from_camera, pixel[None], height_m)[0, :2]
        return place

    def covered(self, model: _Model, pose: Pose, solids: slice = slice(None)) -> Mask:
        """The silhouette of a part in the window, or of some of its solids; the peg is the last one."""
        pixels = self._camera.project(self._world_from_camera, pose.transform(model.points)) - self.window.corner_px
        mask = np.zeros(self.window.shown.shape, np.uint8)
        for cloud in np.split(np.round(pixels * 16).astype(np.int32), model.ends)[solids]:
            cv2.fillConvexPoly(mask, cv2.convexHull(cloud), 1, lineType=8, shift=4)
        return mask

    def peg_contrast(self, model: _Model, fit: LyingFit) -> float:
        """How much of the differences of colour is between peg and body, 0 to 1; a peg bears no paint."""
        peg, body = (self.covered(model, fit.world_from_part, one) for one in (slice(-1, None), slice(-1)))
        seen = self.window.shown & self.window.counts
        peg_px = self.window.piece[(seen & peg & (1 if fit.up == "-z" else 1 - body)) == 1]
        body_px = self.window.piece[(seen & body & (1 - peg)) == 1]
        if min(len(peg_px), len(body_px)) < LEAST_PX:
            return 0.0
        both = np.concatenate([peg_px, body_px])
        within = ((peg_px - peg_px.mean(axis=0)) ** 2).sum() + ((body_px - body_px.mean(axis=0)) ** 2).sum()
        return float(1.0 - within / max(float(((both - both.mean(axis=0)) ** 2).sum()), 1e-6))

    def agreement(self, model: _Model, pose: Pose) -> float:
        """What a silhouette and what stands out have in common, as a share of both together."""
        mask = self.covered(model, pose) & self.window.counts
        return float((mask & self.window.shown).sum() / max(int((mask | self.window.shown).sum()), 1))


def _various(fits: Sequence[LyingFit]) -> list[LyingFit]:
    """The best ones, and at least two that mean something else."""
    best = list(fits[:FINER])
    if best:
        best += [fit for fit in fits[FINER:] if fit.part != best[0].part or not fit.means(best[0])][:3]
    return best


def _moved(pose: Pose, by_m: Array, turn_rad: float) -> Pose:
    """Shifted on the floor, and turned about the vertical through its own origin."""
    x, y, z = pose.position_m
    turned = Pose.from_yaw((0.0, 0.0, 0.0), turn_rad) @ Pose((0.0, 0.0, 0.0), pose.quaternion_wxyz)
    return Pose((x + float(by_m[0]), y + float(by_m[1]), z), turned.quaternion_wxyz)


def _middle(mask: Mask) -> Array:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()]) if len(rows) else np.array(mask.shape[::-1]) / 2


def _largest(mask: Mask) -> Mask:
    """Only the largest piece that hangs together."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return mask
    return np.asarray(pieces == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()), np.uint8)
