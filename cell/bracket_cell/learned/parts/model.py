"""Trained part detectors: a first network says what is where, a pose net says exactly how it stands."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.exposure import levelled
from bracket_cell.learned.inference.onnx_model import ModelCard, Network, OnnxModel
from bracket_cell.learned.parts.maps import (
    INPUT_PX,
    Peak,
    crops_of,
    half_turned,
    network_input,
    overlap,
    peaks,
    surface_of,
)
from bracket_cell.learned.parts.stacked import NOTHING_TOLD, StackReader, Told, carriers, meeting, stacked_file
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType, Product
from bracket_ground.interfaces.resting_pose import over_floor_m

CENTRE_KIND, POSE_KIND = "parts.centre", "parts.pose"
POSES = "poses"  # on the card of a centre net: false where boxes alone were learned from, so that no pose net is there
LEAST_SCORE, LEAST_GRASPED = 0.1, 0.3  # of the centre net: for an answer at all, and for one with an exact pose
LEAST_STANDING = 0.5  # probability, by both networks, that a part stands and is of its type
LEAST_LIKELY = 0.05  # the same at first sight; what is likelier is looked at once more, from both sides
BIAS, BY_CENTRE, BY_POSE, SUREST = -1.25, 0.3, 1.0, 6.0  # of log odds that it stands, by each network up to a limit
MARGIN_M = 0.06  # things this far outside the tray still count
NEAREST_M = 0.05  # from the camera to the tray
LEAST_RAISED = 0.3  # probability that it lies on something, from which a thing is as high as the network has it
AXIS_PX = 8.0
RAYS = 7  # of a peak: its middle and two points of its axis, its middle if it lies, three corners of its box
HALF_TURN = np.array([-1.0, -1.0, 1.0], np.float32)  # of what is along, across and the heading, seen the other way
SAME_M = 0.012  # two standing parts cannot be nearer
SAME_BOX = 0.5  # intersection over union, from which something else is the same thing as one that stands


def pose_file(centre: Path) -> Path:
    """Where the pose net is that belongs to a centre net."""
    return centre.with_name(f"{centre.stem}_pose{centre.suffix}")


def centre_files(weights: Path | None, folder: Path) -> dict[str, Path]:
    """All files of the detector by the centre net; by default those of a folder."""
    centre = weights or folder / weights_file("parts", "centre")
    stacked = {"parts.stacked": file} if (file := stacked_file(centre)).is_file() else {}
    posed = {"parts.pose": pose_file(centre)} if not centre.is_file() or tells_poses(OnnxModel.card_of(centre)) else {}
    return {"parts": centre, **posed, **stacked}


def tells_poses(card: ModelCard) -> bool:
    """Whether a pose net belongs to a centre net."""
    return card.config.get(POSES, True) is not False


@dataclass(frozen=True, eq=False)
class _Standing:
    """A part that may stand: where the middle of its body is supposed to be, and how it is turned."""

    peak: Peak
    place_m: Array
    yaw_rad: float
    standing: float = 0.0


@dataclass(frozen=True, eq=False)
class _Seen:
    """Where a peak would be in the cell.

    Attributes:
        standing: if it stood; both ways round where its ends differ; nothing for an unknown thing.
        lying_m: (3,) if it lay as high as the centre net says.
        size_m: of its type; of an unknown thing what it may cover of the floor, from its box, and as high as wide.
    """

    peak: Peak
    standing: tuple[_Standing, ...]
    lying_m: Array
    size_m: tuple[float, float, float]


class PosedPartDetector(ABC):
    """Finds all that lies in the tray; what stands gets an exact pose (PartDetector).

    Args:
        networks: all that are asked, the pose net last; where that is None, nothing is known to stand.
        stacks: tells what lies on what, and how; without, nobody does.

    Raises:
        ModelError: one was trained for other parts.
    """

    def __init__(
        self, bench: Bench, product: Product, *networks: Network | None, stacks: StackReader | None = None
    ) -> None:
        self._bench, self._product, self._stacks = bench, product, stacks
        self._types = tuple(product.parts)
        self._pose = networks[-1]
        self.tells_standing = self._pose is not None
        self._alike = [kind.alike_after_half_turn for kind in product.parts.values()]
        self._surfaces = {name: surface_of(kind) for name, kind in product.parts.items()}
        for network in filter(None, networks):
            network.card.require_vocabulary(network.path, {"parts": self._types})

    @abstractmethod
    def _peaks(self, image: NDArray[np.uint8]) -> tuple[list[Peak], NDArray[np.float32] | None]:
        """What is seen in a levelled image, the surest first, and features (n, rows, columns) of its places."""

    @abstractmethod
    def _turns(self, kind: PartType) -> Sequence[float]:
        """By how much a part that stands may be turned from its peak's axis."""

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """Everything in and near the tray: standing parts first, then what lies and what is unknown.

        Where its type is in doubt, what does not stand comes once for every type that it may be of, each with a
        confidence of its own.

        Raises:
            DeviceFault: the image has not the size that the camera was set up with.
        """
        model = self._bench.wrist.model
        height, width = frame.image.shape[:2]
        if (width, height) != (model.width_px, model.height_px):
            what = f"image is {width} x {height}, must be {model.width_px} x {model.height_px}"
            raise DeviceFault(f"{frame.camera} camera", what)
        if not self._looks_down(frame.world_from_camera):
            return ()
        frame = replace(frame, image=levelled(frame.image))
        peaks, features = self._peaks(frame.image)
        found = self._placed(frame, [self._scaled(peak) for peak in peaks])
        below, stacked = self._below(frame, found)
        sure = [at for at, on in zip(found, below, strict=True) if not on and at.peak.score > LEAST_GRASPED]
        standing = self._refined(frame, [stance for seen in sure for stance in seen.standing])
        answers = [self._standing(frame, stance, features) for stance in standing]
        boxes = [np.array(detection.box_px, float) for detection in answers] + [own.peak.box_px for own in standing]
        rest = [
            index
            for index, candidate in enumerate(found)
            if below[index] or all(overlap(candidate.peak.box_px, box) < SAME_BOX for box in boxes)
        ]
        exact = {id(stance.peak): answer.box_px for stance, answer in zip(standing, answers, strict=True)}
        box_of = [exact.get(id(candidate.peak), _box(candidate.peak.box_px)) for candidate in found]
        for index in rest:
            on = tuple(box_of[lower] for lower in below[index])
            lies = self._lies(found[index].peak, stacked[index], raised=bool(on))
            answers.append(replace(self._other(found[index], features), lies=lies, lies_on=on))
        return tuple(detection for detection in answers if self._near_tray(detection))

    def _below(self, frame: Frame, found: Sequence[_Seen]) -> tuple[list[tuple[int, ...]], list[Told]]:
        """For each thing those seen ones that it lies on, and what is told of it.

        Only what meets others or does not stand is looked at: that may hide what it lies on.
        """
        boxes, stacked = [seen.peak.box_px for seen in found], [NOTHING_TOLD] * len(found)
        fallen = {index for index, seen in enumerate(found) if seen.peak.upright < LEAST_STANDING}
        looked_at = sorted(fallen.union(meeting(boxes)))
        if self._stacks is not None and looked_at:
            some = [found[index] for index in looked_at]
            yaws = [seen.standing[0].yaw_rad if seen.standing else 0.0 for seen in some]
            kinds, places = [seen.peak.kind for seen in some], [seen.lying_m for seen in some]
            answers = self._stacks.read(frame, self._bench.wrist.model, kinds, places, yaws)
            for index, answer in zip(looked_at, answers, strict=True):
                stands = found[index].peak.upright >= LEAST_STANDING
                stacked[index] = replace(answer, on_top=0.0) if stands else answer
        return carriers(stacked, boxes), stacked

    def _lies(self, peak: Peak, stacked: Told, *, raised: bool) -> Pose | None:
        """How a thing lies as far as that is told: on the floor, where it is told to lie on nothing."""
        kind = self._kind_of(peak)
        if kind is None or stacked.lies is None or raised or stacked.on_top >= LEAST_RAISED:
            return stacked.lies
        x, y, z = stacked.lies.position_m
        over_m = over_floor_m(kind, stacked.lies, self._bench.tray.centre_m[2])
        return Pose((x, y, z - over_m), stacked.lies.quaternion_wxyz)

    def _looks_down(self, world_from_camera: Pose) -> bool:
        """Whether all of the tray is before the camera."""
        tray = self._bench.tray
        corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * (*tray.size_m, 0.0)
        depths = world_from_camera.inverse().transform(corners + np.array(tray.centre_m))[:, 2]
        return bool(depths.min() > NEAREST_M)

    def _scaled(self, peak: Peak) -> Peak:
        """In pixels of the camera's image."""
        model = self._bench.wrist
        scale = np.array([model.width_px / INPUT_PX[0], model.height_px / INPUT_PX[1]])
        centre = (peak.centre_px + 0.5) * scale - 0.5
        return replace(peak, centre_px=centre, box_px=peak.box_px * np.tile(scale, 2))

    def _placed(self, frame: Frame, found: Sequence[Peak]) -> list[_Seen]:
        """Where each peak would be; all rays at once, as a bent lens costs as much for one as for many."""
        floor_m = self._bench.tray.centre_m[2]
        pixels, heights_m = np.empty((len(found), RAYS, 2)), np.full((len(found), RAYS, 1), floor_m)
        for index, peak in enumerate(found):
            way = AXIS_PX * np.array([math.cos(peak.axis_rad), math.sin(peak.axis_rad)])
            pixels[index, :4] = peak.centre_px + np.stack([np.zeros(2), way, -way, np.zeros(2)])
            pixels[index, 4:] = peak.box_px[[[0, 1], [2, 1], [0, 3]]]
            if kind := self._kind_of(peak):
                heights_m[index, :3] += kind.peg_length_m + kind.size_m[2] / 2
                heights_m[index, 3] += max(peak.height_m, 0.0)
        model = self._bench.wrist.model
        places = model.onto_plane(frame.world_from_camera, pixels.reshape(-1, 2), heights_m.reshape(-1, 1))
        return [self._seen(peak, rays) for peak, rays in zip(found, places.reshape(-1, RAYS, 3), strict=True)]

    def _seen(self, peak: Peak, places_m: Array) -> _Seen:
        place, ahead, behind, lying, corner, across, down = places_m
        if (kind := self._kind_of(peak)) is None:
            length, width = float(np.linalg.norm(across - corner)), float(np.linalg.norm(down - corner))
            return _Seen(peak, (), lying, (length, width, min(length, width)))
        yaw = math.atan2(ahead[1] - behind[1], ahead[0] - behind[0])
        standing = tuple(_Standing(peak, place, yaw + turn) for turn in self._turns(kind))
        return _Seen(peak, standing, lying, kind.size_m)

    def _kind_of(self, peak: Peak) -> PartType | None:
        return self._product.parts[self._types[peak.kind]] if peak.kind < len(self._types) else None

    def _refined(self, frame: Frame, supposed: Sequence[_Standing]) -> list[_Standing]:
        """Those that stand, where the pose net sees them; of one thing the surest answer, none inside others."""
        likely = [standing for standing in self._corrected(frame, supposed) if standing.standing > LEAST_LIKELY]
        seen = self._corrected(frame, likely, both_ways=True)
        kept: list[_Standing] = []
        for stance in sorted(seen, key=lambda standing: -standing.standing):
            apart = all(float(np.hypot(*(stance.place_m - other.place_m)[:2])) > SAME_M for other in kept)
            if stance.standing >= LEAST_STANDING and apart and all(stance.peak is not other.peak for other in kept):
                kept.append(stance)
        return kept

    def _corrected(self, frame: Frame, supposed: Sequence[_Standing], *, both_ways: bool = False) -> list[_Standing]:
        """As the pose net sees them.

        Args:
            both_ways: the mean of what it says of a crop and of the same turned round, where a part's ends are alike.
        """
        if not supposed or self._pose is None:
            return []
        places, yaws = [standing.place_m for standing in supposed], [standing.yaw_rad for standing in supposed]
        crops = crops_of(frame.image, self._bench.wrist.model, frame.world_from_camera, places, yaws)
        twice = [index for index, standing in enumerate(supposed) if both_ways and self._alike[standing.peak.kind]]
        answer = self._pose.run({"crops": np.concatenate([crops, half_turned(crops[twice])])})
        shares = np.exp(answer["kinds"] - answer["kinds"].max(axis=1, keepdims=True))
        shares /= shares.sum(axis=1, keepdims=True)
        offs = answer["corrections"]
        offs[len(crops) :] *= HALF_TURN
        for values in (shares, offs):
            values[twice] = (values[twice] + values[len(crops) :]) / 2
        return [_moved(*pair) for pair in zip(supposed, offs, shares, strict=False)]

    def _standing(self, frame: Frame, stance: _Standing, features: NDArray[np.float32] | None) -> PartDetection:
        """A part that stands; its box is around what its exact pose lets the camera see of it."""
        name = self._types[stance.peak.kind]
        kind = self._product.parts[name]
        turn = math.pi if kind.alike_after_half_turn else 2 * math.pi
        yaw = (stance.yaw_rad + turn / 2) % turn - turn / 2
        bottom_m = self._bench.tray.centre_m[2] + kind.peg_length_m
        pose = Pose.from_yaw((float(stance.place_m[0]), float(stance.place_m[1]), bottom_m), yaw)
        seen = self._bench.wrist.model.project(frame.world_from_camera, pose.transform(self._surfaces[name]))
        box = _box(np.concatenate([seen.min(axis=0), seen.max(axis=0)]))
        return PartDetection(name, stance.peak.score, pose, kind.size_m, box, _embedding(stance.peak, features))

    def _other(self, seen: _Seen, features: NDArray[np.float32] | None) -> PartDetection:
        """A part that does not stand, or something unknown: where it lies, as well as the centre net knows."""
        peak, known = seen.peak, bool(seen.standing)
        x, y, z = seen.lying_m.tolist()
        pose = Pose.from_yaw((x, y, z), seen.standing[0].yaw_rad if known else 0.0)
        name, box = self._types[peak.kind] if known else UNKNOWN, _box(peak.box_px)
        return PartDetection(name, peak.score, pose, seen.size_m, box, _embedding(peak, features), upright=False)

    def _near_tray(self, detection: PartDetection) -> bool:
        tray = self._bench.tray
        reach = np.array(tray.size_m) / 2 + MARGIN_M
        off = np.abs(np.array(detection.world_from_part.position_m[:2]) - np.array(tray.centre_m[:2]))
        return bool((off < reach).all())


