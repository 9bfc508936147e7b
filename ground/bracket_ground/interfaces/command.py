"""What one tick may do: a Command, filled by nodes and carried out after the tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bracket_ground.interfaces.operator import Question
from bracket_ground.interfaces.pose import Array

_DEVICES = {"follow": "arm", "gripper": "gripper"}


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Joint positions over time, sampled densely enough to interpolate linearly.

    Attributes:
        times_s: (n,) from 0, increasing.
        positions_rad: (n, joints).
    """

    times_s: Array = field(repr=False)
    positions_rad: Array = field(repr=False)

    def __post_init__(self) -> None:
        shape = self.positions_rad.shape
        if len(shape) != 2 or not shape[0] == len(self.times_s) > 0:
            raise ValueError(f"positions {shape} do not fit times {self.times_s.shape}")

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])

    def at(self, time_s: float) -> Array:
        """Joint positions (n,) at a time since the start, held at the ends."""
        return self.along(time_s)

    def along(self, times_s: Array | float) -> Array:
        """The same at many times (n,) at once: (n, 6)."""
        return np.array([np.interp(times_s, self.times_s, column) for column in self.positions_rad.T]).T


@dataclass(frozen=True)
class GripperCommand:
    """Go to an opening; values beyond what the gripper's file says are cut to that.

    Attributes:
        opening_m: 0, which closes fingers and switches a cup on, to the stroke; any other switches a cup off.
        speed_m_s: of the fingers.
        force_n: of the fingers.
    """

    opening_m: float
    speed_m_s: float = 0.1
    force_n: float = 60.0


@dataclass(frozen=True)
class HandCommand(GripperCommand):
    """A hand gives or takes what is between the fingers: they may move though a near hand holds the arm.

    Open they may with any speed and force, close only with the least.
    """


@dataclass(frozen=True)
class Display:
    """What the operator and the person at the bench are shown.

    Attributes:
        guidance: by part type, the positions that remain for it in all likely goals, in order.
        any_part: the positions for which these goals want different parts.
        goal_belief: probability by goal.
        message: what the robot does or waits for, in words.
        help_request: what the robot asks the person to do, or None.
        beeps: how often the bell was to sound so far.
        questions: that stand, the oldest first.
    """

    guidance: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    any_part: tuple[str, ...] = ()
    goal_belief: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    help_request: str | None = None
    beeps: int = 0
    questions: tuple[Question, ...] = ()


@dataclass
class Command:
    """Filled during a tick by nodes and skills, then carried out and recorded by the controller.

    Attributes:
        follow: a trajectory that the arm starts now; its first point is where the arm is.
        stop_arm: bring the arm to a controlled stop; wins over `follow`.
        activate_gripper: begin the gripper's activation, which must finish before its first motion.
        gripper: a new gripper goal, None to leave it as it is.
        contested: "arm" or "gripper" where two goals were set for it in this tick.
        broken: rules of the tree that are broken in this tick, each with its action and why.
        look: ask the wrist camera for a frame and the part detector for its answer.
        display: what to show from now on, None to leave it as it is.
        signals: digital outputs to set now.
    """

    follow: JointTrajectory | None = None
    stop_arm: bool = False
    activate_gripper: bool = False
    gripper: GripperCommand | None = None
    look: bool = False
    display: Display | None = None
    contested: tuple[str, ...] = ()
    broken: tuple[tuple[str, str], ...] = ()
    signals: Mapping[str, bool] = field(default_factory=dict)

    def __setattr__(self, name: str, value: object) -> None:
        """Note who is given a second goal: two nodes that command one device do not know of each other."""
        before = getattr(self, name, None)
        if name in _DEVICES and value is not None and before is not None and before is not value:
            object.__setattr__(self, "contested", (*self.contested, _DEVICES[name]))
        object.__setattr__(self, name, value)
