"""Frames of the overhead camera, and where every hand in them really is.

Where the arm is parked, it is put into another pose of its work in every stretch of frames, mostly with a part between
its fingers, so that detectors see it beside hands; where it hands a part over, it stays as it is. In frames to learn
from, some hands are turned, so that they come from every side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.files.data_folder import DataFolder
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Side
from bracket_ground.interfaces.pose import Array
from bracket_lab.drawing.recording import CAMERA, Moment, Source
from bracket_lab.drawing.sight import (
    CAMERA_POSITIONS,
    GEOM_POSITIONS,
    GEOM_TURNS,
    SITE_POSITIONS,
    Box,
    Projection,
    fingertip,
)
from bracket_lab.drawing.working_arm import TurnedHand, WorkingArm
from bracket_sim.rendering.studio import ScenePoses, show_poses
from bracket_sim.scene.furniture import AIM_M
from bracket_sim.scene.look import Light
from bracket_sim.scene.world import World

FRAMES = 16  # of each recording
RAISED_SHARE = 0.5  # of them are drawn evenly over the palm's height, the others evenly over time
HEIGHT_STEP_M = 0.03
EVERY_STRETCH = 45  # frames in which the arm stands still, where all are written
POINTS = ("palm", "pinch", "thumb", "index", "wrist", "radial", "ulnar", "held")  # radial: the thumb's edge of the palm
THUMB_TIP, INDEX_KNUCKLE, INDEX_TIP, LITTLE_KNUCKLE = 4, 5, 8, 17  # of a human hand's joints
FOREARM_BEGINS = 1.8  # of the way from the palm to a human wrist: as far as a drawn hand's, so that sizes compare
HALF_PALM = 0.62  # of the way between the outer knuckles: with the flesh beside them
BLOCKS_M = 0.02  # what is nearer to the camera than a point by more hides it
SHOWN_GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)


@dataclass(frozen=True)
class HandTruth:
    """One hand in one frame.

    Attributes:
        acting: it is the hand that works, not the one that rests.
        box_px: (left, top, right, bottom) of the hand without its sleeve, and of what it holds.
        visible: share of its shapes whose middles are in the image and hidden by nothing.
        points_m: (x, y, z) by name in POINTS; `held` only where something is held.
        points_px: (column, row) of the same, by the camera's true lens and place.
        joints_px: (column, row) of a human hand's 21 joints, in the order of MediaPipe's landmarks.
    """

    acting: bool
    side: Side
    box_px: Box
    held_part: str | None
    visible: float
    points_m: dict[str, tuple[float, float, float]]
    points_px: dict[str, tuple[float, float]]
    joints_px: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class HandFrame:
    """A frame, all hands that reach into it, where the gripper's fingertips are, and the poses that it was taken of.

    Attributes:
        tool_px: (column, row), also where it is out of the image.
        shadows_px: (column, row) of the shadows that hands and gripper throw on the table, where a lamp throws any.
    """

    frame: Frame
    hands: tuple[HandTruth, ...]
    tool_px: tuple[float, float]
    shadows_px: tuple[tuple[float, float], ...]
    poses: ScenePoses


def write_hands(source: Source, folder: DataFolder, every: bool = False) -> None:
    """Rows of hands.jsonl: whole frames with all hands in them.

    Args:
        every: all frames of the recording, in their order.
    """
    assembly = source.assembly
    rng = np.random.default_rng([assembly.seed, 4])
    count = len(assembly.moments)
    shares = shares_by_height(np.array([moment.palm_m[2] for moment in assembly.moments]))
    chosen = np.sort(rng.choice(count, min(FRAMES, count), replace=False, p=shares))
    stretches = [range(index, index + 1) for index in chosen]
    if every:
        stretches = every_frame(count)
    for seen in hand_frames(source, stretches, turned=not every):
        file = folder.image(f"images/{source.name}-{seen.frame.sequence:06d}.jpg", seen.frame.image)
        row = {"file": file, "log": source.name, "frame": seen.frame.sequence, "time_s": round(seen.frame.time_s, 4)}
        fields = {"hands": [_row(hand) for hand in seen.hands], "tool_px": seen.tool_px, "decoys_px": seen.shadows_px}
        folder.row("hands", {**row, **fields})


def every_frame(count: int) -> list[range]:
    """All frames of a recording in stretches, between which the arm moves."""
    return [range(first, min(first + EVERY_STRETCH, count)) for first in range(0, count, EVERY_STRETCH)]


def visible_shares(source: Source, numbers: Sequence[int]) -> list[float]:
    """How much of the hand that works shows at some moments of a recording, as it is: nothing else in the way."""
    assembly = source.assembly
    projection = Projection(assembly.world, CAMERA, source.bench.overhead, assembly.look)
    hand, data = _hands_of(source)[0], mujoco.MjData(assembly.world.model)
    found = []
    for number in numbers:
        moment = assembly.moments[number]
        show_poses(data, poses := moment.exposure.moments[-1])
        found.append(hand.shown(moment, poses, assembly.held[number], projection, data))
    return found


def shares_by_height(palms_m: Array) -> Array:
    """(n,) how often each of so high palms is drawn: a hand is seldom high over the table, but must be read there."""
    steps = np.round(palms_m / HEIGHT_STEP_M)
    kinds, which, counts = np.unique(steps, return_inverse=True, return_counts=True)
    shares: Array = RAISED_SHARE / (len(kinds) * counts[which]) + (1 - RAISED_SHARE) / len(palms_m)
    return shares


def hand_frames(source: Source, stretches: Sequence[range], *, turned: bool = False) -> Iterator[HandFrame]:
    """The frames of stretches of moments, given in order; in each stretch the arm stands still.

    Args:
        turned: in some stretches, the hand that works is turned about its fingertips.
    """
    assembly, bench = source.assembly, source.bench
    photographer = assembly.photographer(bench)
    projection = Projection(assembly.world, CAMERA, bench.overhead, assembly.look)
    arm = WorkingArm(assembly.world, bench.arm_look_rad, np.random.default_rng([assembly.seed, 3]))
    hands = _hands_of(source)
    turns = TurnedHand(assembly.world, np.random.default_rng([assembly.seed, 6]))
    data = mujoco.MjData(assembly.world.model)
    for stretch in stretches:
        moments = [assembly.moments[index] for index in stretch]
        works = assembly.robot_works or any(arm.moved(assembly.moments[0], moment) for moment in moments)
        pose, turn_rad = None if works else arm.draw(moments), turns.draw() if turned else 0.0
        for index in stretch:
            moment, held = assembly.moments[index], assembly.held[index]
            part = hands[0].part(moment, held)
            exposed = (turns.put(instant, moment.fingertips_m, part, turn_rad) for instant in moment.exposure.moments)
            exposure = replace(moment.exposure, moments=tuple(arm.put(instant, pose) for instant in exposed))
            poses = exposure.moments[-1]
            show_poses(data, poses)
            truths = (hand.truth(moment, poses, held, projection, data) for hand in hands)
            seen = tuple(hand_truth for hand_truth in truths if hand_truth is not None)
            tool_m = arm.fingertips_m(poses)
            thrown = on_table(assembly.look.light, np.array([tool_m, *(_middle_m(hand) for hand in seen)]))
            tool, *shadows = (_rounded(px, 2) for px in projection.pixels(poses, np.array([tool_m, *thrown])))
            frame = photographer.take(exposure).beside(arm.points_m(poses, pose))
            yield HandFrame(frame, seen, tool, tuple(shadows), poses)  # type: ignore[arg-type]
    photographer.close()


def on_table(light: Light, points_m: Array) -> Array:
    """Where the shadows of points (n, 3) fall on the table, (n, 3); none, (0, 3), where no lamp throws shadows."""
    if not light.shadows or light.lamps_n == 0:
        return np.empty((0, 3))
    way = np.array(AIM_M) - light.lamps[0].position_m
    fallen: Array = points_m - points_m[:, 2:] / way[2] * way
    return fallen


@dataclass(frozen=True, eq=False)
class _HandModel:
    """The shapes of one hand in the compiled world.

    Attributes:
        geoms: all but the sleeve.
        palm, thumb, index, wrist: geom ids; the tips are the far ends of theirs.
        joints: sites of a human hand's 21 joints and its palm; they tell better than shapes.
    """

    world: World
    acting: bool
    side: Side
    geoms: NDArray[np.int64]
    palm: int
    thumb: int
    index: int
    wrist: int
    joints: NDArray[np.int64]

    def truth(
        self, moment: Moment, poses: ScenePoses, held: str | None, projection: Projection, data: mujoco.MjData
    ) -> HandTruth | None:
        """The hand at a moment; None where it is out of the image."""
        part = self.part(moment, held)
        geoms = np.concatenate([self.geoms, part])
        box = projection.box(poses, geoms)
        if box is None:
            return None
        centres = poses[GEOM_POSITIONS]
        joints_m = poses[SITE_POSITIONS][self.joints]
        palm_m, wrist_m, thumb, index, across = self._landmarks(poses, joints_m)
        points = {
            "palm": palm_m,
            "pinch": moment.fingertips_m if self.acting else (thumb + index) / 2,
            "thumb": thumb,
            "index": index,
            "wrist": wrist_m,
            "radial": palm_m + across,
            "ulnar": palm_m - across,
        } | ({"held": centres[part].mean(axis=0)} if len(part) else {})
        pixels = projection.pixels(poses, np.array(list(points.values())))
        return HandTruth(
            acting=self.acting,
            side=self.side,
            box_px=box,
            held_part=held if self.acting else None,
            visible=self._visible(poses, geoms, projection, data),
            points_m={name: _rounded(value, 5) for name, value in points.items()},  # type: ignore[misc]
            points_px={name: _rounded(px, 2) for name, px in zip(points, pixels, strict=True)},  # type: ignore[misc]
            joints_px=tuple(_rounded(px, 2) for px in projection.pixels(poses, joints_m[:-1])),  # type: ignore[misc]
        )

    def _landmarks(self, poses: ScenePoses, joints_m: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Palm, wrist, tips of thumb and index finger, and the way from the palm to its edge at the thumb's side."""
        if len(joints_m):
            edge = (joints_m[INDEX_KNUCKLE] - joints_m[LITTLE_KNUCKLE]) * HALF_PALM
            palm_m = joints_m[-1]
            wrist_m = palm_m + FOREARM_BEGINS * (joints_m[0] - palm_m)
            return palm_m, wrist_m, joints_m[THUMB_TIP], joints_m[INDEX_TIP], edge
        centres = poses[GEOM_POSITIONS]
        palm_m = centres[self.palm]
        thumb, index = (fingertip(self.world.model, poses, bone, palm_m) for bone in (self.thumb, self.index))
        return palm_m, centres[self.wrist], thumb, index, self._across(poses, thumb)

    def shown(
        self, moment: Moment, poses: ScenePoses, held: str | None, projection: Projection, data: mujoco.MjData
    ) -> float:
        """How much of it shows at a moment."""
        return self._visible(poses, np.concatenate([self.geoms, self.part(moment, held)]), projection, data)

    def part(self, moment: Moment, held: str | None) -> NDArray[np.int64]:
        """Shapes of the held part."""
        if held is None or not self.acting:
            return np.empty(0, np.int64)
        away = np.linalg.norm(moment.parts_m - moment.fingertips_m, axis=1)
        bodies = self.world.bodies
        nearest = min((index for index, body in enumerate(bodies) if body.part == held), key=lambda index: away[index])
        model = self.world.model
        return np.flatnonzero((model.geom_bodyid == bodies[nearest].body) & (model.geom_group < 3))

    def _across(self, poses: ScenePoses, thumb: Array) -> Array:
        """From the middle of the palm to its edge at the thumb's side."""
        half: Array = poses[GEOM_TURNS][self.palm].reshape(3, 3)[:, 1] * self.world.model.geom_size[self.palm][1]
        return half if half @ (thumb - poses[GEOM_POSITIONS][self.palm]) > 0 else -half

    def _visible(self, poses: ScenePoses, own: NDArray[np.int64], projection: Projection, data: mujoco.MjData) -> float:
        model, eye = self.world.model, poses[CAMERA_POSITIONS][projection.camera]
        points = poses[GEOM_POSITIONS][self.geoms]
        inside = projection.inside(projection.pixels(poses, points))
        hit = np.zeros(1, np.int32)
        seen = 0
        for point in points[inside]:
            way = point - eye
            length_m = float(np.linalg.norm(way))
            reached_m = mujoco.mj_ray(model, data, eye, way / length_m, SHOWN_GROUPS, 1, -1, hit, None)
            seen += bool(hit[0] in own or reached_m < 0 or reached_m > length_m - BLOCKS_M)
        return round(seen / len(points), 3)


