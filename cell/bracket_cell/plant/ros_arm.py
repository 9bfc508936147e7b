"""An arm behind ros2_control: joint_states in, goals of FollowJointTrajectory out, a piece of the path each.

Each goal begins in the controller's own time, which the stamps of joint_states tell, and ends at rest on the path: an
arm that gets no further goal stands there by itself. Sources: ros2_controllers, joint_trajectory_controller and
joint_state_broadcaster; ur_robot_driver, ur_controllers (gpio_configuration_controller, scaled controller).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from bracket_cell.plant.dds import LAST, SENSOR, Node, taken, waited
from bracket_cell.plant.ros_services import ActionClient, Caller, Status
from bracket_cell.plant.ros_types import empty, message
from bracket_cell.skills.drivers.samples import Sample
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_cell.skills.drivers.stream import Link
from bracket_cell.skills.drivers.streaming import StreamingArm
from bracket_cell.skills.drivers.ur_safety import safety_of
from bracket_ground.errors import CellError, DeviceFault, words_of
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.observation import ArmMode
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel

ACTION = "control_msgs/action/FollowJointTrajectory"
JOINTS = "sensor_msgs/msg/JointState"
TRIGGER = "std_srvs/srv/Trigger"
ANSWER_S, TAKES_S, BACK_S = 3.0, 0.6, 30.0  # of a node; of a goal; of an arm that is brought back
SILENT_S = 0.5  # joints that do not come for so long are a link to be made again
PERIOD_S, POINT_S = 0.008, 0.016  # of set points; between a goal's points
PIECE_S, EACH_S, REST_S = 0.25, 0.1, 0.1  # see `PieceLink`; that a goal's last point lasts
CLOCKED_N = 200  # samples from which the controller's time is told
LEAST_SCALING = 0.05
PROTECTIVE, RUNNING, IDLE, POWER_OFF = 3, 7, 5, 3
POWER = {3: "it has no power", 4: "it has power and no brakes released", 5: "its brakes are on", 2: "it is booting"}
SUCCESSFUL = 0


@dataclass
class UrState:
    """What ur_robot_driver tells beside the joints; None before it came."""

    safety: int | None = None
    robot: int | None = None
    running: bool | None = None
    scaling: float = 1.0

    @property
    def known(self) -> bool:
        """Everything that decides came."""
        return None not in (self.safety, self.robot, self.running)


class UrTopics:
    """Listens to ur_robot_driver's state."""

    TOPICS = (
        ("safety", "io_and_status_controller/safety_mode", "ur_dashboard_msgs/msg/SafetyMode"),
        ("robot", "io_and_status_controller/robot_mode", "ur_dashboard_msgs/msg/RobotMode"),
        ("running", "io_and_status_controller/robot_program_running", "std_msgs/msg/Bool"),
        ("scaling", "speed_scaling_state_broadcaster/speed_scaling", "std_msgs/msg/Float64"),
    )

    def __init__(self, node: Node, namespace: str) -> None:
        self.state = UrState()
        self._readers = {
            name: node.subscription(f"{namespace}/{topic}", kind, SENSOR if name == "scaling" else LAST)
            for name, topic, kind in self.TOPICS
        }

    def hear(self) -> UrState:
        """The newest."""
        for name, reader in self._readers.items():
            for came in taken(reader):
                value = came.mode if hasattr(came, "mode") else came.data
                setattr(self.state, name, min(max(value / 100, 0.0), 1.0) if name == "scaling" else value)
        return self.state