class CentrePartDetector(PosedPartDetector):
    """By the centre net, which tells the axis of a part, but not which way it heads."""

    def __init__(
        self, bench: Bench, product: Product, centre: Network, pose: Network | None, stacks: StackReader | None = None
    ) -> None:
        super().__init__(bench, product, centre, pose, stacks=stacks)
        self._centre = centre

    @staticmethod
    def load(bench: Bench, product: Product, weights: Path) -> CentrePartDetector:
        """With the networks of a file and those beside it: the pose net, and what tells of stacks where that is there.

        Raises:
            ModelError: a file is missing, damaged, of another kind, or trained for other parts.
        """
        centre = OnnxModel.load(weights, CENTRE_KIND)
        pose = OnnxModel.load(pose_file(weights), POSE_KIND) if tells_poses(centre.card) else None
        stacked = stacked_file(weights)
        stacks = StackReader.load(product.parts, stacked) if stacked.is_file() else None
        return CentrePartDetector(bench, product, centre, pose, stacks)

    def _peaks(self, image: NDArray[np.uint8]) -> tuple[list[Peak], NDArray[np.float32] | None]:
        maps = self._centre.run({"image": network_input(image)})
        return peaks(maps["heat"][0], maps["further"][0], LEAST_SCORE), maps["features"][0]

    def _turns(self, kind: PartType) -> Sequence[float]:
        return (0.0,) if kind.alike_after_half_turn else (0.0, math.pi)


