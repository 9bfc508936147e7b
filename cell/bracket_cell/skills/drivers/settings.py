"""Settings of the drivers, and which driver takes which."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field, Tag, model_validator

from bracket_ground.files.model import Model

# Names whose labels a resolver takes, and addresses of both kinds.
HOST = r"^([A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*\.?|[0-9A-Fa-f.]*:[0-9A-Fa-f:.]+)$"
Host = Annotated[str, Field(max_length=253, pattern=HOST)]


class SignalSettings(Model):
    """A CANopen I/O module with digital signals (CiA 401).

    Attributes:
        kind: this driver.
        interface, channel, bitrate: the bus, as for the gripper.
        node_id: of the module: it sends inputs as 0x180 + node id, and takes outputs as 0x200 + node id.
        inputs, outputs: bit of each signal, by the names that tree files use.
        timeout_s: silence for this long is a fault; the module must send its inputs more often than that.
    """

    kind: Literal["can"] = "can"
    interface: str = "virtual"
    channel: str = "signals"
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    node_id: int = Field(default=32, ge=1, le=127)
    inputs: dict[str, Annotated[int, Field(ge=0, le=63)]] = Field(default_factory=dict)
    outputs: dict[str, Annotated[int, Field(ge=0, le=63)]] = Field(default_factory=dict)
    timeout_s: float = Field(default=0.5, gt=0, le=60)


class ModbusSignalSettings(Model):
    """Digital signals to and from a PLC that asks for them: a server of Modbus TCP.

    Attributes:
        kind: this driver.
        at: HOST:PORT where the cell listens; Modbus asks nobody who they are, so name the address of the machine's own
            network. Port 502 needs rights that a cell should not have.
        inputs: coil that the PLC writes for each signal, by the names that tree files use.
        outputs: discrete input that the PLC reads for each signal.
        timeout_s: a PLC that asks or writes nothing for this long is silent, which is a fault.
    """

    kind: Literal["modbus"] = "modbus"
    at: str = Field(default="127.0.0.1:1502", pattern=r"^\S+:\d{1,5}$")
    inputs: dict[str, Annotated[int, Field(ge=0, le=255)]] = Field(default_factory=dict)
    outputs: dict[str, Annotated[int, Field(ge=0, le=255)]] = Field(default_factory=dict)
    timeout_s: float = Field(default=1.0, gt=0, le=60)


UR_TERMINAL = r"(digital [0-7]|configurable [0-7]|tool [01]|register (6[4-9]|[7-9]\d|1[01]\d|12[0-7]))"
UR_ANALOG = r"(tool )?analog [01] [<>] -?\d{1,3}(\.\d{1,4})?"
UR_FACT = "(reduced|protective_stop|recovery|safeguard_stop|emergency_stop|violation|fault|stopped)"


class UrSignalSettings(Model):
    """Terminals of a Universal Robots controller and its tool, by RTDE, beside whoever moves the arm.

    Attributes:
        kind: this driver.
        host: address of the controller.
        inputs: for each signal, by the names that tree files use, a terminal (`digital 0` to 7, `configurable 0` to 7,
            `tool 0` or 1), a boolean register of the controller's program (`register 64` to 127), what its safety
            tells (reduced, protective_stop, recovery, safeguard_stop, emergency_stop, violation, fault, stopped), or
            whether an analogue input is over or under a value in V or A, as the controller has it: `analog 0 > 4.5`,
            `tool analog 1 < 0.012`.
        outputs: terminal or register of each signal that is set.
        timeout_s: silence for this long is a fault.
    """

    kind: Literal["ur"] = "ur"
    host: Host
    inputs: dict[str, Annotated[str, Field(pattern=f"^({UR_TERMINAL}|{UR_FACT}|{UR_ANALOG})$")]] = Field(
        default_factory=dict
    )
    outputs: dict[str, Annotated[str, Field(pattern=f"^{UR_TERMINAL}$")]] = Field(default_factory=dict)
    timeout_s: float = Field(default=0.5, gt=0, le=60)


class CanSettings(Model):
    """A gripper with the 2F-85's registers on a CAN bus.

    Attributes:
        kind: this driver.
        interface: of python-can: virtual for the simulator, socketcan for a CAN adapter on Linux.
        channel: the interface's name, can0 for example.
        bitrate: of the bus.
        heartbeat_period_s: how often the node sends its heartbeat; silence for 1.5 periods is a fault.
        database: DBC file with the gripper's frames, relative to this file; the shipped one by default.
    """

    start_up_s: ClassVar[float] = 1.0  # how long the node may take until its first frame
    kind: Literal["can"] = "can"
    interface: str = Field(default="virtual", pattern=r"^[\w.-]{1,64}$")
    channel: str = Field(default="gripper", max_length=128, pattern=r"^[!-~]+( [!-~]+)*$")
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    heartbeat_period_s: float = Field(default=0.1, ge=0.01, le=2)
    database: Path | None = None


class FingerSettings(Model):
    """What every wire of a 2F-85 needs to know.

    Attributes:
        open_count, closed_count: position register where the fingers end; activation measures both anew.
        lost_s: silence for this long is a fault; the gripper itself gives up after 1 s.
    """

    open_count: int = Field(default=3, ge=0, le=80)
    closed_count: int = Field(default=228, ge=125, le=255)
    lost_s: float = Field(default=1.0, gt=0, le=10)


class RobotiqModbusSettings(FingerSettings):
    """A Robotiq 2F-85 at an RS-485 adapter (Modbus RTU).

    Attributes:
        kind: this driver.
        port: the adapter by its id, as /dev/serial/by-id/usb-FTDI_...: ttyUSB0 may be another one after a replug.
        node_id: of the gripper.
        baud: of the gripper.
    """

    kind: Literal["robotiq_modbus"] = "robotiq_modbus"
    port: str
    node_id: int = Field(default=9, ge=1, le=247)
    baud: int = Field(default=115_200, ge=9_600, le=1_000_000)


class RobotiqUrcapSettings(FingerSettings):
    """A Robotiq 2F-85 behind the URCap on the robot's controller.

    Attributes:
        kind: this driver.
        host: of the controller.
        port: of the URCap's text socket.
    """

    kind: Literal["robotiq_urcap"] = "robotiq_urcap"
    host: Host
    port: int = Field(default=63352, ge=1, le=65535)


class CameraDriverSettings(Model):
    """What every camera's driver needs to know; size and rate of its images stand in the bench section.

    Attributes:
        delay_s: from the middle of the exposure to the stamp; unknown until `cell setup calibrate` has measured it.
        lost_s: no new frame for this long is a fault.
    """

    delay_s: float | None = Field(default=None, ge=0, le=1)
    lost_s: float = Field(default=0.5, gt=0, le=60)


class V4l2Settings(CameraDriverSettings):
    """A USB camera on Linux.

    Attributes:
        kind: this driver.
        device: the camera by its id, as /dev/v4l/by-id/usb-...-index0: video0 may be another one after a replug.
        exposure: fixed exposure, in the driver's unit (0.1 ms as a rule).
        focus: fixed focus, in the driver's unit; without one the lens has none.
        fourcc: how images come over the bus; MJPG lets two cameras share one.
    """

    kind: Literal["v4l2"] = "v4l2"
    device: str
    exposure: float = Field(default=100.0, gt=0, le=100_000)
    focus: float | None = Field(default=None, ge=0, le=10_000)
    fourcc: str = Field(default="MJPG", pattern=r"^[ -~]{4}$")


class StreamSettings(CameraDriverSettings):
    """A camera on the network that sends MJPEG by HTTP, or RTSP.

    Attributes:
        kind: this driver.
        url: as http://192.0.2.20/video or rtsp://192.0.2.20/live.
    """

    kind: Literal["stream"] = "stream"
    url: str = Field(pattern=r"^(http|https|rtsp)://")


NAME = r"[A-Za-z_]\w*"
TOPIC = rf"^(/{NAME})+$"


class DdsSettings(Model):
    """Where topics of ROS 2 are, over DDS; needs the extra ros2, and no ROS.

    Attributes:
        domain: as ROS_DOMAIN_ID.
        network: name or address of the network's interface; by default this machine alone.
    """

    domain: int = Field(default=0, ge=0, le=232)
    network: str = Field(default="127.0.0.1", pattern=r"^[\w.:-]+$")


class Ros2NodeSettings(DdsSettings):
    """Nodes of ROS 2 that are told something, too.

    Attributes:
        kind: this driver.
        namespace: before all names, as /left; empty for none.
        middleware: of these nodes, as RMW_IMPLEMENTATION has it between rmw_ and _cpp: their calls differ.
    """

    kind: Literal["ros2"] = "ros2"
    namespace: str = Field(default="", pattern=rf"^(/{NAME})*$")
    middleware: Literal["fastrtps", "cyclonedds"] = "fastrtps"


class Ros2ArmSettings(Ros2NodeSettings):
    """An arm behind a trajectory controller of ros2_control: joint_states in, FollowJointTrajectory out.

    Attributes:
        controller: its name; that of another arm is joint_trajectory_controller, as a rule.
        prefix: before the joints' names, as tf_prefix.
        ur: ur_robot_driver tells modes, speed scaling and whether its program runs, and brings the arm back; without
            it the arm counts as able to move as long as its joints come.
        payload_kg: what hangs on the flange without a part, where it is a UR: gripper, coupling, camera.
        payload_centre_m: centre of that mass, from the flange.
        lag_s: how far the joints trail the set points.
    """

    controller: str = Field(default="scaled_joint_trajectory_controller", pattern=rf"^{NAME}$")
    prefix: str = Field(default="", pattern=r"^\w*$")
    ur: bool = True
    payload_kg: float = Field(default=0.93, ge=0, le=20)
    payload_centre_m: tuple[float, float, float] = (0.0, 0.0, 0.05)
    lag_s: float = Field(default=0.045, ge=0, le=0.5)


class Ros2GripperSettings(Ros2NodeSettings):
    """A gripper behind a controller of ros2_control with the action GripperCommand, which knows no speed.

    Attributes:
        action: its name.
        joint: of joint_states that tells how far it is open.
        open_at, closed_at: position of that joint where the fingers end.
        speed_m_s: of the fingers, as the node's driver has it, whatever is commanded.
        activate: service (std_srvs/Trigger) that activates it; empty where it needs none.
        lost_s: joints that come no more for this long are a fault.
    """

    action: str = Field(default="/robotiq_gripper_controller/gripper_cmd", pattern=TOPIC)
    joint: str = "robotiq_85_left_knuckle_joint"
    open_at: float = 0.0
    closed_at: float = 0.7929
    speed_m_s: float = Field(default=0.15, gt=0, le=1)
    activate: str = Field(default="/robotiq_activation_controller/reactivate_gripper", pattern=rf"^(/{NAME})*$")
    lost_s: float = Field(default=0.5, gt=0, le=10)

    @model_validator(mode="after")
    def _moves(self) -> Ros2GripperSettings:
        if self.open_at == self.closed_at:
            raise ValueError("open_at and closed_at are the same: where do the fingers end?")
        return self


class Ros2SignalSettings(Ros2NodeSettings):
    """Digital terminals of a UR, as ur_robot_driver's io_and_status_controller has them.

    Attributes:
        inputs, outputs: terminal of each signal, by the names that tree files use: 0 to 7 digital, 8 to 15
            configurable, 16 and 17 of the tool.
        timeout_s: silence for this long is a fault.
    """

    inputs: dict[str, Annotated[int, Field(ge=0, le=17)]] = Field(default_factory=dict)
    outputs: dict[str, Annotated[int, Field(ge=0, le=17)]] = Field(default_factory=dict)
    timeout_s: float = Field(default=0.5, gt=0, le=60)


class Ros2PanelSettings(DdsSettings):
    """Topics (std_msgs/String) of what the person at the bench sees; nothing is answered there.

    Attributes:
        kind: this driver.
        namespace: before robot, guidance, questions and alarm.
    """

    kind: Literal["ros2"] = "ros2"
    namespace: str = Field(default="/panel", pattern=TOPIC)


class Ros2CameraSettings(CameraDriverSettings, DdsSettings):
    """A camera that a node of ROS 2 publishes.

    Attributes:
        kind: this driver.
        topic: of sensor_msgs/Image, as /camera/camera/color/image_raw of realsense-ros; or of CompressedImage, where it
            ends in /compressed.
        depth: topic of the depth image (16UC1, in mm) that shows what each of its pixels does, as
            /camera/camera/aligned_depth_to_color/image_raw; empty for none.
        info: topic of sensor_msgs/CameraInfo, which `cell doctor` compares with the bench file; empty for none.
        frame: of tf, in which `cell doctor` compares the mount with the bench file's: that of the arm's base for the
            overhead camera, of its flange (tool0) for the wrist's; empty for none. It needs info.
    """

    kind: Literal["ros2"] = "ros2"
    topic: str = Field(pattern=TOPIC)
    depth: str = Field(default="", pattern=rf"^(/{NAME})*$")
    info: str = Field(default="", pattern=rf"^(/{NAME})*$")
    frame: str = Field(default="", pattern=r"^[\w/]*$")


class FileSettings(CameraDriverSettings):
    """A video file in place of a camera, at the pace of the bench's rate.

    Attributes:
        kind: this driver.
        path: of the video, relative to this file.
        repeat: begin again at its end; otherwise no more frames come.
    """

    kind: Literal["file"] = "file"
    path: Path
    repeat: bool = True


class RealsenseSettings(CameraDriverSettings):
    """An Intel RealSense: colours, and depths aligned to them where the bench file says depth: true.

    Attributes:
        kind: this driver.
        serial: number of the camera; the first one by default.
        exposure: fixed exposure, in 0.1 ms.
    """

    kind: Literal["realsense"] = "realsense"
    serial: str | None = None
    exposure: float = Field(default=100.0, gt=0, le=100_000)


class RecordedSettings(Model):
    """A device that tells what a log holds of it, from the log's beginning.

    Attributes:
        kind: this driver.
        log: of a run, relative to this file.
    """

    kind: Literal["recorded"] = "recorded"
    log: Path


class UrSettings(Model):
    """An arm of Universal Robots (CB3 or e-series), by RTDE and dashboard.

    Attributes:
        kind: this driver.
        host: address of the controller.
        payload_kg: what hangs on the flange without a part: gripper, coupling, camera. A held part is added.
        payload_centre_m: centre of that mass, from the flange.
        registers: lower (0 to 23), upper (24 to 47) where a fieldbus owns the lower ones, or auto to find out.
        lookahead_s: over which the controller smooths set points.
        gain: how stiffly it follows them.
        lag_s: how far the joints trail the set points.
    """

    kind: Literal["ur"] = "ur"
    host: Host
    payload_kg: float = Field(default=0.93, ge=0, le=20)
    payload_centre_m: tuple[float, float, float] = (0.0, 0.0, 0.05)
    registers: Literal["auto", "lower", "upper"] = "auto"
    lookahead_s: float = Field(default=0.03, ge=0.03, le=0.2)
    gain: float = Field(default=2000.0, ge=100, le=2000)
    lag_s: float = Field(default=0.045, ge=0, le=0.5)


Recorded = Annotated[RecordedSettings, Tag("recorded")]
GripperKind = (
    Annotated[CanSettings, Tag("can")]
    | Annotated[RobotiqModbusSettings, Tag("robotiq_modbus")]
    | Annotated[RobotiqUrcapSettings, Tag("robotiq_urcap")]
    | Annotated[Ros2GripperSettings, Tag("ros2")]
    | Recorded
)
SignalKind = (
    Annotated[SignalSettings, Tag("can")]
    | Annotated[ModbusSignalSettings, Tag("modbus")]
    | Annotated[UrSignalSettings, Tag("ur")]
    | Annotated[Ros2SignalSettings, Tag("ros2")]
)
CameraKind = (
    Annotated[V4l2Settings, Tag("v4l2")]
    | Annotated[StreamSettings, Tag("stream")]
    | Annotated[Ros2CameraSettings, Tag("ros2")]
    | Annotated[FileSettings, Tag("file")]
    | Annotated[RealsenseSettings, Tag("realsense")]
    | Recorded
)
ArmKind = Annotated[UrSettings, Tag("ur")] | Annotated[Ros2ArmSettings, Tag("ros2")] | Recorded
DRIVERS: Mapping[type[Model], str] = {
    CanSettings: "bracket_cell.skills.drivers.can_gripper:CanGripper",
    SignalSettings: "bracket_cell.skills.drivers.can_signals:CanSignals",
    ModbusSignalSettings: "bracket_cell.plant.modbus_signals:ModbusSignals",
    UrSignalSettings: "bracket_cell.skills.drivers.ur_signals:UrSignals",
    Ros2ArmSettings: "bracket_cell.plant.ros_arm:Ros2Arm",
    Ros2GripperSettings: "bracket_cell.plant.ros_gripper:Ros2Gripper",
    Ros2SignalSettings: "bracket_cell.plant.ros_signals:Ros2Signals",
    Ros2PanelSettings: "bracket_cell.plant.ros_panel:Ros2Panel",
    UrSettings: "bracket_cell.skills.drivers.ur:UrArm",
    RobotiqModbusSettings: "bracket_cell.skills.drivers.robotiq:ModbusGripper",
    RobotiqUrcapSettings: "bracket_cell.skills.drivers.robotiq:UrcapGripper",
    V4l2Settings: "bracket_cell.skills.drivers.cameras:V4l2Camera",
    StreamSettings: "bracket_cell.skills.drivers.cameras:StreamCamera",
    FileSettings: "bracket_cell.skills.drivers.cameras:FileCamera",
    Ros2CameraSettings: "bracket_cell.plant.ros_camera:Ros2Camera",
    RealsenseSettings: "bracket_cell.skills.drivers.realsense:RealsenseCamera",
}  # loaded where they are named: each needs packages of its own
EXAMINERS: Mapping[type[Model], str] = {
    UrSettings: "bracket_cell.skills.drivers.ur_examined:examine",
    RobotiqModbusSettings: "bracket_cell.skills.drivers.robotiq:examine",
    RobotiqUrcapSettings: "bracket_cell.skills.drivers.robotiq:examine",
    **dict.fromkeys(
        (V4l2Settings, StreamSettings, FileSettings, RealsenseSettings), "bracket_cell.skills.drivers.cameras:examine"
    ),
    Ros2CameraSettings: "bracket_cell.plant.ros_camera:examine",
    Ros2ArmSettings: "bracket_cell.plant.ros_arm:examine",
    Ros2GripperSettings: "bracket_cell.plant.ros_gripper:examine",
}  # what looks at a device for `cell doctor`: it opens it, and moves nothing
READERS: Mapping[type[Model], str] = {
    UrSettings: "bracket_cell.skills.drivers.ur_examined:joints_rad"
}  # without taking control
CALIBRATIONS: Mapping[type[Model], str] = {
    UrSettings: "bracket_cell.skills.drivers.ur_examined:calibration"
}  # as arms tell them
DRIVEN_BY = {"ur10": "ur", "ur10e": "ur"}  # kind of the arm's driver, by the robot's name
EXAMPLES: Mapping[str, str] = {
    "ur": """host: 192.168.56.101 # of the controller: set at the pendant, Settings, System, Network
