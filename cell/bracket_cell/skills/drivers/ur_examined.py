"""Looks at an arm of Universal Robots without moving it or taking control: what is set up otherwise than configured."""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress

import cv2
import numpy as np

from bracket_cell.skills.drivers.rtde import RtdeConnection
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur_dashboard import Dashboard
from bracket_cell.skills.drivers.ur_safety import safety_of
from bracket_ground.errors import DeviceFault, words_of
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.robot import WORLD_FROM_BASE, Calibration, RobotModel

POSE_OFF_M, MODEL_OFF_M = 0.0005, 0.010  # our tool against the controller's; beyond the latter it is another model
TCP_OFF_M, PAYLOAD_OFF_KG = 0.0005, 0.2
TWICE = ("ur3", "ur5", "ur10")  # of which there is one of the e-series, too
E_SERIES = 5  # major version from which it is one
RUNNING = 7
PRIMARY_PORT, ROBOT_STATE, KINEMATICS = 30001, 16, 5  # types of a message, and of a part of it
ROWS = struct.Struct(">24d")  # theta, a, d and alpha of the six joints
CHECKSUMS_BYTES, READS_S = 6 * 4, 2.0
ALIKE = 1e-9  # of values that were written and read again
TEACH = "`cell setup teach robot` writes this arm's own calibration down; then calibrate the cameras again"
ASKED: Mapping[str, int] = {
    "actual_q": 6, "actual_TCP_pose": 6, "robot_mode": 1, "safety_mode": 1, "runtime_state": 1
}  # fmt: skip
Forward = Callable[[Array], Pose]
OPTIONAL = {"tcp_offset": 6, "payload": 1}  # older controllers tell less


def examine(settings: UrSettings, bench: Bench, robot: RobotModel, forward: Forward) -> Iterator[DeviceCheck]:
    """All that can be told before a run.

    Args:
        forward: world_from_tool of joints (6,).
    """
    try:
        values, version = _told(settings.host)
    except OSError as error:
        yield DeviceCheck(
            f"arm: a controller at {settings.host}",
            f"none answers ({words_of(error)}): check cable and address on both sides; from PolyScope 5.10 on switch "
            "on RTDE, dashboard and primary client under Security, Services",
        )
        return
    except DeviceFault as error:
        yield DeviceCheck(
            f"arm: a controller at {settings.host}", f"{error.reason}; it needs PolyScope 3 or 5, up to date"
        )
        return
    yield DeviceCheck(f"arm: a controller at {settings.host}, version {'.'.join(map(str, version))}")
    yield _model(settings, robot, version)
    yield _mode(settings, values)
    if "payload" in values:
        yield _payload(settings, float(values["payload"][0]))
    if "tcp_offset" in values:
        yield _tcp(robot, values["tcp_offset"])
    yield _kinematics(robot, values, forward)
    yield _own_calibration(settings, bench, robot, forward)
    yield _registers(settings)
    yield _turns(bench, robot.joints, values["actual_q"])


def joints_rad(settings: UrSettings) -> Array:
    """The joints now (6,), while somebody leads the arm; raises DeviceFault where nobody answers."""
    try:
        return _told(settings.host)[0]["actual_q"]
    except OSError as error:
        raise DeviceFault("arm", f"no controller answers at {settings.host}: {words_of(error)}") from None


def calibration(settings: UrSettings) -> Calibration:
    """The arm's own, which the controller tells once to whom connects to its primary port.

    Source: Universal Robots, "Remote control via TCP/IP": messages of a size, a type and parts that look alike.

    Raises:
        DeviceFault: nobody tells it.
    """
    until_s, came = time.monotonic() + READS_S, b""
    try:
        with socket.create_connection((settings.host, PRIMARY_PORT), READS_S) as port:
            port.settimeout(READS_S)
            while time.monotonic() < until_s and (part := port.recv(65536)):
                came += part
                while len(came) >= 5 and len(came) >= (size := int.from_bytes(came[:4], "big")) >= 5:
                    message, came = came[:size], came[size:]
                    if message[4] == ROBOT_STATE and (found := _rows(message[5:])) is not None:
                        return found
    except OSError as error:
        what = f"port {PRIMARY_PORT} of {settings.host} does not answer: {words_of(error)}"
        raise DeviceFault("arm", f"{what}; switch the primary client on under Security, Services") from None
    raise DeviceFault("arm", f"the controller at {settings.host} does not tell its calibration")