class Ros2Samples:
    """Implements `Connection`; raises OSError where no joints come.

    Attributes:
        ur: what ur_robot_driver tells; None of another arm.
    """

    period_s = PERIOD_S

    def __init__(self, settings: Ros2ArmSettings, joints: Sequence[str], slower: float) -> None:
        node, self._topic = Node(settings), f"{settings.namespace}/joint_states"
        self._names, self._limit_s = joints, SILENT_S * slower
        self._reader: Any = node.subscription(self._topic, JOINTS, SENSOR)
        self.ur = UrTopics(node, settings.namespace) if settings.ur else None
        self._before: tuple[float, Array] | None = None
        until_s = time.monotonic() + ANSWER_S * slower
        while time.monotonic() < until_s:
            if (self.ur is None or self.ur.hear().known) and waited(self._reader, 0.1) is not None:
                return
            time.sleep(0.01)
        known = self.ur is None or self.ur.state.known
        raise OSError(f"nothing comes on {self._topic}" if known else "ur_robot_driver does not tell the arm's modes")

    def receive(self) -> Sample:
        """The next sample."""
        until_s = time.monotonic() + self._limit_s
        while (left_s := until_s - time.monotonic()) > 0:
            came = waited(self._reader, left_s)
            if came is not None and set(self._names) <= set(came.name):
                return self._sample(came)
        raise OSError(f"nothing comes on {self._topic}")

    def close(self) -> None:
        """As in `Connection`; a wait ends by itself."""

    def _sample(self, came: Any) -> Sample:
        time_s = came.header.stamp.sec + came.header.stamp.nanosec * 1e-9
        at = [came.name.index(name) for name in self._names]
        joints, speeds, moments = (self._column(values, at) for values in (came.position, came.velocity, came.effort))
        if joints is None:
            raise OSError(f"{self._topic} tells no positions")
        if speeds is None:
            before_s, before = self._before or (time_s - 1.0, joints)
            speeds = (joints - before) / max(time_s - before_s, 1e-4)
        self._before = time_s, joints
        sample = time_s, joints, speeds, np.zeros_like(joints) if moments is None else moments
        if self.ur is None:
            return Sample(*sample)
        state = self.ur.hear()
        mode, reason = _mode(state)
        return Sample(*sample, mode, reason, bool(state.running), state.scaling)

    @staticmethod
    def _column(values: Sequence[float], at: list[int]) -> Array | None:
        """Of these joints; None where it is not told: nothing, or NaN, as of an interface that the hardware lacks."""
        found = np.array(values, float)[at] if len(values) > max(at) else np.array([np.nan])
        return found if np.isfinite(found).all() else None


def _mode(state: UrState) -> tuple[ArmMode, str]:
    safety = safety_of(state.safety)
    if not safety.reason and state.robot != RUNNING:
        return "not_controlled", POWER.get(state.robot or 0, f"its robot mode is {state.robot}")
    return safety.mode, safety.reason


