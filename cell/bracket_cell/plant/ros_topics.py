"""A run as topics of ROS 2, for RViz, rosbag and rqt of a lab: nothing is listened to."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bracket_cell.plant.dds import LAST, Node, Quality
from bracket_cell.plant.ros_types import message
from bracket_cell.settings import Ros2Settings
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.pose import Array, Pose

WORLD, TOOL = "world", "tool"
DIAGNOSED_S = 1.0  # [s] between diagnostics that did not change
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/DiagnosticStatus
LEVELS: dict[Level, int] = {"info": 20, "warning": 30, "error": 40}  # rcl_interfaces/Log
TRANSFORMS = Quality(kept=100)  # tf2's own


class RosTopics(Observer):
    """An observer that publishes each tick.

    Args:
        joints: their names, in the order of the arm's state.
        forward: world_from_tool of joints.

    Raises:
        InputError: as `Node`.
    """

    def __init__(self, settings: Ros2Settings, joints: Sequence[str], forward: Callable[[Array], Pose]) -> None:
        node, self._joints, self._forward = Node(settings), list(joints), forward
        own = f"/{settings.namespace}"
        self._began_s = time.time()  # what a tick's time is counted from
        self.address = f"ROS 2, domain {settings.domain} on {settings.network}: /joint_states, /tf, {own}/..."
        self._states = node.publisher("/joint_states", "sensor_msgs/msg/JointState")
        self._tf = node.publisher("/tf", "tf2_msgs/msg/TFMessage", TRANSFORMS)
        self._diagnostics = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self._log = node.publisher("/rosout", "rcl_interfaces/msg/Log", Quality(kept=100, lasting=True))
        self._hands = node.publisher(f"{own}/hands", "geometry_msgs/msg/PoseArray")
        self._words = {
            name: node.publisher(f"{own}/{name}", "std_msgs/msg/String", LAST) for name in ("robot", "guidance")
        }
        self._said: dict[str, str] = {}
        self._diagnosed: tuple[Any, ...] = ()
        self._diagnosed_s = float("-inf")

    def tick(self, record: TickRecord) -> None:
        seen, now_s = record.observation, record.observation.time_s
        joints = seen.arm.known_rad(len(self._joints))
        if joints is not None:
            header = self._header(seen.arm.time_s, "")
            told = {"name": self._joints, "position": list(joints), "velocity": list(seen.arm.velocities_rad_s)}
            self._states.write(message("sensor_msgs/msg/JointState")(header=header, **told, effort=[]))
            self._tf.write(self._moved(seen.arm.time_s, self._forward(np.array(joints))))
        if seen.bench is not None and seen.bench.time_s <= now_s:
            poses = [_pose((*hand.palm_m, hand.height_m or 0.0)) for hand in seen.bench.hands]
            self._hands.write(
                message("geometry_msgs/msg/PoseArray")(header=self._header(seen.bench.time_s, WORLD), poses=poses)
            )
        if (display := record.command.display) is not None:
            self._say("robot", display.message)
            self._say("guidance", "; ".join(f"{part}: {', '.join(at)}" for part, at in display.guidance.items()))
        self._diagnose(record, now_s)

    def message(self, time_s: float, level: Level, text: str) -> None:
        told = {"name": "cell", "msg": text, "file": "", "function": "", "line": 0}
        self._log.write(
            message("rcl_interfaces/msg/Log")(stamp=self._stamp(time_s), level=LEVELS.get(level, 40), **told)
        )

    def close(self, outcome: Outcome) -> None:
        self._say("robot", f"{outcome.end}: {outcome.reason}")

    def _say(self, name: str, text: str) -> None:
        if self._said.get(name) != text:
            self._said[name] = text
            self._words[name].write(message("std_msgs/msg/String")(data=text))

    def _diagnose(self, record: TickRecord, now_s: float) -> None:
        """All that acts, one status a signal."""
        judged = record.judgement
        reasons = () if judged is None else judged.reasons
        if reasons == self._diagnosed and now_s - self._diagnosed_s < DIAGNOSED_S:
            return
        self._diagnosed, self._diagnosed_s = reasons, now_s
        level = OK if judged is None or judged.action < Action.SLOW else WARN if judged.action < Action.STOP else ERROR
        made = message("diagnostic_msgs/msg/DiagnosticStatus")
        action = "run" if judged is None else judged.action.name.lower()
        status = [made(level=level, name="cell", message=action, hardware_id="", values=[])]
        status += [
            made(level=level, name=f"cell: {name}", message=why, hardware_id="", values=[]) for name, why in reasons
        ]
        header = self._header(now_s, "")
        self._diagnostics.write(message("diagnostic_msgs/msg/DiagnosticArray")(header=header, status=status))

    def _stamp(self, time_s: float) -> Any:
        at_ns = round((self._began_s + time_s) * 1e9)
        return message("builtin_interfaces/msg/Time")(sec=at_ns // 10**9, nanosec=at_ns % 10**9)

    def _header(self, time_s: float, frame: str) -> Any:
        return message("std_msgs/msg/Header")(stamp=self._stamp(time_s), frame_id=frame)

    def _moved(self, time_s: float, pose: Pose) -> Any:
        placed, (x, y, z) = _pose(pose.position_m, pose.quaternion_wxyz), pose.position_m
        moved = message("geometry_msgs/msg/Transform")(
            translation=message("geometry_msgs/msg/Vector3")(x=x, y=y, z=z), rotation=placed.orientation
        )
        stamped = message("geometry_msgs/msg/TransformStamped")(
            header=self._header(time_s, WORLD), child_frame_id=TOOL, transform=moved
        )
        return message("tf2_msgs/msg/TFMessage")(transforms=[stamped])


def _pose(
    position_m: tuple[float, float, float], quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
) -> Any:
    (x, y, z), (w, i, j, k) = position_m, quaternion_wxyz
    return message("geometry_msgs/msg/Pose")(
        position=message("geometry_msgs/msg/Point")(x=x, y=y, z=z),
        orientation=message("geometry_msgs/msg/Quaternion")(x=i, y=j, z=k, w=w),
    )
