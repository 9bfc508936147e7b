"""What one tick may know: an immutable Observation, read once before the tick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.faults import HAND_TOO_NEAR
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import BenchView, PartsView

Image = NDArray[np.uint8]


NOBODY = OperatorState()
STALE_ARM_S = 0.06  # older states are not of now: a tick and a half, two in a row are missing
STANDING_RAD_S = 0.05  # an arm whose joints are all slower stands

ArmMode = Literal[
    "normal",
    "reduced",
    "protective_stop",
    "recovery",
    "safeguard_stop",
    "safeguard_closed",
    "emergency_stop",
    "violation",
    "fault",
    "not_controlled",
]  # the safety status of the arm's controller; `safeguard_closed`: it could go on, and waits to be acknowledged;
# `not_controlled`: it takes no commands, for whatever reason
LETS_GO: tuple[ArmMode, ...] = ("protective_stop", "recovery", "emergency_stop", "not_controlled")  # of its trajectory
NodeState = Literal["unknown", "boot_up", "stopped", "operational", "pre_operational"]


@dataclass(frozen=True)
class ArmState:
    """Joints of the arm as measured.

    Attributes:
        time_s: when they were measured.
        positions_rad, velocities_rad_s: (n,) from the base to the flange.
        moving: a trajectory is being followed, also while it is held, or a stop is under way.
        mode: safety status of the arm's own controller; only "normal" and "reduced" let it move.
        path_s: how far along its trajectory it was at `time_s`, as time of that trajectory; None where the arm does
            not tell: then it is slow.
        reason: why the mode is not normal, or the state is old, in the arm's words.
        force_n: (x, y, z) with which something pushes the tool, in the world; None where the arm does not tell.
    """

    time_s: float
    positions_rad: tuple[float, ...]
    velocities_rad_s: tuple[float, ...]
    moving: bool
    mode: ArmMode = "normal"
    path_s: float | None = None
    reason: str = ""
    force_n: tuple[float, float, float] | None = None

    @property
    def stands(self) -> bool:
        """No joint moves; a speed that is not a number is not slow, nor is one that is missing."""
        speeds = self.velocities_rad_s
        return len(speeds) == len(self.positions_rad) > 0 and all(abs(speed) < STANDING_RAD_S for speed in speeds)

    def known_rad(self, count: int) -> tuple[float, ...] | None:
        """The positions; None where they are not so many finite numbers, or were measured at no time."""
        positions = self.positions_rad
        known = len(positions) == count and all(map(math.isfinite, (*positions, self.time_s)))
        return positions if known else None


@dataclass(frozen=True, eq=False)
class JointSamples:
    """What the arm measured between two ticks, at the rate of its own control; for the log, no node reads it.

    Attributes:
        times_s: (n,) clock times, increasing.
        positions_rad, velocities_rad_s, efforts_nm: (n, joints) from the base to the flange.
    """

    times_s: NDArray[np.float64]
    positions_rad: NDArray[np.float64]
    velocities_rad_s: NDArray[np.float64]
    efforts_nm: NDArray[np.float64]


class ObjectStatus(IntEnum):
    """What the gripper says of its motion, by the opening of fingers, by the pressure of a cup."""

    MOVING = 0
    CONTACT_OPENING = 1
    CONTACT_CLOSING = 2
    AT_POSITION = 3


@dataclass(frozen=True)
class GripperState:
    """Last status of the gripper.

    Attributes:
        time_s: when the status came; a heartbeat alone does not renew it.
        opening_m: distance between the fingers.
        fault: gFLT register, 0 when healthy (meanings: config/gripper.dbc).
        node_state: of the CAN node, from its last heartbeat.
        echoed: the status repeats the last command; an older one does not count.
        other_master: somebody else commanded the gripper since the last status was asked for.
        bus_errors: what was wrong on its bus since then, in words.
        two_nodes: statuses of late contradict one another: another node speaks under its identifier.
        vacuum_kpa: of a cup, how far the pressure in it is below the air's; None of fingers.
    """

    time_s: float
    activated: bool
    object_status: ObjectStatus
    opening_m: float
    current_a: float
    fault: int
    node_state: NodeState = "unknown"
    echoed: bool = True
    other_master: bool = False
    bus_errors: str = ""
    two_nodes: bool = False
    vacuum_kpa: float | None = None

    @property
    def holding(self) -> bool:
        """A part stopped the fingers before the requested position, or a cup's pressure fell as far as it must."""
        return self.object_status is ObjectStatus.CONTACT_CLOSING


@dataclass(frozen=True)
class Trouble:
    """A device that could not be read, or that refused what it was told.

    Attributes:
        device: "arm", "gripper", "gripper fault", "camera overhead", "camera wrist", "detector overhead" or
            "detector wrist".
    """

    device: str
    reason: str


LOGGED_AS = {"speed_scale": "share", "holding_faults": "held_by"}  # names of logs and rules


@dataclass(frozen=True)
class Observation:
    """Everything that a tick may read.

    Attributes:
        tick: number of the tick, from 0.
        arm, gripper: as last read; `troubles` tells where they could not be read in this tick.
        bench: newest answer of the bench watcher; None before the first.
        parts: newest answer of the part detector; None before the first.
        troubles: what devices raised since the tick before.
        late_s: how much later than its deadline the tick began.
        acknowledged: somebody acknowledged what holds the cell since the tick before.
        signals: digital inputs and outputs by name; what is unknown now is absent.
        operator: what somebody at panel, page or terminal wants.
        speed_scale: of the speed that the supervisor allows in this tick; 0 while it holds.
        holding_faults: signals for which it holds the arm, if it does.
        work_s: time that skills had to work so far: it stands while the supervisor holds. None in old logs.
    """

    tick: int
    time_s: float
    arm: ArmState
    gripper: GripperState
    bench: BenchView | None = None
    parts: PartsView | None = None
    troubles: tuple[Trouble, ...] = ()
    late_s: float = 0.0
    acknowledged: bool = False
    operator: OperatorState = NOBODY
    signals: Mapping[str, bool] = field(default_factory=dict)
    speed_scale: float = 1.0
    work_s: float | None = None
    holding_faults: tuple[str, ...] = ()

    @property
    def arm_answers(self) -> bool:
        """Whether the arm told how it is now, and refused nothing."""
        new = abs(self.time_s - self.arm.time_s) <= STALE_ARM_S
        return new and not any(trouble.device == "arm" for trouble in self.troubles)

    @property
    def new_path(self) -> bool:
        """Whether the arm may be given another path; one that is held stands at its beginning."""
        return self.speed_scale > 0 or self.holding_faults == (HAND_TOO_NEAR,)

    @property
    def worked_s(self) -> float:
        """The time that deadlines of skills go by."""
        return self.time_s if self.work_s is None else self.work_s
