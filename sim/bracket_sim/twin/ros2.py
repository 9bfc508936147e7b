"""The twin behind topics, services and actions of ROS 2, named as ur_robot_driver and ros2_robotiq_gripper name them.

Its services answer clients of rmw_cyclonedds_cpp; its topics are for any. Its arm follows goals as
scaled_joint_trajectory_controller does: the newest in place of the one before, by their stamps, from where it is to the
first point of one that begins later, as slowly as the slider says.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.plant.dds import LAST, Node, Quality
from bracket_cell.plant.ros_services import ActionServer, Answerer, Status
from bracket_cell.plant.ros_types import empty, message
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.twin.cameras import ImageFaults, Photographer, jpeg
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.controller import BRAKING_RAD_S2, Controller, Runtime, Safety
from bracket_sim.twin.ur_faults import offer_faults

TRAJECTORY, GRIP = "control_msgs/action/FollowJointTrajectory", "control_msgs/action/GripperCommand"
JOINTS, TRIGGER = "sensor_msgs/msg/JointState", "std_srvs/srv/Trigger"
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
AWAY_S = 1.5  # that a driver is gone for which is started again
TOLERANCE = -4  # PATH_TOLERANCE_VIOLATED of FollowJointTrajectory
OPEN_AT, CLOSED_AT = 0.0, 0.7929  # of a 2F-85's knuckle [rad]
GRIP_MM_S, GRIPPER_S = 150.0, 0.02  # the speed of the gripper's driver; between what it tells
SLOW_S = 0.1  # between modes and terminals that do not change
MOVING, ACTIVE, AT_POSITION = 0, 3, 3  # gOBJ, gSTA, gOBJ
PINS = 18


@dataclass(frozen=True)
class Place:
    """Where topics are."""

    domain: int
    network: str


def node_of(settings: Mapping[str, Any]) -> Node:
    """The node that a device's settings mean."""
    return Node(Place(int(settings["domain"]), str(settings["network"])))


