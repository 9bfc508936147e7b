"""Behaviour-tree controller for a human-robot assembly cell: the names that users may rely on.

Example:
    A run and a replay in a script:

        from cell import load_cell, replay, run

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

if TYPE_CHECKING:
    from cell.errors import CellError, DeviceFault
    from cell.front_door import load_cell, replay, run
    from cell.interfaces.command import Command, Display, GripperCommand, JointTrajectory
    from cell.interfaces.devices import Arm, Camera, Devices, Gripper, Panel, Signals
    from cell.interfaces.frame import Frame
    from cell.interfaces.observation import ArmState, GripperState, JointSamples, ObjectStatus, Observation
    from cell.interfaces.pose import Pose

    __version__: str

_HOME = {
    "Arm": "cell.interfaces.devices",
    "ArmState": "cell.interfaces.observation",
    "Camera": "cell.interfaces.devices",
    "CellError": "cell.errors",
    "Command": "cell.interfaces.command",
    "DeviceFault": "cell.errors",
    "Devices": "cell.interfaces.devices",
    "Display": "cell.interfaces.command",
    "Frame": "cell.interfaces.perception",
    "Gripper": "cell.interfaces.devices",
    "GripperCommand": "cell.interfaces.command",
    "GripperState": "cell.interfaces.observation",
    "JointSamples": "cell.interfaces.observation",
    "JointTrajectory": "cell.interfaces.command",
    "ObjectStatus": "cell.interfaces.observation",
    "Observation": "cell.interfaces.observation",
    "Panel": "cell.interfaces.devices",
    "Pose": "cell.interfaces.pose",
    "Signals": "cell.interfaces.devices",
    "load_cell": "cell.front_door",
    "replay": "cell.front_door",
    "run": "cell.front_door",
}
__all__ = [
    "Arm",
    "ArmState",
    "Camera",
    "CellError",
    "Command",
    "DeviceFault",
    "Devices",
    "Display",
    "Frame",
    "Gripper",
    "GripperCommand",
    "GripperState",
    "JointSamples",
    "JointTrajectory",
    "ObjectStatus",
    "Observation",
    "Panel",
    "Pose",
    "Signals",
    "__version__",
    "load_cell",
    "replay",
    "run",
]


def __getattr__(name: str) -> object:
    """Load a promised name when it is first asked for."""
    if name == "__version__":
        from cell.files.packages import version

        return version()
    if name not in _HOME:
        raise AttributeError(f"module 'cell' has no attribute '{name}'; it offers {', '.join(__all__)}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
