"""A run as topics of ROS 2, for RViz, rosbag and rqt of a lab: nothing is listened to."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bracket_cell.plant.dds import LAST, Node, Quality
from bracket_cell.plant.ros_panel import Ros2Panel
from bracket_cell.plant.ros_scene import MARKERS, TF, header, markers, moved, stamp
from bracket_cell.plant.ros_types import message
from bracket_cell.recording.scene import (
    FRAMES_OF_BENCH,
    SCENE_OF_ASSEMBLY,
    SCENE_OF_BENCH,
    SCENE_OF_HANDS,
    SCENE_OF_PARTS,
    SceneLog,
)
from bracket_cell.recording.scene_frames import TOOL, WORLD, transform
from bracket_cell.recording.viewed import readable
from bracket_cell.settings import Ros2Settings
from bracket_cell.skills.drivers.settings import Ros2PanelSettings
from bracket_cell.skills.motion.outline import BASE
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_ground.interfaces.faults import Action

AGAIN_S = 1.0  # [s] between diagnostics, markers and frames that did not change
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/DiagnosticStatus
LEVELS: dict[Level, int] = {"info": 20, "warning": 30, "error": 40}  # rcl_interfaces/Log
TRANSFORMS = Quality(kept=100)  # tf2's own
SCENES = (SCENE_OF_BENCH, SCENE_OF_PARTS, SCENE_OF_ASSEMBLY, SCENE_OF_HANDS)


class RosTopics(Observer):
    """An observer that publishes each tick.

    Args:
        motion: of the arm, whose joints are called as in its URDF.
        scene: what viewers are shown.
        why: the robot does what it does, in words.

    Raises:
        InputError: as `Node`.
    """

    def __init__(self, settings: Ros2Settings, motion: MotionPlanner, scene: SceneLog, why: Callable[[], str]) -> None:
        node, self._scene, self._why = Node(settings), scene, why
        self._joints, self._forward = list(motion.settings.robot.joint_names), motion.kinematics.forward
        own = f"/{settings.namespace}"
        self._began_s = time.time()  # what a tick's time is counted from
        self.address = f"ROS 2, domain {settings.domain} on {settings.network}: /joint_states, /tf, {own}/..."
        self._states = node.publisher("/joint_states", "sensor_msgs/msg/JointState")
        self._tf = node.publisher("/tf", TF, TRANSFORMS)
        self._still = node.publisher("/tf_static", TF, LAST)
        self._diagnostics = node.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self._log = node.publisher("/rosout", "rcl_interfaces/msg/Log", Quality(kept=100, lasting=True))
        self._hands = node.publisher(f"{own}/hands", "geometry_msgs/msg/PoseArray")
        self._scenes = {topic: node.publisher(f"{own}{topic}", MARKERS, LAST) for topic in SCENES}
        self._words = Ros2Panel(Ros2PanelSettings(**settings.model_dump(exclude={"namespace"}), namespace=own))
        self._shown: dict[str, Any] = {}
        self._goals: dict[str, float] = {}
        self._diagnosed: tuple[Any, ...] = ()
        self._diagnosed_s = self._all_s = float("-inf")

    def tick(self, record: TickRecord) -> None:
        seen, now_s = record.observation, record.observation.time_s
        joints = seen.arm.known_rad(len(self._joints))
        if joints is not None:
            at_ns = self._at_ns(seen.arm.time_s)
            fields = {"name": self._joints, "position": list(joints), "velocity": list(seen.arm.velocities_rad_s)}
            self._states.write(message("sensor_msgs/msg/JointState")(header=header(at_ns), **fields, effort=[]))
            tool = transform(0, WORLD, TOOL, self._forward(np.array(joints)))
            self._tf.write(moved(at_ns, [readable(tool)]))
        if seen.bench is not None and seen.bench.time_s <= now_s:
            poses = [_pose(*hand.palm_m, hand.height_m or 0.0) for hand in seen.bench.hands]
            stamped = header(self._at_ns(seen.bench.time_s), WORLD)
            self._hands.write(message("geometry_msgs/msg/PoseArray")(header=stamped, poses=poses))
        if (display := record.command.display) is not None:
            self._words.show(display)
        self._show(now_s)
        self._diagnose(record, now_s)

    def message(self, time_s: float, level: Level, text: str) -> None:
        fields = {"name": "cell", "msg": text, "file": "", "function": "", "line": 0}
        at = stamp(self._at_ns(time_s))
        self._log.write(message("rcl_interfaces/msg/Log")(stamp=at, level=LEVELS.get(level, 40), **fields))

    def close(self, outcome: Outcome) -> None:
        self._words.say("robot", f"{outcome.end}: {outcome.reason}")

    def _show(self, now_s: float) -> None:
        """Markers that are new, and all of them again for who came later."""
        at_ns, again = self._at_ns(now_s), now_s - self._all_s >= AGAIN_S
        self._all_s = now_s if again else self._all_s
        for topic, publisher in self._scenes.items():
            scene = self._scene.last.get(topic)
            if scene is not None and (again or scene is not self._shown.get(topic)):
                self._shown[topic] = scene
                publisher.write(markers(at_ns, readable(scene)))
        if again:
            self._words.say("why", self._why())
        if again and FRAMES_OF_BENCH in self._scene.last:
            frames = readable(self._scene.last[FRAMES_OF_BENCH]).transforms
            self._still.write(moved(at_ns, [frame for frame in frames if frame.child_frame_id != BASE]))

    def _diagnose(self, record: TickRecord, now_s: float) -> None:
        """All that acts, one status a signal; of the cell itself, what the tree does, and how likely each goal is."""
        judged = record.judgement
        reasons = () if judged is None else judged.reasons
        for topic, fields in record.notes:
            if topic == "belief" and isinstance(goals := fields.get("goals"), dict):
                self._goals = goals
        if reasons == self._diagnosed and now_s - self._diagnosed_s < AGAIN_S:
            return
        self._diagnosed, self._diagnosed_s = reasons, now_s
        level = OK if judged is None or judged.action < Action.SLOW else WARN if judged.action < Action.STOP else ERROR
        made, value = (message(f"diagnostic_msgs/msg/{name}") for name in ("DiagnosticStatus", "KeyValue"))
        action = "run" if judged is None else judged.action.name.lower()
        known = {"tree": record.status} | {f"goal {goal}": f"{share:.3f}" for goal, share in self._goals.items()}
        values = [value(key=key, value=word) for key, word in known.items()]
        status = [made(level=level, name="cell", message=action, hardware_id="", values=values)]
        status += [
            made(level=level, name=f"cell: {name}", message=why, hardware_id="", values=[]) for name, why in reasons
        ]
        stamped = header(self._at_ns(now_s))
        self._diagnostics.write(message("diagnostic_msgs/msg/DiagnosticArray")(header=stamped, status=status))

    def _at_ns(self, time_s: float) -> int:
        """Time of ROS at a moment of the run."""
        return round((self._began_s + time_s) * 1e9)


def _pose(x: float, y: float, z: float) -> Any:
    return message("geometry_msgs/msg/Pose")(
        position=message("geometry_msgs/msg/Point")(x=x, y=y, z=z),
        orientation=message("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
    )