class RosTime:
    """Time of the twin's nodes: the wall's as it began, and from then on the world's."""

    def __init__(self, cell: TwinCell) -> None:
        self._cell, self._began_s = cell, time.time() - cell.now_s()

    def header(self, time_s: float, frame: str = "") -> Any:
        """Of a message about a moment of the world."""
        at_ns = round((self._began_s + time_s) * 1e9)
        stamp = message("builtin_interfaces/msg/Time")(sec=at_ns // 10**9, nanosec=at_ns % 10**9)
        return message("std_msgs/msg/Header")(stamp=stamp, frame_id=frame)

    def world_s(self, stamp: Any) -> float:
        """When it is by the world's time; now for a stamp of 0."""
        ros_s = float(stamp.sec + stamp.nanosec * 1e-9)
        return ros_s - self._began_s if ros_s else self._cell.now_s()


class RosArm:
    """The arm's driver and controllers.

    Attributes:
        banner: what it serves.
        asked_rad: set points of the last cycle on a goal, (n,).
        late_until_s, silent_until_s: joints wait until then and come at once, or do not come.
    """

    def __init__(self, cell: TwinCell, role: str) -> None:
        self._cell, self._settings, self._clock = cell, cell.settings[role], RosTime(cell)
        self.controller, self._arm = Controller(cell), cell.arm
        self._names = [f"{self._settings['prefix']}{name}" for name in cell.sim.world.robot.joint_names]
        self._path: tuple[Array, Array] | None = None  # times, joints
        self._along_s, self.asked_rad = 0.0, cell.arm.measured.positions_rad
        self.late_until_s = self.silent_until_s = self._back_s = self._slow_s = 0.0
        self._late: list[Any] = []
        self._modes: dict[str, Any] = {}
        self.banner = f"{role}: ROS 2, domain {self._settings['domain']}: joint_states, {self._settings['controller']}"
        self._open()
        offer_faults(cell, self.controller, self, "joints")
        cell.each_period(self._cycle)

    def close(self) -> None:
        """Its nodes are gone."""
        self._services: list[tuple[Answerer, Callable[[Any], Mapping[str, Any]]]] = []

    def cut(self) -> None:
        """The driver ends, and is started again: goals are forgotten, its program waits."""
        self.controller.stop_program()
        self._path, self._services, self._modes = None, [], {}
        self._back_s = self._cell.now_s() + AWAY_S

    def _open(self) -> None:
        node, own = node_of(self._settings), str(self._settings["namespace"])
        io = f"{own}/io_and_status_controller"
        self._action = ActionServer(
            node,
            f"{own}/{self._settings['controller']}/follow_joint_trajectory",
            TRAJECTORY,
            self._accept,
            self._cancel,
        )
        self._joints = node.publisher(f"{own}/joint_states", JOINTS)
        self._io = node.publisher(f"{io}/io_states", "ur_msgs/msg/IOStates")
        self._scaling = node.publisher(f"{own}/speed_scaling_state_broadcaster/speed_scaling", "std_msgs/msg/Float64")
        self._told_modes = {
            "robot": node.publisher(f"{io}/robot_mode", "ur_dashboard_msgs/msg/RobotMode", LAST),
            "safety": node.publisher(f"{io}/safety_mode", "ur_dashboard_msgs/msg/SafetyMode", LAST),
            "running": node.publisher(f"{io}/robot_program_running", "std_msgs/msg/Bool", LAST),
        }
        triggers: dict[str, Callable[[], object]] = {
            f"{own}/dashboard_client/unlock_protective_stop": self.controller.unlock,
            f"{own}/dashboard_client/power_on": self.controller.power_on,
            f"{own}/dashboard_client/brake_release": self.controller.release_brakes,
            f"{io}/resend_robot_program": self._run_program,
        }
        self._services = [(Answerer(node, name, TRIGGER), partial(_triggered, act)) for name, act in triggers.items()]
        self._services += [
            (Answerer(node, f"{io}/set_io", "ur_msgs/srv/SetIO"), self._set_io),
            (Answerer(node, f"{io}/set_payload", "ur_msgs/srv/SetPayload"), self._set_payload),
        ]
        self._run_program()

    def _run_program(self) -> bool:
        """External Control begins."""
        able = self.controller.takes_programs
        if able:
            self.controller.runtime = Runtime.PLAYING
        return able

    def _set_io(self, asked: Any) -> Mapping[str, Any]:
        known = asked.fun == 1 and 0 <= asked.pin < PINS
        if known:
            bit = 1 << asked.pin
            self.controller.outputs = self.controller.outputs | bit if asked.state else self.controller.outputs & ~bit
        return {"success": known}

    def _set_payload(self, asked: Any) -> Mapping[str, Any]:
        centre = asked.center_of_gravity
        self.controller.payload_kg, self.controller.payload_cog_m = asked.mass, (centre.x, centre.y, centre.z)
        return {"success": True}

    def _accept(self, goal: Any) -> bool:
        """Whether a trajectory is taken; it is followed from now on."""
        points, names = goal.trajectory.points, list(goal.trajectory.joint_names)
        times_s = np.array([point.time_from_start.sec + point.time_from_start.nanosec * 1e-9 for point in points])
        begun_s = self._clock.world_s(goal.trajectory.header.stamp)
        able = self.controller.runtime is Runtime.PLAYING and sorted(names) == sorted(self._names)
        late = len(points) == 0 or begun_s + times_s[-1] < self._cell.now_s()
        if not able or late or (np.diff(times_s) <= 0).any():
            return False
        joints = np.array([point.positions for point in points])[:, [names.index(name) for name in self._names]]
        self._along_s = self._cell.now_s() - begun_s
        if self._along_s < times_s[0]:
            at_rad = self._arm.measured.positions_rad if self._path is None else self.asked_rad
            times_s, joints = np.append(self._along_s, times_s), np.vstack([at_rad, joints])
        self._path = times_s, joints
        self._cell.person_comes()
        return True

    def _cancel(self) -> None:
        self._path = None
        self._arm.stop(BRAKING_RAD_S2)
        self._action.end(Status.CANCELED, empty(f"{TRAJECTORY}_Result"))

    def _cycle(self, time_s: float) -> None:
        if self._back_s:
            if time_s < self._back_s:
                return
            self._back_s = 0.0
            self._open()
        self._action.serve()
        for service, act in self._services:
            for asked in service.asked():
                service.reply(asked, **act(asked))
        self._follow()
        self._tell(time_s)

    def _follow(self) -> None:
        """One period along the goal."""
        if self._path is None:
            return
        times_s, joints = self._path
        if self.controller.runtime is not Runtime.PLAYING or self.controller.safety is not Safety.NORMAL:
            self._path, failed = None, empty(f"{TRAJECTORY}_Result")
            failed.error_code, failed.error_string = TOLERANCE, "the program does not run"
            self._action.end(Status.ABORTED, failed)
            return
        self._along_s += self._cell.period_s * self.controller.slider
        self._arm.scale = 1.0  # the goal is followed slowly already
        self.asked_rad = np.array([np.interp(self._along_s, times_s, row) for row in joints.T])
        self._arm.servo(self.asked_rad)
        if self._along_s >= times_s[-1]:
            self._path = None
            self._action.end(Status.SUCCEEDED, empty(f"{TRAJECTORY}_Result"))

    def _tell(self, time_s: float) -> None:
        if time_s < self.silent_until_s:
            return
        seen = self._arm.measured
        columns = (seen.positions_rad + self.controller.turned_rad, seen.velocities_rad_s, seen.moments_nm)
        position, velocity, effort = (column.tolist() for column in columns)
        header = self._clock.header(seen.time_s)
        self._late.append(message(JOINTS)(header, self._names, position, velocity, effort))
        if time_s >= self.late_until_s:
            for late in self._late:
                self._joints.write(late)
            self._late.clear()
        of = self.controller
        now = {"robot": int(of.robot_mode), "safety": int(of.safety_mode), "running": of.runtime is Runtime.PLAYING}
        kinds = {"robot": "ur_dashboard_msgs/msg/RobotMode", "safety": "ur_dashboard_msgs/msg/SafetyMode"}
        for name, value in now.items():
            if self._modes.get(name) != value:
                self._modes[name] = value
                self._told_modes[name].write(message(kinds.get(name, "std_msgs/msg/Bool"))(value))
        if time_s >= self._slow_s:
            self._slow_s = time_s + SLOW_S
            self._scaling.write(message("std_msgs/msg/Float64")(100.0 * of.slider))
            self._io.write(message("ur_msgs/msg/IOStates")(_pins(of.inputs), _pins(of.outputs), [], [], []))


def _triggered(act: Callable[[], object], _: Any) -> Mapping[str, Any]:
    return {"success": act() is not False, "message": ""}


def _pins(bits: int) -> list[Any]:
    digital = message("ur_msgs/msg/Digital")
    return [digital(pin=pin, state=bool(bits >> pin & 1)) for pin in range(PINS)]


class RosGripper:
    """The gripper's driver and controllers.

    Attributes:
        banner: what it serves.
    """

    def __init__(self, cell: TwinCell, role: str) -> None:
        self._cell, self._settings, self._clock = cell, cell.settings[role], RosTime(cell)
        node, own = node_of(self._settings), str(self._settings["namespace"])
        fingers = cell.sim.world.robot.gripper.fingers
        assert fingers is not None
        self._stroke_mm, self._node = 1e3 * fingers.stroke_m, cell.sim.gripper_node
        self._registers = {"rACT": 0.0, "rGTO": 0.0, "rATR": 0.0, "rARD": 0.0, "rPR": self._stroke_mm}
        self._registers |= {"rSP": GRIP_MM_S, "rFR": fingers.force_n[0]}
        self._action = ActionServer(node, f"{own}{self._settings['action']}", GRIP, self._accept, self._cancel)
        self._joints = node.publisher(f"{own}/joint_states", JOINTS)
        self._activation = Answerer(node, f"{own}{self._settings['activate']}", TRIGGER)
        self._activating: list[Any] = []
        self._due_s, self._silent = 0.0, False
        self.banner = f"{role}: ROS 2, domain {self._settings['domain']}: {self._settings['action']}"
        cell.offer("gripper_silent", "nothing comes of the gripper; once more ends it", self._silence)
        cell.each_period(self._cycle)

    def close(self) -> None:
        """Its nodes go with the process."""

    def _silence(self) -> None:
        self._silent = not self._silent

    def _write(self, **registers: float) -> None:
        self._registers |= registers
        self._node.write(self._registers)

    def _accept(self, goal: Any) -> bool:
        if self._node.registers()["gSTA"] != ACTIVE:
            return False
        share = (goal.command.position - CLOSED_AT) / (OPEN_AT - CLOSED_AT)
        self._write(rGTO=1.0, rPR=min(max(share, 0.0), 1.0) * self._stroke_mm, rFR=goal.command.max_effort)
        return True

    def _cancel(self) -> None:
        self._write(rGTO=0.0)
        self._action.end(Status.CANCELED, empty(f"{GRIP}_Result"))

    def _cycle(self, time_s: float) -> None:
        if self._silent:
            return
        for asked in self._activation.asked():
            self._write(rACT=0.0, rGTO=0.0)
            self._write(rACT=1.0)
            self._activating.append(asked)
        registers = self._node.registers()
        if registers["gSTA"] == ACTIVE:
            for asked in self._activating:
                self._activation.reply(asked, success=True, message="")
            self._activating.clear()
        self._action.serve()
        self._finish(self._node.registers())
        if time_s >= self._due_s:
            self._due_s = time_s + GRIPPER_S
            at = CLOSED_AT + registers["gPO"] / self._stroke_mm * (OPEN_AT - CLOSED_AT)
            names = [str(self._settings["joint"])]
            self._joints.write(message(JOINTS)(self._clock.header(time_s), names, [at], [0.0], [0.0]))

    def _finish(self, registers: Mapping[str, float]) -> None:
        if not self._action.active or registers["gOBJ"] == MOVING:
            return
        stalled = registers["gOBJ"] != AT_POSITION
        result = message(f"{GRIP}_Result")(registers["gPO"] / 1e3, self._registers["rFR"], stalled, not stalled)
        self._action.end(Status.SUCCEEDED, result)


class RosCamera:
    """A camera's node, as realsense-ros: image, depth in step with it, and CameraInfo.

    Attributes:
        banner: what it serves.
    """

    def __init__(self, cell: TwinCell, role: str) -> None:
        self._settings, self._clock, self._role = cell.settings[role], RosTime(cell), role
        node, topic = node_of(self._settings), str(self._settings["topic"])
        self._compressed = topic.endswith("/compressed")
        kind = "sensor_msgs/msg/CompressedImage" if self._compressed else IMAGE
        self._images = node.publisher(topic, kind, Quality(kept=2))
        depth, info = str(self._settings["depth"]), str(self._settings["info"])
        self._depths = node.publisher(depth, IMAGE, Quality(kept=2)) if depth else None
        self._infos = node.publisher(info, INFO, Quality(kept=2)) if info else None
        self._setup = getattr(cell.sim.world.bench, role)
        self._told_mount = self._mounted(cell, node)
        self.banner = f"camera {role}: ROS 2, domain {self._settings['domain']}: {topic}"
        self.faults = ImageFaults()
        self.faults.offered(cell, role)
        self._silent = False
        cell.offer(f"{role}_lost", f"nothing comes of camera {role}; once more ends it", self._silence)
        self._photographer = Photographer(cell, role, self._send)

    def close(self) -> None:
        """Send nothing more."""
        self._photographer.close()

    def _mounted(self, cell: TwinCell, node: Node) -> Any:
        """Tell for good where it hangs, as robot_state_publisher does; whoever comes later hears it, too."""
        flange = Pose((0.0, 0.0, cell.sim.world.robot.gripper.tcp_from_flange_m))
        parent, above = ("tool0", flange) if self._role == "wrist" else ("base_link", Pose((0.0, 0.0, 0.0)))
        stamped, (w, i, j, k) = empty("geometry_msgs/msg/TransformStamped"), self._setup.mount.quaternion_wxyz
        stamped.header, stamped.child_frame_id = self._clock.header(0.0, parent), f"{self._role}_optical_frame"
        x, y, z = (above @ self._setup.mount.pose).position_m
        stamped.transform.translation = message("geometry_msgs/msg/Vector3")(x, y, z)
        stamped.transform.rotation = message("geometry_msgs/msg/Quaternion")(i, j, k, w)
        still = node.publisher("/tf_static", "tf2_msgs/msg/TFMessage", LAST)
        still.write(message("tf2_msgs/msg/TFMessage")([stamped]))
        return still

    def _silence(self) -> None:
        self._silent = not self._silent

    def _send(self, frame: Frame) -> None:
        if self._silent:
            return
        header, image = self._clock.header(frame.time_s, f"{self._role}_optical_frame"), self.faults.put(frame.image)
        if self._infos is not None:
            self._infos.write(self._info(header))
        if self._depths is not None and frame.depth_mm is not None:
            self._depths.write(_image(header, frame.depth_mm.astype("<u2"), "16UC1"))
        if self._compressed:
            data = jpeg(image)
            self._images.write(message("sensor_msgs/msg/CompressedImage")(header=header, format="jpeg", data=data))
        else:
            self._images.write(_image(header, image, "rgb8"))

    def _info(self, header: Any) -> Any:
        info, setup = empty(INFO), self._setup
        info.header, info.width, info.height = header, setup.width_px, setup.height_px
        matrix = setup.model.matrix
        info.distortion_model, info.d = "plumb_bob", list(setup.model.distortion)
        info.k, info.r = matrix.ravel().tolist(), np.eye(3).ravel().tolist()
        info.p = np.column_stack([matrix, np.zeros(3)]).ravel().tolist()
        return info


def _image(header: Any, pixels: NDArray[Any], encoding: str) -> Any:
    height, width = pixels.shape[:2]
    size = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": pixels[0].nbytes}
    return message(IMAGE)(header=header, **size, data=pixels.tobytes())


def serve(cell: TwinCell, role: str) -> RosArm | RosGripper | RosCamera:
    """The device of a role behind its topics."""
    made: Mapping[str, Callable[[TwinCell, str], RosArm | RosGripper]] = {"arm": RosArm, "gripper": RosGripper}
    return made[role](cell, role) if role in made else RosCamera(cell, role)