def _hands_of(source: Source) -> list[_HandModel]:
    world, person = source.assembly.world, source.assembly.look.person
    model = world.model

    def shown(body: str) -> list[int]:
        return [int(i) for i in np.flatnonzero((model.geom_bodyid == model.body(body).id) & (model.geom_group < 3))]

    def joints(body: str) -> NDArray[np.int64]:
        names = [model.site(index).name for index in range(model.nsite)]
        return np.array([i for i, name in enumerate(names) if name.startswith(f"{body}_joint_")], np.int64)

    sides: tuple[Side, Side] = ("left", "right") if person.left_hand else ("right", "left")
    palm, *_, wrist, _ = hand = shown("hand")  # the sleeve is the last
    thumb, index = shown("hand_thumb") or [palm], shown("hand_index") or [palm]
    bends = "hand_fingers" in {model.body(body).name for body in range(model.nbody)}
    moving = [geom for body in ("hand_thumb", "hand_index") for geom in shown(body)]
    geoms = np.array(hand[:-1] + moving + (shown("hand_fingers") if bends else []))
    found = [_HandModel(world, True, sides[0], geoms, palm, thumb[0], index[0], wrist, joints("hand"))]
    if person.second_hand:
        palm, first, *_, last, wrist, _ = rest = shown("second_hand")
        at = joints("second_hand")
        found.append(_HandModel(world, False, sides[1], np.array(rest[:-1]), palm, last, first, wrist, at))
    return found


def _middle_m(hand: HandTruth) -> Array:
    middle: Array = np.array([hand.points_m["palm"], hand.points_m["pinch"]]).mean(axis=0)
    return middle


def _rounded(values: Array, digits: int) -> tuple[float, ...]:
    return tuple(round(float(value), digits) for value in values)


def _row(hand: HandTruth) -> dict[str, object]:
    return {name: getattr(hand, name) for name in HandTruth.__dataclass_fields__}
