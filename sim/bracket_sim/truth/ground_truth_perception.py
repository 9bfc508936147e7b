"""What cameras would see, from poses instead of pixels: nothing is rendered, so trials of faults run much faster.

It stands in for photographer, hand tracker, hole reader and part detector at once. The hand is seen where its skin is
in view and nothing hides it; a hole, where nothing hides it; parts, where they stand in view of the wrist camera.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, HoleView, PartDetection
from bracket_ground.interfaces.places import spot_name
from bracket_ground.interfaces.pose import Array
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup
from bracket_sim.rendering.studio import visible_poses
from bracket_sim.scene.hand import PALM_M, WRIST
from bracket_sim.scene.world import World
from bracket_sim.truth.labels import resting_parts

SKIN_M = np.array(  # points of the hand's skin, in its frame, from the fingertips to the wrist
    [(-0.0135, 0.0, 0.0), (0.03, 0.0, 0.02), (0.066, 0.07, 0.042), (0.09, 0.066, 0.05), PALM_M, WRIST[0], WRIST[1]]
)
PALM = 4
SKIN_PX = 8  # the skin reaches this far beyond its points
LEAST_SEEN = 2  # points of the hand that must be seen
NEAR_HOLE_M, HELD_M = 0.03, 0.05
ABOVE_M = 0.004
SHIFTS_PX = 64  # of the noise, along both axes, then of its negative: a live camera never sends the same image twice
STANDS_M = 0.05  # a part that stands in the tray begins no higher above its floor
SPEED_FRAMES = 4  # over which a hand's velocity is a mean
AWAY_M = 4.0  # out of every view
KEPT = 64  # frames that may still be asked about
NOISE, MARK_LEVELS = 2.0, 128  # grey levels, of the noise and by which a part differs from the tray


@dataclass(frozen=True)
class _Seen:
    """What a frame of the overhead camera shows."""

    hand: HandSample | None
    others: tuple[HandSample, ...]
    holes: Mapping[str, HoleView]
    spots: Mapping[str, HoleView]


class GroundTruthPerception:
    """Makes frames without images of their own, and answers what they would have shown (HandTracker, HoleReader).

    Args:
        hand: a person is at the bench.
        still: makes the frame whose depths and, but for noise, whose image all frames have; called when the first one
            is made.

    Attributes:
        others: hands beside the first one, in the frame that was asked about last.
        spoil: what becomes of each answer about the hand, for trials of a tracker that errs.
    """

    def __init__(self, world: World, *, hand: bool, still: Callable[[], Frame]) -> None:
        self._world = world
        names = [world.model.body(index).name for index in range(world.model.nbody)]
        self._hands = {
            index: deque[tuple[float, Array]](maxlen=SPEED_FRAMES)
            for index, name in enumerate(names)
            if hand and name.split()[-1] == "hand"
        }
        self._make_still = still
        self._holes: dict[str, HoleView] = {}
        self._spots: dict[str, HoleView] = {}
        self._seen: dict[tuple[str, int], _Seen] = {}
        self._parts: dict[int, tuple[PartDetection, ...]] = {}
        self.others: tuple[HandSample, ...] = ()
        self.spoil: Callable[[HandSample | None], HandSample | None] = lambda hand: hand

    @cached_property
    def _still(self) -> Frame:
        return self._make_still()

    @cached_property
    def _noise(self) -> NDArray[np.int16]:
        height, width, channels = self._still.image.shape
        noise = np.random.default_rng(0).normal(0.0, NOISE, (height + SHIFTS_PX, width + SHIFTS_PX, channels))
        return np.rint(noise).astype(np.int16)

    def take(self, exposure: Exposure) -> Frame:
        """Look at the world now, as the shutter closes."""
        self._world.pose_hand()
        if exposure.camera == "wrist":
            self._parts = {exposure.sequence: self._parts_seen(exposure)}
        else:
            hands = [self._hand_seen(exposure, body) for body in self._hands] or [None]
            others = tuple(hand for hand in hands[1:] if hand is not None)
            seen = _Seen(hands[0], others, self._holes_seen(exposure), self._spots_seen(exposure))
            self._seen[exposure.camera, exposure.sequence] = seen
            self._seen.pop((exposure.camera, exposure.sequence - KEPT), None)
        image = self._image(exposure.sequence)
        if exposure.camera == "wrist":
            _mark(image, self._parts[exposure.sequence])
        stamp = exposure.camera, exposure.sequence, exposure.time_s
        depth_mm = self._still.depth_mm if exposure.camera == "overhead" else None
        return Frame(*stamp, image, exposure.world_from_camera, depth_mm=depth_mm)

    def _image(self, sequence: int) -> NDArray[np.uint8]:
        """The still one, with other noise in each frame."""
        height, width = self._still.image.shape[:2]
        turn, shift = divmod(sequence, SHIFTS_PX**2)
        down, right = divmod(shift, SHIFTS_PX)
        noise = self._noise[down : down + height, right : right + width] * (-1) ** turn
        image: NDArray[np.uint8] = np.clip(self._still.image + noise, 0, 255).astype(np.uint8)
        return image

    def close(self) -> None:
        """Nothing to let go of."""

    def track(self, frame: Frame) -> HandSample | None:
        """The first hand in a frame of the overhead camera."""
        seen = self._seen[frame.camera, frame.sequence]
        self.others = seen.others
        return self.spoil(seen.hand)

    def read(self, frame: Frame, _: HandSample | None) -> Mapping[str, HoleView]:
        """The holes in a frame."""
        return self._seen[frame.camera, frame.sequence].holes

    def spots(self, frame: Frame, _: HandSample | None) -> Mapping[str, HoleView]:
        """The places in a frame that the camera sees."""
        return self._seen[frame.camera, frame.sequence].spots

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """The parts in a frame of the wrist camera."""
        return self._parts.get(frame.sequence, ())

    def _hand_seen(self, exposure: Exposure, body: int) -> HandSample | None:
        data, camera = self._world.data, self._world.bench.overhead.model
        points = data.xpos[body] + SKIN_M @ data.xmat[body].reshape(3, 3).T
        pixels = camera.project(exposure.world_from_camera, points)
        eye = np.array(exposure.world_from_camera.position_m)
        inside = np.all((pixels >= 0) & (pixels < (camera.width_px, camera.height_px)), axis=1)
        seen = [index for index in np.flatnonzero(inside) if self._visible(eye, points[index], "hand")]
        if len(seen) < LEAST_SEEN:
            self._hands[body].clear()
            return None
        low = np.clip(pixels[seen].min(axis=0) - SKIN_PX, 0, None)
        high = np.minimum(pixels[seen].max(axis=0) + SKIN_PX, (camera.width_px, camera.height_px))
        left, top, right, bottom = (int(value) for value in (*low, *high))
        tips = points[
            0 if 0 in np.flatnonzero(inside) else seen[0]
        ].tolist()  # trackers infer tips that a held part hides
        palm = points[PALM if PALM in seen else seen[-1]].tolist()
        self._hands[body].append((exposure.time_s, np.array(palm[:2])))
        (first_s, first_m), (last_s, last_m) = self._hands[body][0], self._hands[body][-1]
        x, y = (last_m - first_m) / (last_s - first_s) if last_s > first_s else (0.0, 0.0)
        return HandSample(
            time_s=exposure.time_s,
            box_px=(left, top, right, bottom),
            fingertips_m=(tips[0], tips[1]),
            palm_m=(palm[0], palm[1]),
            held_part=self._held(points[0]),
            velocity_m_s=(float(x), float(y)) if last_s > first_s else None,
            height_m=palm[2],
            fingertips_height_m=tips[2],
        )

    def _held(self, tips_m: Array) -> str | None:
        """The type between the fingers."""
        world = self._world
        away = {name: np.linalg.norm(world.data.body(name).xpos - tips_m) for name in world.parts}
        nearest = min(away, key=lambda name: away[name], default=None)
        return world.parts[nearest] if nearest is not None and away[nearest] < HELD_M else None

    def _holes_seen(self, exposure: Exposure) -> Mapping[str, HoleView]:
        world = self._world
        eye = np.array(exposure.world_from_camera.position_m)
        slots = {name: np.array(world.product.slot_m(name)) for name in world.product.positions}
        holes = {name: world.bench.bracket.pose.transform(slot) for name, slot in slots.items()}
        for name, view in self._seen_at(exposure, eye, holes, "bracket"):
            self._holes[name] = view
        return dict(self._holes)

    def _spots_seen(self, exposure: Exposure) -> Mapping[str, HoleView]:
        eye = np.array(exposure.world_from_camera.position_m)
        for name, place in self._world.bench.places.items():
            if place.known_by == "seen":
                spots = {
                    spot_name(name, number): np.array(place.spot(number).position_m)
                    for number in range(len(place.spots_m))
                }
                self._spots.update(self._seen_at(exposure, eye, spots, f"place {name}"))
        return dict(self._spots)

    def _seen_at(
        self, exposure: Exposure, eye: Array, holes: Mapping[str, Array], of: str
    ) -> Iterator[tuple[str, HoleView]]:
        """Views of those holes of a body that nothing hides; what the gripper still holds is in none."""
        world, held = self._world, self._world.held()
        where = {part: world.data.body(part).xpos for part in world.parts if held is None or part != held.name}
        for name, hole in holes.items():
            near = (
                part
                for part, at in where.items()
                if _in_hole(at - hole) and min(holes, key=lambda other: np.linalg.norm(at - holes[other])) == name
            )
            part = next(near, None)
            top_m = 0.0 if part is None else world.product.parts[world.parts[part]].size_m[2]
            if self._visible(eye, hole + np.array([0.0, 0.0, top_m + ABOVE_M]), part or of):
                upright = part is None or float(world.data.body(part).xmat[8]) > math.cos(math.radians(10))
                yield name, HoleView(None if part is None else world.parts[part], 1.0, exposure.time_s, upright)

    def _parts_seen(self, exposure: Exposure) -> tuple[PartDetection, ...]:
        camera, found = self._world.bench.wrist.model, []
        for resting_part in resting_parts(self._world):
            if (
                resting_part.part not in self._world.product.parts
                or resting_part.posture != "upright"
                or resting_part.on_top
            ):
                continue
            size_m = self._world.product.parts[resting_part.part].size_m
            pixel = camera.project(exposure.world_from_camera, np.array([resting_part.world_from_part.position_m]))[0]
            if ((pixel > 0) & (pixel < (camera.width_px, camera.height_px))).all() and self._in_tray(resting_part.name):
                x, y = (int(value) for value in pixel)
                found.append(
                    PartDetection(
                        resting_part.part, 1.0, resting_part.world_from_part, size_m, (x - 9, y - 9, x + 9, y + 9)
                    )
                )
        return tuple(found)

    def _in_tray(self, name: str) -> bool:
        tray, place = self._world.bench.tray, self._world.data.body(name).xpos
        low = place[2] < tray.centre_m[2] + STANDS_M
        return low and bool((np.abs(place[:2] - np.array(tray.centre_m[:2])) < np.array(tray.size_m) / 2).all())

    def _visible(self, eye_m: Array, point_m: Array, of: str) -> bool:
        """Whether nothing but a body of this name hides a point from the camera."""
        model, data = self._world.model, self._world.data
        way = point_m - eye_m
        hit = np.zeros(1, np.int32)
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
        share = mujoco.mj_ray(model, data, eye_m, way, groups, 1, -1, hit)
        if share < 0 or share >= 1.0 - 1e-3:
            return True
        hides: str = model.body(int(model.geom_bodyid[hit[0]])).name
        return hides.startswith(of)


def ground_truth_perception(world: World, sensors: Mapping[str, SensorSetup], *, hand: bool) -> GroundTruthPerception:
    """One that shows the bench as it is at the beginning in every frame; renders once, for the first.

    Hands beside the first one are not in it: they would be seen there still when they are somewhere else.
    """
    beside = [int(world.model.joint(name).qposadr[0]) for name in _joints(world) if name.endswith(" hand_x")]
    world.data.qpos[beside] += AWAY_M
    world.update_poses()
    exposure = Exposure("overhead", 0, 0.0, world.camera_pose("overhead"), (visible_poses(world.data),))
    world.data.qpos[beside] -= AWAY_M
    world.update_poses()

    def still() -> Frame:
        with closing(Photographer(world.model, sensors)) as photographer:
            return photographer.take(exposure)

    return GroundTruthPerception(world, hand=hand, still=still)


def _joints(world: World) -> list[str]:
    return [world.model.joint(index).name for index in range(world.model.njnt)]


def _mark(image: NDArray[np.uint8], parts: tuple[PartDetection, ...]) -> None:
    """Show where parts are: an image that stays as it was when one is taken is a stuck one."""
    for part in parts:
        left, top, right, bottom = part.box_px
        box = image[max(top, 0) : bottom, max(left, 0) : right]
        box[...] = np.where(box < MARK_LEVELS, box + MARK_LEVELS, box - MARK_LEVELS)


def _in_hole(offset_m: Array) -> bool:
    return math.hypot(offset_m[0], offset_m[1]) < NEAR_HOLE_M and abs(offset_m[2]) < NEAR_HOLE_M
