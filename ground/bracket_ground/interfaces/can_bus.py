"""Opens a CAN bus by python-can's names; the gripper's driver and the simulated gripper are its two ends."""

from __future__ import annotations

from typing import Any

import can

from bracket_ground.errors import SettingError, words_of

can.util.set_logging_level("critical")  # what it has to say is raised, too
ECHOING = ("virtual", "socketcan", "kvaser", "vector", "ixxat", "nixnet", "etas")


def open_bus(
    interface: str, channel: str, bitrate: int = 500_000, *, echo: bool = False, role: str = "gripper"
) -> can.BusABC:
    """Open a bus.

    Args:
        echo: what is sent is received, too, once it has gone out; only where python-can and the adapter can do that.
        role: of the device in the configuration, for messages.

    Raises:
        SettingError: python-can has no such interface, or there is no such channel on this machine.
    """
    where, legal = ("devices", role, "interface"), ", ".join(sorted(can.VALID_INTERFACES))
    if interface not in can.VALID_INTERFACES:
        raise SettingError((where, f"no CAN interface {interface!r}; python-can has {legal}"))
    try:
        echoing: dict[str, Any] = {"receive_own_messages": True} if echo and interface in ECHOING else {}
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate, **echoing)
    except Exception as error:  # each adapter's backend raises what it likes
        raise SettingError((where, f"no CAN bus {interface!r} {channel!r}: {words_of(error)}")) from error
