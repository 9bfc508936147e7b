"""What lies on what, and how: a network that looks at a crop around each thing that the centre net sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_cell.learned.parts.maps import Maps, crops_of, overlap
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, rest_on

STACKED_KIND = "parts.stacked"
CROP_PX, STEP_M = (64, 64), 0.002
SAME_THING = 0.75  # intersection over union above which two boxes are duplicates
LEAST_ON_TOP, LEAST_CARRYING = 0.5, 0.3  # probabilities
LEAST_SHARED = 0.08  # of the box of what lies on top, which it has in common with that of what carries it


def stacked_file(centre: Path) -> Path:
    """Where the network is that belongs to a centre net."""
    return centre.with_name(weights_file("parts", "stacked"))


@dataclass(frozen=True)
class Told:
    """What is told of one thing.

    Attributes:
        on_top, carrying: probabilities that it lies on another, and that another lies on it.
        lies: world_from_part if it lies; None for an unknown thing.
    """

    on_top: float
    carrying: float
    lies: Pose | None


NOTHING_TOLD = Told(0.0, 0.0, None)


class StackReader:
    """Tells of each thing in a tray whether it lies on another, whether it carries one, and how it lies.

    Raises:
        ModelError: the network was trained for other parts.
    """

    def __init__(self, parts: dict[str, PartType], network: Network) -> None:
        self._kinds, self._network = tuple(parts.values()), network
        network.card.require_vocabulary(network.path, {"parts": tuple(parts)})

    @staticmethod
    def load(parts: dict[str, PartType], path: Path) -> StackReader:
        """With the network of a file."""
        return StackReader(parts, OnnxModel.load(path, STACKED_KIND))

    def read(
        self,
        frame: Frame,
        camera: CameraModel,
        kinds: Sequence[int],
        places_m: Sequence[Array],
        yaws_rad: Sequence[float],
    ) -> list[Told]:
        """What is told of each thing in a levelled image.

        Args:
            kinds: index of its type; the number of types for an unknown thing.
            places_m: (3,) where its middle is supposed to be.
            yaws_rad: how it is supposed to be turned, or half a turn from that.
        """
        if not kinds:
            return []
        answer = self._network.run(
            {"crops": stack_crops(frame.image, camera, frame.world_from_camera, places_m, yaws_rad)}
        )
        found = []
        for number, (kind, place, yaw) in enumerate(zip(kinds, places_m, yaws_rad, strict=True)):
            on_top, carrying = (float(p) for p in 1.0 / (1.0 + np.exp(-answer["stacked"][number].astype(float))))
            known = kind < len(self._kinds)
            lies = lying_pose(answer["lies"][number, kind], place, yaw, self._kinds[kind]) if known else None
            found.append(Told(on_top, carrying, lies))
        return found


def carriers(seen: Sequence[Told], boxes_px: Sequence[Array]) -> list[tuple[int, ...]]:
    """For each thing the numbers of those that it lies on; none where it lies on the floor.

    What lies on top has part of its box in common with what carries it: with all that seem to carry something, or with
    the one that does so most probably.
    """
    found: list[tuple[int, ...]] = []
    for b, upper in enumerate(seen):
        below = [a for a in range(len(seen)) if a != b and _may_carry(boxes_px[a], boxes_px[b])]
        if upper.on_top < LEAST_ON_TOP or not below:
            found.append(())
            continue
        likely = max(below, key=lambda a: seen[a].carrying)
        found.append(tuple(a for a in below if a == likely or seen[a].carrying >= LEAST_CARRYING))
    return [tuple(a for a in on if b not in found[a] or seen[b].on_top > seen[a].on_top) for b, on in enumerate(found)]


def meeting(boxes_px: Sequence[Array]) -> list[int]:
    """Numbers of those that may lie on another, or another on them."""
    found: set[int] = set()
    for a, below in enumerate(boxes_px):
        for b, above in enumerate(boxes_px):
            found |= {a, b} if a != b and _may_carry(below, above) else set()
    return sorted(found)


def _may_carry(below_px: Array, above_px: Array) -> bool:
    """Whether the boxes meet, and are not those of one thing told twice."""
    low, high = np.maximum(below_px[:2], above_px[:2]), np.minimum(below_px[2:], above_px[2:])
    shared = float(np.prod(np.maximum(high - low, 0.0))) / max(float(np.prod(above_px[2:] - above_px[:2])), 1.0)
    return shared >= LEAST_SHARED and overlap(below_px, above_px) < SAME_THING


def stack_crops(
    image: NDArray[np.uint8],
    camera: CameraModel,
    world_from_camera: Pose,
    places_m: Sequence[Array],
    yaws_rad: Sequence[float],
) -> Maps:
    """(n, PLANES, height, width) around things."""
    return crops_of(image, camera, world_from_camera, places_m, yaws_rad, size_px=CROP_PX, step_m=STEP_M)


def lying_pose(answer: Maps, place_m: Array, yaw_rad: float, kind: PartType) -> Pose:
    """world_from_part by the network's answer (LYING,) about a crop at a place (3,), turned by a yaw.

    It lies as it would lie on a floor with the side up that the network means, turned as the network says.
    """
    first, second = answer[:3].astype(float), answer[3:6].astype(float)
    x = first / max(float(np.linalg.norm(first)), 1e-6)
    y = second - (second @ x) * x
    y /= max(float(np.linalg.norm(y)), 1e-6)
    turn = _resting(np.column_stack([x, y, np.cross(x, y)]), kind)
    crop = Pose.from_yaw((float(place_m[0]), float(place_m[1]), float(place_m[2])), yaw_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = answer[6:].astype(float) / 100 - turn[:, 2] * kind.size_m[2] / 2
    return crop @ Pose.from_matrix(matrix)


def _resting(turn: Array, kind: PartType) -> Array:
    """The rotation (3, 3) nearest to another with which a part of a type rests on a floor."""
    best, found = -4.0, turn
    for rest in filter(None, (rest_on(kind, side) for side in SIDES)):
        product = turn @ rest.rotation.T
        angle = np.arctan2(product[1, 0] - product[0, 1], product[0, 0] + product[1, 1])
        cosine, sine = float(np.cos(angle)), float(np.sin(angle))
        about = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        if (alike := float(np.trace(about.T @ product))) > best:
            best, found = alike, about @ rest.rotation
    return found