class Ros2Link:
    """Sends goals, in the process that streams; implements `PieceLink`.

    Raises:
        RuntimeError: there is no such controller, it refuses a goal, or gives it up.
    """

    piece_s, each_s = PIECE_S, EACH_S

    def __init__(self, settings: Ros2ArmSettings, joints: Sequence[str], slower: float, load_kg: float) -> None:
        node, self._names, self._slower = Node(settings), list(joints), slower
        self._name = _action(settings)
        self._action = ActionClient(node, self._name, ACTION, settings.middleware)
        self._joints = node.subscription(f"{settings.namespace}/joint_states", JOINTS, SENSOR)
        self._ur = UrTopics(node, settings.namespace) if settings.ur else None
        self._payload = _payload(node, settings) if settings.ur else None
        self._loading_s: float | None = None  # since when the driver has been asked to take a load
        self._offsets_s: deque[float] = deque(maxlen=CLOCKED_N)  # of the controller's time
        self._goals: deque[tuple[bytes, float]] = deque(maxlen=64)  # not known to be taken, with when they were sent
        self._newest = b""
        if not self._action.there(ANSWER_S * slower):
            raise RuntimeError(f"no node has the action {self._name}")
        if self._payload is not None and not self._payload.there(ANSWER_S * slower):
            raise RuntimeError(f"no node has the service {self._payload.name}")
        self._clock(ANSWER_S * slower)
        self.load(load_kg, settings.payload_centre_m)

    def send(self, joints_rad: Array) -> None:
        """As in `Link`."""
        self.send_piece(joints_rad[np.newaxis])

    def send_piece(self, points_rad: Array) -> None:
        """As in `PieceLink`."""
        self.idle()
        stamp_ns = round((time.monotonic() / self._slower + max(self._offsets_s)) * 1e9)
        goal = empty(f"{ACTION}_Goal")
        header = message("std_msgs/msg/Header")(
            stamp=message("builtin_interfaces/msg/Time")(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id=""
        )
        goal.trajectory = message("trajectory_msgs/msg/JointTrajectory")(
            header=header, joint_names=self._names, points=list(self._points(points_rad))
        )
        self._newest = self._action.send(goal)
        self._goals.append((self._newest, time.monotonic()))

    def idle(self) -> None:
        """As in `Link`: the controller's time, and whether it still follows."""
        self._clock(0.0)
        self._loaded()
        if self._action.refused():
            raise RuntimeError(f"{self._name} refuses a goal")
        while self._goals and self._action.status(self._goals[0][0]) is not Status.UNKNOWN:
            self._goals.popleft()
        if self._goals and time.monotonic() - self._goals[-1][1] > TAKES_S * self._slower:
            raise RuntimeError(f"{self._name} takes no goal")
        if self._newest and (status := self._action.status(self._newest)) in (Status.ABORTED, Status.CANCELED):
            ended = self._action.result(self._newest, TAKES_S)
            why = (
                "" if ended is None or ended.error_code == SUCCESSFUL else f": {ended.error_string or ended.error_code}"
            )
            raise RuntimeError(f"{self._name}: the goal is {status.name.lower()}{why}")

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        """As in `Link`; of a UR."""
        if self._payload is not None:
            centre = message("geometry_msgs/msg/Vector3")(*centre_m)
            self._payload.ask(mass=mass_kg, center_of_gravity=centre)
            self._loading_s = time.monotonic()

    def _loaded(self) -> None:
        """Raise where the driver does not take the newest load: an arm that knows a wrong one stops by itself."""
        if self._payload is None or self._loading_s is None:
            return
        answer = self._payload.answer(1e-3)
        if answer is not None:
            self._loading_s = None
        silent = self._loading_s is not None and time.monotonic() - self._loading_s > ANSWER_S * self._slower
        if silent or (answer is not None and not answer.success):
            raise RuntimeError(f"{self._payload.name} {'does not answer' if silent else 'refuses the load'}")

    def close(self) -> None:
        """As in `Link`: what is left of goals is given up."""
        self._action.cancel()

    def _clock(self, limit_s: float) -> None:
        """Learn the controller's time: stamps come late, never early."""
        until_s = time.monotonic() + limit_s
        while not self._offsets_s and (left_s := until_s - time.monotonic()) > 0:
            if (first := waited(self._joints, left_s)) is not None:
                self._note(first)  # or of others on the topic, such as the gripper's
        for came in taken(self._joints):
            self._note(came)
        if not self._offsets_s:
            raise RuntimeError("nothing comes on joint_states")
        if self._ur is not None:
            self._ur.hear()

    def _note(self, came: Any) -> None:
        if self._names[0] in came.name:
            stamp_s = came.header.stamp.sec + came.header.stamp.nanosec * 1e-9
            self._offsets_s.append(stamp_s - time.monotonic() / self._slower)

    def _points(self, points_rad: Array) -> Iterator[Any]:
        """Of a goal; a scaled controller goes along them as slowly as the pendant's slider has it by itself."""
        scaling = 1.0 if self._ur is None else max(self._ur.state.scaling, LEAST_SCALING)
        stride, last = round(POINT_S / PERIOD_S), len(points_rad) - 1
        kept = [*range(0, last, stride), last, last] if last else [0, 0]
        times_s = np.array(kept, float) * PERIOD_S * scaling
        times_s[-1] += REST_S
        speeds = np.gradient(points_rad, PERIOD_S * scaling, axis=0) if last else np.zeros_like(points_rad)
        speeds[-1] = 0.0
        made, duration = (
            message("trajectory_msgs/msg/JointTrajectoryPoint"),
            message("builtin_interfaces/msg/Duration"),
        )
        for at, time_s in zip(kept, times_s, strict=True):
            after_ns = round(time_s * 1e9)
            yield made(
                positions=points_rad[at].tolist(),
                velocities=speeds[at].tolist(),
                accelerations=[],
                effort=[],
                time_from_start=duration(sec=after_ns // 10**9, nanosec=after_ns % 10**9),
            )


class Ros2Arm(StreamingArm):
    """Implements `Arm`.

    Raises:
        DeviceFault: nothing comes of its joints, or somebody must do something at the arm first.
    """

    Settings = Ros2ArmSettings
    goes_on_s = PIECE_S

    def __init__(self, settings: Ros2ArmSettings, clock: Clock, product: Product, robot: RobotModel) -> None:
        self._settings = settings
        self._names = tuple(f"{settings.prefix}{name}" for name in robot.joint_names)
        self._part_kg = max((part.mass_kg for part in product.parts.values()), default=0.0)
        self._carried, node = False, Node(settings)
        cancel = f"{_action(settings)}/_action/cancel_goal"
        self._cancel = Caller(node, cancel, "action_msgs/srv/CancelGoal", settings.middleware)
        self._node = node
        super().__init__(clock, robot, f"{settings.namespace}/joint_states", settings.lag_s)

    def connect(self) -> Ros2Samples:
        """By topics."""
        self._samples = Ros2Samples(self._settings, self._names, self.slower)
        return self._samples

    def link(self) -> Callable[[], Link]:
        """By the action."""
        return partial(Ros2Link, self._settings, self._names, self.slower, self._load_kg)

    def carry(self, held: bool) -> None:
        """A part is held, or is not any more: the driver is told what hangs on the flange."""
        if held != self._carried:
            self._carried = held
            self.load(self._load_kg, self._settings.payload_centre_m)

    @property
    def _load_kg(self) -> float:
        """What hangs on the flange now."""
        return self._settings.payload_kg + self._part_kg * self._carried

    def let_go(self) -> None:
        """Give all goals up."""
        self._cancel.ask()

    def bring_back(self) -> None:
        """By ur_robot_driver's services: unlock, power on, release the brakes, begin the program."""
        until_s = time.monotonic() + BACK_S * self.slower
        while self._samples.ur is not None and time.monotonic() < until_s:
            state = self._samples.ur.state
            mode, reason = _mode(state)
            if mode in ("emergency_stop", "safeguard_stop", "violation", "fault"):
                raise DeviceFault("arm", f"{reason}: see to that, then acknowledge")
            if mode in ("normal", "reduced") and state.running:
                return
            self._call(_remedy(state))
            time.sleep(0.2 * self.slower)
        if self._samples.ur is not None:
            raise DeviceFault("arm", f"it is not back after {BACK_S:g} s: {reason or 'its program does not run'}")

    def _call(self, service: str) -> None:
        if service:
            name = f"{self._settings.namespace}/{service}"
            Caller(self._node, name, TRIGGER, self._settings.middleware).call(ANSWER_S * self.slower)


def _remedy(state: UrState) -> str:
    """The service that brings an arm nearer to running; empty where one must wait."""
    if state.safety == PROTECTIVE:
        return "dashboard_client/unlock_protective_stop"
    powered = {POWER_OFF: "dashboard_client/power_on", IDLE: "dashboard_client/brake_release"}
    if state.robot == RUNNING:
        return "io_and_status_controller/resend_robot_program"
    return powered.get(state.robot or 0, "")


def _payload(node: Node, settings: Ros2ArmSettings) -> Caller:
    name = f"{settings.namespace}/io_and_status_controller/set_payload"
    return Caller(node, name, "ur_msgs/srv/SetPayload", settings.middleware)


def examine(settings: Ros2ArmSettings, robot: RobotModel, clock: Clock) -> Iterator[DeviceCheck]:
    """Whether joints come, with which delay and rate, whether the arm may move, and whether a controller is there."""
    slower = getattr(clock, "slower", 1.0)
    what, names = (
        f"arm: {settings.namespace}/joint_states",
        tuple(settings.prefix + joint_name for joint_name in robot.joint_names),
    )
    try:
        samples = Ros2Samples(settings, names, slower)
        first, begun_s = samples.receive(), time.monotonic()
        got = [samples.receive() for _ in range(50)]
    except (OSError, CellError) as error:
        remedy = f"domain {settings.domain} on {settings.network}; names of joints: {', '.join(names)}"
        yield DeviceCheck(what, f"{words_of(error)}: {remedy}")
        return
    rate_hz = len(got) / max(time.monotonic() - begun_s, 1e-3) * slower
    yield DeviceCheck(f"{what}: {rate_hz:.0f} samples a second", "" if first.time_s > 0 else "they have no stamps")
    mode, reason = got[-1].mode, got[-1].reason
    waits = "" if got[-1].takes else "its program does not run: play External Control at the pendant"
    yield DeviceCheck("arm: it may move", reason if mode not in ("normal", "reduced") else waits)
    name = _action(settings)
    there = ActionClient(Node(settings), name, ACTION, settings.middleware).there(ANSWER_S * slower)
    yield DeviceCheck(f"arm: the action {name}", "" if there else "no node has it: ros2 control list_controllers")


def _action(settings: Ros2ArmSettings) -> str:
    return f"{settings.namespace}/{settings.controller}/follow_joint_trajectory"