def refuse_another(settings: UrSettings, wanted: Calibration) -> None:
    """Raise DeviceFault where the controller tells the calibration of another arm; `cell doctor` tells more."""
    try:
        own = calibration(settings)
    except DeviceFault:
        return
    if not _alike(own, wanted):
        raise DeviceFault("arm", f"the robot's file has the calibration of another arm: {TEACH}")


def world_from_base(robot: RobotModel) -> Array:
    """(4, 4) of the controller's base, which is turned by half a turn against the URDF, where the arm is mounted."""
    return WORLD_FROM_BASE if robot.mount is None else robot.mount.pose.matrix @ WORLD_FROM_BASE


def _rows(parts: bytes) -> Calibration | None:
    """The calibration among the parts of a robot state."""
    while len(parts) >= 5:
        size, kind = struct.unpack(">iB", parts[:5])
        if kind == KINEMATICS and size >= 5 + CHECKSUMS_BYTES + ROWS.size:
            values = np.array(ROWS.unpack_from(parts, 5 + CHECKSUMS_BYTES)).reshape(4, 6).tolist()
            return Calibration.model_validate(dict(zip(Calibration.model_fields, values, strict=True)))
        parts = parts[max(size, 5) :]
    return None


def _alike(one: Calibration, other: Calibration) -> bool:
    pairs = zip(one.model_dump().values(), other.model_dump().values(), strict=True)
    return all(np.allclose(mine, yours, rtol=0.0, atol=ALIKE) for mine, yours in pairs)


def _told(host: str) -> tuple[dict[str, Array], tuple[int, ...]]:
    """One sample by the outputs' names, and the controller's version.

    Raises:
        OSError: nobody answers.
        DeviceFault: it does not know what is asked for.
    """
    asked = {**ASKED, **OPTIONAL}
    try:
        connection = RtdeConnection(host, tuple(asked), 10.0)
    except DeviceFault:
        asked = dict(ASKED)
        connection = RtdeConnection(host, tuple(asked), 10.0)
    with closing(connection):
        values, told = np.array(connection.values()), dict[str, Array]()
        for name, width in asked.items():
            told[name], values = values[:width], values[width:]
        return told, connection.version


def _model(settings: UrSettings, robot: RobotModel, version: Sequence[int]) -> DeviceCheck:
    model = ""
    with suppress(DeviceFault), Dashboard(settings.host) as dashboard:
        model = dashboard.ask("get robot model").lower()
    name = robot.name.lower()
    of_series = name.removesuffix("e") if model and not model.endswith("e") else name
    series = version[0] >= E_SERIES
    what = f"arm: {model.upper() or 'an arm'}{' of the e-series' if series else ''}"
    known = name.startswith("ur") and name[2:].removesuffix("e").isdecimal()
    other = name in TWICE if series else name.endswith("e")  # of the other series
    if known and (other or (model.startswith("ur") and model != of_series)):
        base = model.removesuffix("e")
        right = base + "e" * (series and base in TWICE) if model else "the controller's own"
        return DeviceCheck(what, f"the configuration says robot: {robot.name}; write robot: {right}")
    return DeviceCheck(what)


def _mode(settings: UrSettings, values: Mapping[str, Array]) -> DeviceCheck:
    robot, stopped = int(values["robot_mode"][0]), safety_of(int(values["safety_mode"][0])).reason
    try:
        with Dashboard(settings.host) as dashboard:
            local = dashboard.local
    except DeviceFault as error:
        return DeviceCheck("arm: its dashboard", f"{error.reason}: switch it on under Security, Services")
    if stopped:
        return DeviceCheck("arm: its safety mode", f"{stopped}: clear it there")
    if robot != RUNNING:
        return DeviceCheck("arm: power and brakes", f"robot mode {robot}: power it on and release the brakes")
    if local:
        return DeviceCheck("arm: remote control", "the pendant has control: switch it to remote control")
    return DeviceCheck("arm: it may move, by remote control")


def _payload(settings: UrSettings, told_kg: float) -> DeviceCheck:
    what = f"arm: a payload of {told_kg:.2f} kg"
    if abs(told_kg - settings.payload_kg) <= PAYLOAD_OFF_KG:
        return DeviceCheck(what)
    return DeviceCheck(
        what, f"payload_kg says {settings.payload_kg:.2f}: weigh gripper, coupling and camera, set it in both places"
    )


def _tcp(robot: RobotModel, tcp: Array) -> DeviceCheck:
    off = np.abs(tcp - np.array([0.0, 0.0, robot.gripper.tcp_from_flange_m, 0.0, 0.0, 0.0]))
    what = f"arm: a TCP at ({', '.join(f'{1e3 * value:.1f}' for value in tcp[:3])}) mm from the flange"
    if off.max() <= TCP_OFF_M:
        return DeviceCheck(what)
    right = f"(0, 0, {1e3 * robot.gripper.tcp_from_flange_m:.1f}) mm without rotation"
    return DeviceCheck(what, f"the robot's file says {right}: set it in the pendant's installation, or in that file")


