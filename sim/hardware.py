"""How well robot and cameras measure and obey; where the figures come from: docs/simulation.md.

The defaults of the model are those of a UR10 and a USB camera; `ideal` is a robot without any of it.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from cell.interfaces.model import Model


class Hardware(Model):
    """What robot and cameras are like, beside what a camera's look says.

    Attributes:
        joint_noise_rad: standard deviation of a measured joint position.
        joint_speed_noise_rad_s: standard deviation of a measured joint speed.
        trailing_s: how far a joint is behind its set point, as time; at speed v the tracking error is v times this.
        command_latency_s: from a command to the arm's taking it up, in whole control periods.
        camera_latency_s: from the closing of the shutter to the frame in the controller's memory.
    """

    joint_noise_rad: float = Field(default=4e-5, ge=0, le=0.01)
    joint_speed_noise_rad_s: float = Field(default=1e-3, ge=0, le=0.01)
    trailing_s: float = Field(default=0.03, ge=0, le=0.1)
    command_latency_s: float = Field(default=0.008, ge=0, le=0.5)
    camera_latency_s: float = Field(default=0.05, ge=0, le=1)


HARDWARE = {
    "ideal": Hardware(
        joint_noise_rad=0, joint_speed_noise_rad_s=0, trailing_s=0, command_latency_s=0, camera_latency_s=0
    ),
    "ur10_usb": Hardware(),
}


def _named(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value not in HARDWARE:
        raise ValueError(f"no such hardware; legal: {', '.join(HARDWARE)}, or the values themselves")
    return HARDWARE[value]


NamedHardware = Annotated[Hardware, BeforeValidator(_named, json_schema_input_type=str | Hardware)]
