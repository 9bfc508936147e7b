"""A gripper behind ros2_control: the action GripperCommand out, its joint of joint_states in.

The action has a position and a force; the speed is the controller's. Sources: gripper_controllers,
ros2_robotiq_gripper.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator

from bracket_cell.plant.dds import SENSOR, Node, taken, waited
from bracket_cell.plant.ros_services import ActionClient, Caller, Status
from bracket_cell.plant.ros_types import message
from bracket_cell.skills.drivers.settings import Ros2GripperSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.observation import GripperState, NodeState, ObjectStatus
from bracket_ground.interfaces.robot import RobotModel

ACTION, JOINTS = "control_msgs/action/GripperCommand", "sensor_msgs/msg/JointState"
ANSWER_S, ACTIVATES_S, PERIOD_S, CLOSES_S = 3.0, 15.0, 0.01, 3.0
TAKES_S = 1.0  # in which a goal is taken, or refused
AT_M = 0.004  # of an opening that is reached


class Ros2Gripper:
    """Implements `Gripper`; a thread listens, so that no call waits.

    Raises:
        DeviceFault: no node has the action, or the gripper has no fingers.
    """

    Settings = Ros2GripperSettings

    def __init__(self, settings: Ros2GripperSettings, clock: Clock, robot: RobotModel) -> None:
        if robot.gripper.fingers is None:
            raise DeviceFault("gripper", f"{robot.gripper.name} has no fingers, and GripperCommand moves such alone")
        self._fingers, self._settings, self._clock = robot.gripper.fingers, settings, clock
        self._slower: float = getattr(clock, "slower", 1.0)
        node, self._name = Node(settings), f"{settings.namespace}{settings.action}"
        self._action = ActionClient(node, self._name, ACTION, settings.middleware)
        self._reader = node.subscription(f"{settings.namespace}/joint_states", JOINTS, SENSOR)
        service = f"{settings.namespace}{settings.activate}"
        self._activation = Caller(node, service, "std_srvs/srv/Trigger", settings.middleware)
        if not self._action.there(ANSWER_S * self._slower):
            raise DeviceFault("gripper", f"no node has the action {self._name}")
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._goal, self._sent_s, self._status = b"", 0.0, ObjectStatus.AT_POSITION
        self._opening_m, self._target_m, self._came_s = self._fingers.stroke_m, 0.0, clock.now_s()
        self._active, self._trouble = False, ""
        self._activating = threading.Thread()
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()

    def state(self) -> GripperState:
        """As last told; raises DeviceFault where nothing comes, or a command was refused."""
        with self._lock:
            silent_s, trouble = self._clock.now_s() - self._came_s, self._trouble
            if silent_s > self._settings.lost_s:
                raise DeviceFault("gripper", f"{self._settings.joint} was not told for {silent_s:.2f} s")
            if trouble:
                raise DeviceFault("gripper", trouble)
            node: NodeState = "operational" if self._active else "pre_operational"
            return GripperState(self._came_s, self._active, self._status, self._opening_m, 0.0, 0, node)

    def activate(self) -> None:
        """Begin activation, by its service."""
        with self._lock:
            self._active, self._trouble = False, ""
            if not self._activating.is_alive():
                self._activating = threading.Thread(target=self._activated, daemon=True)
                self._activating.start()

    def command(self, command: GripperCommand) -> GripperCommand:
        """Start a motion, at the controller's own speed."""
        does = self._fingers
        opening_m = min(max(command.opening_m, 0.0), does.stroke_m)
        force_n = min(max(command.force_n, does.force_n[0]), does.force_n[1])
        of, share = self._settings, opening_m / does.stroke_m
        position = of.closed_at + share * (of.open_at - of.closed_at)
        goal = message(f"{ACTION}_Goal")(
            command=message("control_msgs/msg/GripperCommand")(position=position, max_effort=force_n)
        )
        with self._lock:
            self._goal, self._sent_s = self._action.send(goal), time.monotonic()
            self._status, self._target_m, self._trouble = ObjectStatus.MOVING, opening_m, ""
        return GripperCommand(opening_m, self._settings.speed_m_s, force_n)

    def hold(self) -> None:
        """Cancel the goal: the controller holds where the fingers are, with their grip."""
        with self._lock:
            if self._goal and self._status is ObjectStatus.MOVING:
                self._action.cancel()

    def close(self) -> None:
        """Listen no more; the gripper keeps what it holds."""
        self._closed.set()
        self._thread.join(CLOSES_S)

    def _run(self) -> None:
        while not self._closed.is_set():
            came = waited(self._reader, PERIOD_S)
            for joints in [] if came is None else [came, *taken(self._reader)]:
                told = dict(zip(joints.name, joints.position, strict=False))  # others may tell speeds alone, or NaN
                if math.isfinite(position := told.get(self._settings.joint, math.nan)):
                    self._note(position)
            self._follow()

    def _note(self, position: float) -> None:
        of = self._settings
        share = (position - of.closed_at) / (of.open_at - of.closed_at)
        with self._lock:
            self._opening_m = min(max(share, 0.0), 1.0) * self._fingers.stroke_m
            self._came_s = self._clock.now_s()

    def _follow(self) -> None:
        """Whether the goal under way has ended, and how."""
        with self._lock:
            goal, sent_s, moving = self._goal, self._sent_s, self._status is ObjectStatus.MOVING
            if not (goal and moving):
                return
            status, refused = self._action.status(goal), self._action.refused()
            if refused or (status is Status.UNKNOWN and time.monotonic() > sent_s + TAKES_S * self._slower):
                self._trouble = f"{self._name} {'refuses' if refused else 'takes no'} goal"
                return
        if not status.over:
            return
        ended = self._action.result(goal, ANSWER_S * self._slower)
        with self._lock:
            if goal == self._goal:
                self._end(status, bool(ended is not None and ended.stalled))

    def _end(self, status: Status, stalled: bool) -> None:
        """A stalled grip is a part; a cancelled goal keeps what it had; at rest elsewhere nobody knows why."""
        off_m = self._opening_m - self._target_m
        if stalled and abs(off_m) > AT_M:
            self._status = ObjectStatus.CONTACT_CLOSING if off_m > 0 else ObjectStatus.CONTACT_OPENING
        elif status is Status.ABORTED and not stalled:
            self._trouble = f"{self._name} gave the goal up"
        else:
            self._status = ObjectStatus.AT_POSITION
        self._goal = b""

    def _activated(self) -> None:
        """Beside the loop."""
        done = self._activation.call(ACTIVATES_S * self._slower) if self._settings.activate else None
        with self._lock:
            self._active = not self._settings.activate or bool(done is not None and done.success)
            self._status = ObjectStatus.AT_POSITION
            if not self._active:
                self._trouble = f"{self._activation.name}: {'no answer' if done is None else done.message}"


def examine(settings: Ros2GripperSettings, clock: Clock, robot: RobotModel) -> Iterator[DeviceCheck]:
    """Whether its action is there and its joint told; nothing moves."""
    what = f"gripper: {settings.namespace}{settings.action}"
    try:
        gripper = Ros2Gripper(settings, clock, robot)
    except DeviceFault as error:
        yield DeviceCheck(what, f"{error.reason}: ros2 control list_controllers")
        return
    try:
        clock.sleep_until(clock.now_s() + settings.lost_s / 2)
        state = gripper.state()
    except DeviceFault as error:
        yield DeviceCheck(what, error.reason)
        return
    finally:
        gripper.close()
    yield DeviceCheck(f"{what}: open by {1e3 * state.opening_m:.0f} mm")