def _kinematics(robot: RobotModel, values: Mapping[str, Array], forward: Forward) -> DeviceCheck:
    """Our place of the flange against the controller's, which knows the arm's own calibration."""
    tool = forward(values["actual_q"])
    pose = values["actual_TCP_pose"]
    base = world_from_base(robot)
    turned = base[:3, :3] @ _turn(pose[3:])
    tcp = values.get("tcp_offset", np.array([0.0, 0.0, robot.gripper.tcp_from_flange_m, 0.0, 0.0, 0.0]))
    theirs = base[:3, :3] @ pose[:3] + base[:3, 3] - turned @ _turn(tcp[3:]).T @ tcp[:3]
    ours = tool.transform(np.array([0.0, 0.0, -robot.gripper.tcp_from_flange_m]))
    off_m = float(np.linalg.norm(theirs - ours))
    what = f"arm: our kinematics {1e3 * off_m:.1f} mm off the controller's"
    if off_m <= POSE_OFF_M:
        return DeviceCheck(what)
    if off_m > MODEL_OFF_M:
        return DeviceCheck(what, f"it is another model than {robot.name}: correct robot in the configuration")
    return DeviceCheck(what, f"the robot's file has not the arm's own calibration: {TEACH}")


def _own_calibration(settings: UrSettings, bench: Bench, robot: RobotModel, forward: Forward) -> DeviceCheck:
    """The robot file's calibration against the controller's, by where they have the flange in two poses."""
    try:
        own = calibration(settings)
    except DeviceFault as error:
        return DeviceCheck("arm: its own calibration", error.reason)
    off_m = 0.0
    for joints_rad in (bench.arm_park_rad, bench.arm_look_rad):
        ours = forward(np.array(joints_rad)).transform(np.array([0.0, 0.0, -robot.gripper.tcp_from_flange_m]))
        theirs = world_from_base(robot) @ WORLD_FROM_BASE @ list(own.frames(joints_rad))[-1]
        off_m = max(off_m, float(np.linalg.norm(theirs[:3, 3] - ours)))
    what = f"arm: its own calibration is up to {1e3 * off_m:.1f} mm off the robot file's"
    other = robot.calibration is not None and not _alike(own, robot.calibration)
    return DeviceCheck(what, f"that file has another arm's: {TEACH}" if other else TEACH if off_m > POSE_OFF_M else "")


def _registers(settings: UrSettings) -> DeviceCheck:
    try:
        taken = {name: _in_use(settings.host, first) for name, first in (("lower", 0), ("upper", 24))}
    except OSError as error:
        return DeviceCheck("arm: registers", f"the controller hung up: {words_of(error)}")
    what = f"arm: registers ({settings.registers})"
    wanted = ("lower", "upper") if settings.registers == "auto" else (settings.registers,)
    if not all(taken[name] for name in wanted):
        return DeviceCheck(what)
    if all(taken.values()):
        return DeviceCheck(what, "all are in use: end the other program, or switch off EtherNet/IP or PROFINET")
    free = next(name for name, used in taken.items() if not used)
    return DeviceCheck(what, f"a fieldbus or another program owns them: write registers: {free}")


def _in_use(host: str, first: int) -> bool:
    """Whether somebody else owns the registers from this number on."""
    with closing(RtdeConnection(host, ("timestamp",), 10.0)) as connection:
        return b"IN_USE" in connection.asked("I", f"input_int_register_{first}".encode())


def _turns(bench: Bench, names: Sequence[str], joints_rad: Array) -> DeviceCheck:
    """A joint a whole turn away would sweep through everything on its way to a fixed pose."""
    away = {
        name: joint - goal
        for name, joint, goal in zip(names, joints_rad, bench.arm_park_rad, strict=True)
        if abs(joint - goal) > math.pi + 0.01
    }
    if not away:
        return DeviceCheck("arm: no joint is a turn away from the pose park")
    text = ", ".join(f"{name} by {math.degrees(angle):+.0f} degrees" for name, angle in away.items())
    return DeviceCheck(
        f"arm: away from the pose park: {text}", "turn it back by hand in free drive, or `cell setup teach park` anew"
    )


def _turn(vector: Array) -> Array:
    """Rotation matrix of a rotation vector."""
    return np.asarray(cv2.Rodrigues(vector)[0], np.float64)
