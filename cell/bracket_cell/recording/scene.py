"""Channels for viewers such as Foxglove and Lichtblick: frames, bodies, overlays, calibration and joint states.

Nothing here is read back by `cell replay`: all of it follows from what the log holds elsewhere. It is written where it
changes, so that it costs a tick little.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import foxglove
from foxglove import messages
from foxglove.channels import (
    CameraCalibrationChannel,
    FrameTransformChannel,
    FrameTransformsChannel,
    ImageAnnotationsChannel,
    JointStatesChannel,
    SceneUpdateChannel,
)

from bracket_cell.recording.scene_bodies import assembly_scene, bench_scene, hands_scene, parts_scene, robot_scene
from bracket_cell.recording.scene_frames import (
    BRACKET,
    TRAY,
    WORLD,
    HoleMarks,
    RobotFrames,
    hand_overlay,
    parts_overlay,
    still_frames,
    timestamp,
    transform,
)
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import TickRecord
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, GripperState, Observation
from bracket_ground.interfaces.perception import BenchView, HandSample, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

FRAMES_OF_ROBOT, FRAMES_OF_BENCH, FRAME_OF_CAMERA = "/tf/robot", "/tf/bench", "/tf/camera_{}"
SCENE_OF_ROBOT, SCENE_OF_BENCH = "/scene/robot", "/scene/bench"
SCENE_OF_PARTS, SCENE_OF_ASSEMBLY, SCENE_OF_HANDS = "/scene/parts", "/scene/assembly", "/scene/hands"
CALIBRATION = "/camera/{}/calibration"
HAND, HOLES, PARTS = "/camera/overhead/hand", "/camera/overhead/holes", "/camera/wrist/parts"
JOINT_STATES = "/joint_states"
CAMERAS = ("overhead", "wrist")
ARM_STEP_RAD, OPENING_STEP_M = 1e-5, 1e-5  # smaller motions are not worth a message


@dataclass(frozen=True)
class CellModel:
    """What a viewer must know of a cell.

    Attributes:
        motion: of the arm; its kinematics and shapes are shown.
    """

    product: Product
    bench: Bench
    motion: MotionPlanner


class SceneLog:
    """Writes what viewers show into the channels of a context.

    Attributes:
        last: the newest message of each topic.
    """

    def __init__(self, context: foxglove.Context, cell: CellModel) -> None:
        self._context, self._product, self._bench = context, cell.product, cell.bench
        shapes, self._joint_names = cell.motion.robot_shapes, cell.motion.settings.robot.joints
        self._frames = RobotFrames(cell.motion.kinematics, shapes)
        self._holes = HoleMarks(cell.product, cell.bench)
        self._joint_states = JointStatesChannel(JOINT_STATES, context=context)
        self._channels: dict[str, Any] = {
            FRAMES_OF_ROBOT: FrameTransformsChannel(FRAMES_OF_ROBOT, context=context),
            FRAMES_OF_BENCH: FrameTransformsChannel(FRAMES_OF_BENCH, context=context),
            HAND: ImageAnnotationsChannel(HAND, context=context),
            HOLES: ImageAnnotationsChannel(HOLES, context=context),
            PARTS: ImageAnnotationsChannel(PARTS, context=context),
        }
        self._persons = cell.motion.separation.persons
        for topic in (SCENE_OF_ROBOT, SCENE_OF_BENCH, SCENE_OF_PARTS, SCENE_OF_ASSEMBLY, SCENE_OF_HANDS):
            self._channels[topic] = SceneUpdateChannel(topic, context=context)
        self.last: dict[str, Any] = {}
        self._arm: ArmState | None = None
        self._gripper: GripperState | None = None
        self._bench_view: BenchView | None = None
        self._parts_view: PartsView | None = None
        self._read: dict[str, tuple[str | None, bool]] | None = None
        self._placed: dict[str, str] = {}
        self._guidance: dict[str, tuple[str, ...]] = {}
        self._camera_poses: dict[str, Pose] = {}
        self._hands_n = 0
        self._begin(robot_scene(0, shapes))

    def _begin(self, robot: messages.SceneUpdate) -> None:
        """What stands still, once."""
        bench, tray = self._bench, self._bench.tray
        frames = {BRACKET: bench.bracket.pose, TRAY: Pose(tray.centre_m)}
        self._put(FRAMES_OF_BENCH, still_frames(0, frames), 0)
        self._put(SCENE_OF_BENCH, bench_scene(0, self._product, bench), 0)
        self._put(SCENE_OF_ROBOT, robot, 0)
        for name, setup in zip(CAMERAS, (bench.overhead, bench.wrist), strict=True):
            pose = FRAME_OF_CAMERA.format(name)
            self._channels[pose] = FrameTransformChannel(pose, context=self._context)
            topic = CALIBRATION.format(name)
            self._channels[topic] = CameraCalibrationChannel(topic, context=self._context)
            self._put(topic, _calibration(name, setup), 0)

    def frame(self, frame: Frame, stamp_ns: int) -> None:
        """Where a camera took a picture; its frame stays there until the next one."""
        if self._camera_poses.get(frame.camera) == frame.world_from_camera:
            return
        self._camera_poses[frame.camera] = frame.world_from_camera
        topic, name = FRAME_OF_CAMERA.format(frame.camera), f"camera_{frame.camera}"
        if topic not in self._channels:
            self._channels[topic] = FrameTransformChannel(topic, context=self._context)
        self._put(topic, transform(stamp_ns, WORLD, name, frame.world_from_camera), stamp_ns)

    def tick(self, record: TickRecord, stamp_ns: int) -> None:
        """What this tick saw and believed, where it is new."""
        seen = record.observation
        self._robot(seen, stamp_ns)
        if seen.bench is not None and seen.bench is not self._bench_view:
            self._bench_view = seen.bench
            self._put(HAND, hand_overlay(stamp_ns, seen.bench), stamp_ns)
            self._mark_holes(seen.bench.holes, stamp_ns)
            self._hands(seen.bench.hands, stamp_ns)
        if seen.parts is not None and seen.parts is not self._parts_view:
            self._parts_view = seen.parts
            parts = seen.parts.detections
            self._put(PARTS, parts_overlay(stamp_ns, self._product, parts), stamp_ns)
            self._put(SCENE_OF_PARTS, parts_scene(stamp_ns, self._product, parts), stamp_ns)
        self._assembly(record, stamp_ns)

    def repeat(self, topics: Iterable[str], stamp_ns: int) -> None:
        """Say again what was last said on these topics, for a viewer that came later."""
        for topic in topics:
            if topic in self.last:
                self._channels[topic].log(self.last[topic], log_time=stamp_ns)

    def repeat_all(self, stamp_ns: int) -> None:
        """Say again everything that was said, for a new file."""
        self.repeat(list(self.last), stamp_ns)

    def _robot(self, seen: Observation, stamp_ns: int) -> None:
        arm, gripper = seen.arm, seen.gripper
        values = zip(self._joint_names, arm.positions_rad, arm.velocities_rad_s, strict=False)  # as many as are told
        states = [messages.JointState(name=name, position=angle, velocity=speed) for name, angle, speed in values]
        self._joint_states.log(messages.JointStates(timestamp=timestamp(stamp_ns), joints=states), log_time=stamp_ns)
        if arm.known_rad(len(self._joint_names)) is None or self._stands(arm, gripper):
            return
        self._arm, self._gripper = arm, gripper
        self._put(FRAMES_OF_ROBOT, self._frames.message(stamp_ns, arm, gripper), stamp_ns)

    def _stands(self, arm: ArmState, gripper: GripperState) -> bool:
        if (
            self._arm is None
            or self._gripper is None
            or abs(gripper.opening_m - self._gripper.opening_m) > OPENING_STEP_M
        ):
            return False
        pairs = zip(arm.positions_rad, self._arm.positions_rad, strict=True)
        return all(abs(now - before) <= ARM_STEP_RAD for now, before in pairs)

    def _hands(self, hands: Sequence[HandSample], stamp_ns: int) -> None:
        if hands or self._hands_n:
            self._put(SCENE_OF_HANDS, hands_scene(stamp_ns, [self._persons.wall(hand) for hand in hands]), stamp_ns)
        self._hands_n = len(hands)

    def _mark_holes(self, holes: Any, stamp_ns: int) -> None:
        read = {position: (hole.part, hole.upright) for position, hole in holes.items()}
        if read != self._read:
            self._read = read
            self._put(HOLES, self._holes.message(stamp_ns, holes), stamp_ns)

    def _assembly(self, record: TickRecord, stamp_ns: int) -> None:
        placed, guidance = self._placed, self._guidance
        for topic, fields in record.notes:
            if topic == "belief" and isinstance(known := fields.get("placed"), dict):
                placed = known
        if record.command.display is not None:
            guidance = dict(record.command.display.guidance)
        if (placed, guidance) != (self._placed, self._guidance) or SCENE_OF_ASSEMBLY not in self.last:
            self._placed, self._guidance = placed, guidance
            scene = assembly_scene(stamp_ns, self._product, placed, guidance)
            self._put(SCENE_OF_ASSEMBLY, scene, stamp_ns)

    def _put(self, topic: str, message: Any, stamp_ns: int) -> None:
        self.last[topic] = message
        self._channels[topic].log(message, log_time=stamp_ns)


def _calibration(name: str, setup: CameraSetup) -> messages.CameraCalibration:
    """Of an undistorted camera; the frame is that of its images."""
    k = setup.model.matrix.ravel().tolist()
    return messages.CameraCalibration(
        timestamp=timestamp(0),
        frame_id=f"camera_{name}",
        width=setup.width_px,
        height=setup.height_px,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=k,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0],
    )
