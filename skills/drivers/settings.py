"""Settings of the drivers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from cell.files.model import Model


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


class CanSettings(Model):
    """A gripper with the 2F-85's registers on a CAN bus.

    Attributes:
        kind: this driver.
        interface: of python-can: virtual for the simulator, socketcan for a CAN adapter on Linux.
        channel: the interface's name, can0 for example.
        bitrate: of the bus.
        heartbeat_period_s: how often the node sends its heartbeat; silence for 1.5 periods is a fault.
        start_up_s: how long the node may take until its first frame.
        database: DBC file with the gripper's frames, relative to this file; the shipped one by default.
    """

    kind: Literal["can"] = "can"
    interface: str = Field(default="virtual", pattern=r"^[\w.-]{1,64}$")
    channel: str = Field(default="gripper", max_length=128, pattern=r"^[!-~]+( [!-~]+)*$")
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    heartbeat_period_s: float = Field(default=0.1, ge=0.01, le=2)
    start_up_s: float = Field(default=1.0, gt=0, le=60)
    database: Path | None = None


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
    host: str = Field(min_length=1, max_length=253, pattern=r"^[A-Za-z0-9.:-]+$")
    payload_kg: float = Field(default=0.93, ge=0, le=20)
    payload_centre_m: tuple[float, float, float] = (0.0, 0.0, 0.05)
    registers: Literal["auto", "lower", "upper"] = "auto"
    lookahead_s: float = Field(default=0.03, ge=0.03, le=0.2)
    gain: float = Field(default=300.0, ge=100, le=2000)
    lag_s: float = Field(default=0.045, ge=0, le=0.5)
