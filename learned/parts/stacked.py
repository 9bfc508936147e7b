"""What lies on what, and how: two small networks that read what the centre net says of the things in a tray."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.perception import Frame
from cell.interfaces.planning import weights_file
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import PartType
from learned.inference.onnx_model import Network, OnnxModel
from learned.parts.maps import BOX_UNIT_PX, HEIGHT_UNIT_M, STRIDE, Maps, Peak, crops_of, overlap

PAIRS_KIND, LYING_KIND = "parts.stacked", "parts.stacked_pose"
LYING_PX, LYING_STEP_M = (64, 64), 0.002
SAME_THING = 0.75  # intersection over union, from which two peaks are the same thing told twice
SUREST = 6.0  # of log odds

Numbers = NDArray[np.intp]


def stacked_file(centre: Path) -> Path:
    """Where the network of pairs is that belongs to a centre net."""
    return centre.with_name(weights_file("parts", "stacked"))


def near_pairs(found: Sequence[Peak]) -> Numbers:
    """(k, 2) peaks of which the first may lie on the second: their boxes meet, and they are not one thing twice."""
    pairs = [
        (b, a)
        for b, above in enumerate(found)
        for a, below in enumerate(found)
        if a != b and 0.0 < overlap(above.box_px, below.box_px) < SAME_THING
    ]
    return np.array(pairs, np.intp).reshape(-1, 2)


def pair_features(found: Sequence[Peak], pairs: Numbers, features: Maps, types: int) -> NDArray[np.float32]:
    """(k, ...) of pairs: both peaks, what the centre net sees at both and between them, and how they are to each other.

    Args:
        found: in pixels of the centre net's input.
        features: (n, rows, columns), the centre net's.
    """
    own = np.array([_features(peak, features, types) for peak in found]).reshape(len(found), -1)
    rows = [
        np.concatenate([own[b], own[a], _between(found[b], found[a], features), _relative(found[b], found[a])])
        for b, a in pairs.tolist()
    ]
    width = 3 * len(features) + 2 * (types + 1 + _OWN) + _RELATIVE
    return np.array(rows, np.float32).reshape(len(rows), width)


_OWN, _RELATIVE = 5, 5


def _features(peak: Peak, features: Maps, types: int) -> Array:
    kind = np.eye(types + 1)[peak.kind]
    width, height = (peak.box_px[2:] - peak.box_px[:2]) / BOX_UNIT_PX
    told = [peak.score, _log_odds(peak.upright), peak.height_m / HEIGHT_UNIT_M, width, height]
    column, row = peak.cell
    return np.concatenate([kind, told, features[:, row, column]])


def _between(above: Peak, below: Peak, features: Maps) -> Array:
    """What is seen in the middle of what their boxes have in common."""
    low, high = np.maximum(above.box_px[:2], below.box_px[:2]), np.minimum(above.box_px[2:], below.box_px[2:])
    limits = np.array(features.shape[:0:-1]) - 1
    column, row = np.clip(((low + high) / 2 / STRIDE).astype(int), 0, limits)
    found: Array = features[:, row, column].astype(float)
    return found


def _relative(above: Peak, below: Peak) -> Array:
    way = (below.centre_px - above.centre_px) / BOX_UNIT_PX
    low, high = np.maximum(above.box_px[:2], below.box_px[:2]), np.minimum(above.box_px[2:], below.box_px[2:])
    both = float(np.prod(np.maximum(high - low, 0.0)))
    areas = [max(float(np.prod(one.box_px[2:] - one.box_px[:2])), 1.0) for one in (above, below)]
    return np.array([*way, both / areas[0], both / areas[1], (above.height_m - below.height_m) / HEIGHT_UNIT_M])


def _log_odds(share: float) -> float:
    least = 1.0 / (1.0 + math.exp(SUREST))
    inside = min(max(share, least), 1.0 - least)
    return math.log(inside / (1.0 - inside)) / SUREST


def lying_pose(answer: Maps, place_m: Array, yaw_rad: float, kind: PartType) -> Pose:
    """world_from_part by the pose net's answer (LYING,) about a crop at a place (3,), turned by a yaw."""
    first, second = answer[:3].astype(float), answer[3:6].astype(float)
    x = first / max(float(np.linalg.norm(first)), 1e-6)
    y = second - (second @ x) * x
    y /= max(float(np.linalg.norm(y)), 1e-6)
    crop = Pose.from_yaw((float(place_m[0]), float(place_m[1]), float(place_m[2])), yaw_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    matrix[:3, 3] = answer[6:].astype(float) / 100 - matrix[:3, 2] * kind.size_m[2] / 2
    return crop @ Pose.from_matrix(matrix)


def lying_crops(frame: Frame, camera: CameraModel, places_m: Sequence[Array], yaws_rad: Sequence[float]) -> Maps:
    """(n, PLANES, height, width) around where things are supposed to lie."""
    where = camera, frame.world_from_camera, places_m, yaws_rad
    return crops_of(frame.image, *where, size_px=LYING_PX, step_m=LYING_STEP_M)


class StackReader:
    """Tells which peaks lie on which, and how they lie.

    Raises:
        ModelError: a network was trained for other parts.
    """

    def __init__(self, parts: dict[str, PartType], pairs: Network, lying: Network) -> None:
        self._types, self._kinds = tuple(parts), tuple(parts.values())
        self._pairs, self._lying = pairs, lying
        for network in (pairs, lying):
            network.card.require_vocabulary(network.path, {"parts": self._types})

    @staticmethod
    def load(parts: dict[str, PartType], path: Path) -> StackReader:
        """With the network of pairs of a file, and the pose net beside it."""
        pose = path.with_name(f"{path.stem}_pose{path.suffix}")
        return StackReader(parts, OnnxModel.load(path, PAIRS_KIND), OnnxModel.load(pose, LYING_KIND))

    def on(self, found: Sequence[Peak], features: Maps) -> list[dict[int, float]]:
        """For each peak, in pixels of the centre net's input, those that it may lie on, with the probability."""
        told: list[dict[int, float]] = [{} for _ in found]
        pairs = near_pairs(found)
        if len(pairs):
            logits = self._pairs.run({"pairs": pair_features(found, pairs, features, len(self._types))})["logits"]
            for (b, a), logit in zip(pairs.tolist(), logits.tolist(), strict=True):
                told[b][a] = 1.0 / (1.0 + math.exp(-logit))
        return told

    def lies(
        self, frame: Frame, camera: CameraModel, kinds: Sequence[int], places_m: Sequence[Array], yaws: Sequence[float]
    ) -> list[Pose]:
        """world_from_part of parts of these types that lie, by crops of the levelled image."""
        if not kinds:
            return []
        answers = self._lying.run({"crops": lying_crops(frame, camera, places_m, yaws)})["lies"]
        rows = zip(answers, kinds, places_m, yaws, strict=True)
        return [lying_pose(answer[kind], place, yaw, self._kinds[kind]) for answer, kind, place, yaw in rows]
