"""An observer that measures how soon and how far on a cell stops after a fault."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bracket_cell.faults.injection import Injection
from bracket_cell.running.gripper_checks import LIMITS as GRIPPER
from bracket_cell.skills.motion.known_bench import PLAUSIBLE
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Observer, TickRecord
from bracket_ground.interfaces.faults import Action
from bracket_ground.interfaces.observation import STANDING_RAD_S, JointSamples, Observation

EVERY = 4  # of the joints' samples


@dataclass
class StoppingDistance(Observer):
    """Measures from the fault on.

    Attributes:
        ticks_to_stop: from the first observation that shows the fault until the supervisor held or stopped, that
            observation included: 1 is at once; -1 for never.
        ticks_from_fault: the same from the fault itself: answers to frames take time, and a heartbeat has a period.
        stop_s, stop_m: from the fault until the arm stood, as measured at 500 Hz.
        held_before: a part was between the fingers when the fault came.
        held_lately: it was a moment before, and may be there still.
        at_end: nothing stopped the arm before the run was over.
    """

    injection: Injection
    motion: MotionPlanner
    ticks_to_stop: int = -1
    ticks_from_fault: int = -1
    stop_s: float = 0.0
    stop_m: float = 0.0
    held_before: bool = False
    held_lately: bool = False
    at_end: bool = False
    _held_s: float = -np.inf
    _ticks: int = 0
    _showing: int = 0
    _rested: bool = False
    _commanded: bool = False
    _tool: list[np.ndarray] = field(default_factory=list)

    def tick(self, record: TickRecord) -> None:
        began_s = self.injection.began_s
        if began_s is None:
            self.held_before = record.observation.gripper.holding
            self._held_s = record.observation.time_s if self.held_before else self._held_s
            self.held_lately = record.observation.time_s - self._held_s <= GRIPPER.held_lately_s
            return
        if record.joints is not None:
            self._measure(record.joints, began_s)
        if record.observation.time_s <= began_s or self.ticks_to_stop >= 0:
            return
        self._ticks += 1
        shown = self._commanded if self.injection.of_orders else shows(record.observation, self.injection)
        self._showing += self._showing > 0 or shown
        self._commanded = self.injection.shown  # by the command of this tick: the next observation shows it
        if record.status == "STOPPING" or (record.judgement is not None and record.judgement.action >= Action.HOLD):
            self.ticks_to_stop, self.ticks_from_fault = max(1, self._showing), self._ticks
            self.at_end = record.status == "STOPPING"

    def _measure(self, joints: JointSamples, began_s: float) -> None:
        samples = zip(joints.times_s, joints.positions_rad, joints.velocities_rad_s, strict=True)
        for time_s, positions, speeds in list(samples)[::EVERY]:
            if time_s <= began_s or self._rested:
                continue
            self._tool.append(self.motion.kinematics.position_m(positions))
            if len(self._tool) > 1:
                self.stop_m += float(np.linalg.norm(self._tool[-1] - self._tool[-2]))
            self.stop_s = float(time_s) - began_s
            self._rested = bool(np.abs(speeds).max() < STANDING_RAD_S and self.ticks_to_stop >= 0)


def shows(seen: Observation, injection: Injection) -> bool:
    """Whether an observation lets anybody know of the fault, whatever the supervisor makes of it."""
    fault, gripper = injection.fault, seen.gripper
    if fault.startswith("arm"):
        return injection.shown
    if fault.startswith("camera"):
        if any(trouble.device.startswith("camera") for trouble in seen.troubles):
            return True
        stale = seen.bench is None or seen.time_s - seen.bench.time_s > PLAUSIBLE.stale_s
        first = injection.first_frame
        spoiled = first is not None and seen.bench is not None and seen.bench.sequence >= first
        return stale if fault in ("camera_dead", "camera_raises") else spoiled
    if fault.startswith("sig") or fault == "observer_raises":
        return True
    lost = any(trouble.device == "gripper" for trouble in seen.troubles)
    odd = gripper.fault != 0 or gripper.node_state == "stopped" or not gripper.activated
    return lost or odd or seen.time_s - gripper.time_s > GRIPPER.stale_gripper_s
