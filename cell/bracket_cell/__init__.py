"""Behaviour-tree controller for a human-robot assembly cell: the names that users may rely on.

Example:
    A run and a replay in a script:

        from bracket_cell import load_cell, replay, run

        bench = load_cell("config/cell.yaml")
        result = run(bench, tree="trees/ahead.xml", log="run.mcap")
        for difference in replay("run.mcap", tree="trees/new.xml"):
            print(difference)
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # ONNX Runtime reads it when it is imported, and reports its use without
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**28))  # OpenCV likewise: 1 MB of PNG would take 9 GB

if TYPE_CHECKING:
    from bracket_cell.front_door import load_cell, replay, run
    from bracket_cell.skills.drivers.samples import Connection, Sample
    from bracket_cell.skills.drivers.stream import Link
    from bracket_cell.skills.drivers.streaming import StreamingArm
    from bracket_ground.errors import CellError, DeviceFault
    from bracket_ground.interfaces.clock import Clock
    from bracket_ground.interfaces.command import Command, Display, GripperCommand, JointTrajectory
    from bracket_ground.interfaces.devices import Arm, Camera, Devices, Gripper, Panel, Signals
    from bracket_ground.interfaces.frame import Frame
    from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples, ObjectStatus, Observation
    from bracket_ground.interfaces.pose import Pose
    from bracket_ground.interfaces.robot import RobotModel

    __version__: str

_HOME = {
    "Arm": "bracket_ground.interfaces.devices",
    "ArmState": "bracket_ground.interfaces.observation",
    "Camera": "bracket_ground.interfaces.devices",
    "CellError": "bracket_ground.errors",
    "Clock": "bracket_ground.interfaces.clock",
    "Command": "bracket_ground.interfaces.command",
    "Connection": "bracket_cell.skills.drivers.samples",
    "DeviceFault": "bracket_ground.errors",
    "Devices": "bracket_ground.interfaces.devices",
    "Display": "bracket_ground.interfaces.command",
    "Frame": "bracket_ground.interfaces.perception",
    "Gripper": "bracket_ground.interfaces.devices",
    "GripperCommand": "bracket_ground.interfaces.command",
    "GripperState": "bracket_ground.interfaces.observation",
    "JointSamples": "bracket_ground.interfaces.observation",
    "JointTrajectory": "bracket_ground.interfaces.command",
    "Link": "bracket_cell.skills.drivers.stream",
    "ObjectStatus": "bracket_ground.interfaces.observation",
    "Observation": "bracket_ground.interfaces.observation",
    "Panel": "bracket_ground.interfaces.devices",
    "Pose": "bracket_ground.interfaces.pose",
    "Signals": "bracket_ground.interfaces.devices",
    "StreamingArm": "bracket_cell.skills.drivers.streaming",
    "RobotModel": "bracket_ground.interfaces.robot",
    "Sample": "bracket_cell.skills.drivers.samples",
    "load_cell": "bracket_cell.front_door",
    "replay": "bracket_cell.front_door",
    "run": "bracket_cell.front_door",
}
__all__ = [
    "Arm",
    "ArmState",
    "Camera",
    "CellError",
    "Clock",
    "Command",
    "Connection",
    "DeviceFault",
    "Devices",
    "Display",
    "Frame",
    "Gripper",
    "GripperCommand",
    "GripperState",
    "JointSamples",
    "JointTrajectory",
    "Link",
    "ObjectStatus",
    "Observation",
    "Panel",
    "Pose",
    "RobotModel",
    "Sample",
    "Signals",
    "StreamingArm",
    "__version__",
    "load_cell",
    "replay",
    "run",
]


def __getattr__(name: str) -> object:
    """Load a promised name when it is first asked for."""
    if name == "__version__":
        from bracket_cell.packages import version

        return version()
    if name not in _HOME:
        raise AttributeError(f"module 'bracket_cell' has no attribute '{name}'; it offers {', '.join(__all__)}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
