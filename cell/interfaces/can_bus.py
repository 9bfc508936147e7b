"""Opens a CAN bus by python-can's names; the gripper's driver and the simulated gripper are its two ends."""

from __future__ import annotations

import can

from cell.interfaces.errors import SettingError


def open_bus(interface: str, channel: str, bitrate: int = 500_000) -> can.BusABC:
    """Open a bus.

    Raises:
        SettingError: python-can has no such interface, or there is no such channel on this machine.
    """
    where = ("gripper_can", "interface")
    if interface not in can.VALID_INTERFACES:
        what = f"no CAN interface {interface!r}; python-can has {', '.join(sorted(can.VALID_INTERFACES))}"
        raise SettingError((where, what))
    try:
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate)
    except (can.CanError, OSError, ValueError, NotImplementedError, ImportError, AttributeError) as error:
        raise SettingError((where, f"no CAN bus {interface!r} {channel!r}: {error}")) from error
