"""What a log calls the arm and its joints."""

from __future__ import annotations

from foxglove import messages

from bracket_cell.log.read.frames import decoded
from bracket_cell.log.read.reader import Log

JOINT_STATES = "/joint_states"


def joint_names(log: Log) -> tuple[str, ...]:
    """Of the joints from the base to the flange; numbered where the log does not say.

    Raises:
        LogError: its message is damaged.
    """
    first = next((message for message in log.messages if message.topic == JOINT_STATES), None)
    if first is not None:
        return tuple(joint.name for joint in decoded(log.path, first, messages.JointStates).joints)
    count = len(log.ticks[0].observation.arm.positions_rad) if log.ticks else 0
    return tuple(f"joint_{number}" for number in range(1, count + 1))