def _moved(stance: _Standing, offs: NDArray[np.float32], shares: NDArray[np.float32]) -> _Standing:
    """By the pose net's answer about it: (types, 3) along, across in centimetres and heading; (types + 1) shares."""
    along, across, turn = (float(value) for value in offs[stance.peak.kind])
    cosine, sine = math.cos(stance.yaw_rad), math.sin(stance.yaw_rad)
    way = np.array([along * cosine - across * sine, along * sine + across * cosine, 0.0]) / 100
    odds = BIAS + BY_CENTRE * _log_odds(stance.peak.upright) + BY_POSE * _log_odds(float(shares[stance.peak.kind]))
    return _Standing(stance.peak, stance.place_m + way, stance.yaw_rad + turn, 1.0 / (1.0 + math.exp(-odds)))


def _log_odds(share: float) -> float:
    least = 1.0 / (1.0 + math.exp(SUREST))
    inside = min(max(share, least), 1.0 - least)
    return math.log(inside / (1.0 - inside))


def _box(sides: Array) -> tuple[int, int, int, int]:
    left, top, right, bottom = (round(float(value)) for value in sides)
    return left, top, right, bottom


def _embedding(peak: Peak, features: NDArray[np.float32] | None) -> tuple[float, ...]:
    column, row = peak.cell
    return () if features is None else tuple(features[:, row, column].tolist())