payload_kg: 0.93 # gripper, coupling and camera: weigh them, and set the same at the pendant
payload_centre_m: [0.0, 0.0, 0.05] # of that mass, from the flange""",
    "can": """interface: socketcan
channel: can0
bitrate: 500000""",
    "robotiq_modbus": """port: /dev/serial/by-id/CHANGE-ME # ls /dev/serial/by-id
node_id: 9
open_count: 3 # where the fingers end: cell setup teach gripper
closed_count: 228""",
    "robotiq_urcap": """host: 192.168.56.101 # of the arm's controller, where the gripper's URCap is installed
open_count: 3 # where the fingers end: cell setup teach gripper
closed_count: 228""",
    "v4l2": """device: /dev/v4l/by-id/CHANGE-ME-index0 # ls /dev/v4l/by-id
exposure: 100 # fixed, in 0.1 ms as a rule
# focus: 30 # where the lens has one""",
    "stream": "url: http://192.168.56.20/video",
    "ros2": """topic: /camera/camera/color/image_raw
network: eth0 # of the network's interface""",
    "realsense": """exposure: 100 # fixed, in 0.1 ms
# serial: "012345678901" # where there are several""",
}  # what stands next to `kind` in a new cell
EXTRAS = {
    "rtde_control": "ur",
    "pymodbus": "robotiq",
    "serial": "robotiq",
    "pyrealsense2": "realsense",
    "cyclonedds": "ros2",
}  # of the project, by package


def kinds_of(union: object) -> tuple[str, ...]:
    """Names of the kinds in such a union."""
    members = get_args(union) if not isinstance(union, type(Recorded)) else (union,)
    return tuple(tag.tag for member in members for tag in get_args(member) if isinstance(tag, Tag))
