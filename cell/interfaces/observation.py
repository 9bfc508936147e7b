"""What one tick may know: an immutable Observation, read once before the tick."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.perception import BenchView, PartsView

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class ArmState:
    """Joints of the arm as measured.

    Attributes:
        positions_rad, velocities_rad_s: (6,) shoulder_pan to wrist_3.
        moving: a trajectory is being followed or a stop is under way.
    """

    time_s: float
    positions_rad: tuple[float, ...]
    velocities_rad_s: tuple[float, ...]
    moving: bool


@dataclass(frozen=True)
class JointSamples:
    """What the arm measured between two ticks, at the rate of its own control; for the log, no node reads it.

    Attributes:
        times_s: (n,) clock times, increasing.
        positions_rad, velocities_rad_s, efforts_nm: (n, 6) shoulder_pan to wrist_3.
    """

    times_s: NDArray[np.float64]
    positions_rad: NDArray[np.float64]
    velocities_rad_s: NDArray[np.float64]
    efforts_nm: NDArray[np.float64]


class ObjectStatus(IntEnum):
    """gOBJ of the 2F-85's status byte."""

    MOVING = 0
    CONTACT_OPENING = 1
    CONTACT_CLOSING = 2
    AT_POSITION = 3


NodeState = Literal["unknown", "boot_up", "stopped", "operational", "pre_operational"]


@dataclass(frozen=True)
class GripperState:
    """Last status of the gripper.

    Attributes:
        time_s: when the status came; a heartbeat alone does not renew it.
        opening_m: distance between the fingers.
        fault: gFLT register, 0 when healthy (meanings: config/gripper.dbc).
        node_state: of the CAN node, from its last heartbeat.
    """

    time_s: float
    activated: bool
    object_status: ObjectStatus
    opening_m: float
    current_a: float
    fault: int
    node_state: NodeState = "unknown"

    @property
    def holding(self) -> bool:
        """A part stopped the fingers before the requested position."""
        return self.object_status is ObjectStatus.CONTACT_CLOSING


@dataclass(frozen=True)
class Observation:
    """Everything that a tick may read.

    Attributes:
        tick: number of the tick, from 0.
        bench: newest answer of the bench watcher; None before the first.
        parts: newest answer of the part detector; None before the first.
    """

    tick: int
    time_s: float
    arm: ArmState
    gripper: GripperState
    bench: BenchView | None = None
    parts: PartsView | None = None
