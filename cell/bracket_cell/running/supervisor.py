"""The supervisor: judges every tick by a table of faults; its only actuators are a share of speed and the run's end.

It is pure: the same observations and commands in the same order give the same judgements, so a log is enough to judge
again. Modelled after PX4's failsafe: every detection has an action and a condition for clearing, and the severest wins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bracket_cell.running.fault_checks import CHECKS, Check, FaultReport, Memory, arm_checks, tick_checks
from bracket_cell.running.gripper_checks import GripperMemory
from bracket_cell.running.person_checks import person_checks
from bracket_cell.skills.motion.arm_monitor import ArmMonitor, StopLimits
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import LOST, SAFEGUARD, Action, Fault, FaultTable, SafetyDecision
from bracket_ground.interfaces.gripper import Gripper
from bracket_ground.interfaces.observation import Observation
from btxml.engine.causes import compared


@dataclass(frozen=True)
class AcknowledgementLimits:
    """When an acknowledgement counts. Origin: chosen: fingers that are activated anew take their time.

    Attributes:
        acknowledged_s: [s] before a fault goes in which it may be acknowledged.
    """

    acknowledged_s: float = 5.0


LIMITS = AcknowledgementLimits()


NO_REPORT = FaultReport("")
PAUSED = "operator_pause"


@dataclass
class _State:
    """Where one row of the table stands.

    Attributes:
        first_seen_s: since when its fault is reported; None while it is not.
        active_since_s: since when it acts; None while it does not.
        last_seen_s: when its fault was reported last.
        report: the newest.
        expired: it became a stop.
        acknowledged_s: when somebody acknowledged it last.
    """

    first_seen_s: float | None = None
    active_since_s: float | None = None
    last_seen_s: float = 0.0
    report: FaultReport = NO_REPORT
    expired: bool = False
    acknowledged_s: float = -math.inf


_Row = tuple[Fault, Check, _State]
OF_COMMANDS = ("command_contested", "rule_warns", "rule_holds", "rule_stops")  # asked when the tree has been ticked


class Supervisor:
    """Stands above the tree: is asked before it with what is seen, and after it with what it wants.

    Args:
        table: what is done about each detection.
        checks: by signal, what finds the detection; a signal without one is not judged.
        share: of speed that is never exceeded.
        monitor: that the checks of the arm ask, if they do: it remembers.
        gripper: whose states are checked; the usual one where none is given.
    """

    def __init__(
        self,
        table: FaultTable | Sequence[Fault],
        checks: Mapping[str, Check],
        share: float = 1.0,
        monitor: ArmMonitor | None = None,
        gripper: Gripper | None = None,
    ) -> None:
        faults = table.faults if isinstance(table, FaultTable) else table
        self._rows: list[_Row] = [(fault, checks[fault.signal], _State()) for fault in faults if fault.signal in checks]
        own = GripperMemory() if gripper is None else GripperMemory.of(gripper)
        self._memory, self._share, self._monitor = Memory(own), share, monitor

    def judge(self, observation: Observation, stopping: bool = False) -> SafetyDecision:
        """What is allowed in the tick that saw this; the safe stop takes the arm off its path."""
        self._memory.trajectory = None if stopping else self._memory.trajectory
        self._memory.see(observation)
        return self._judge(observation, Command(), [row for row in self._rows if row[0].signal not in OF_COMMANDS])

    def judge_command(self, observation: Observation, command: Command) -> SafetyDecision:
        """The same with what the nodes ask for; what must not go out is for the controller to withhold."""
        judgement = self._judge(observation, command, [row for row in self._rows if row[0].signal in OF_COMMANDS])
        self._memory.command(observation, command, judgement)
        return judgement

    @property
    def keeps(self) -> list[Any]:
        """What it keeps between two ticks, in dataclasses: its memory, the arm's monitor, and where each row stands."""
        return [self._memory, *([self._monitor] if self._monitor else []), *(state for *_, state in self._rows)]

    @property
    def unacknowledged(self) -> bool:
        """Whether something that only a person clears is active, and nobody acknowledged it so far."""
        return any(_waits_for_person(fault, state) for fault, _, state in self._rows)

    def _judge(self, observation: Observation, command: Command, asked: Sequence[_Row]) -> SafetyDecision:
        for fault, check, state in asked:
            _update(fault, state, check(observation, command, self._memory), observation)
        found: list[tuple[Action, str, str]] = []
        if observation.operator.pause == "now":  # no fault, and so in no table
            found.append((Action.HOLD, PAUSED, "paused by the operator"))
        share = min(self._share, _share(observation.operator.speed))  # what is seen may only take from it
        for fault, _, state in self._rows:
            if state.active_since_s is None:
                continue
            action, allowed = _answer(fault, state)
            found.append((action, fault.signal, state.report.reason))
            share = min(share, allowed)
        worst = max((action for action, *_ in found), default=Action.RUN)
        found.sort(key=lambda entry: -entry[0])
        reasons = tuple((signal, reason) for _, signal, reason in found)
        holding_faults = tuple(signal for action, signal, _ in found if action is worst is Action.HOLD)
        closed = observation.arm.mode == "safeguard_closed"
        active = (row for row in self._rows if row[2].active_since_s is not None and not row[2].expired)
        unasked = closed and any(fault.signal == SAFEGUARD and fault.clear == "itself" for fault, *_ in active)
        return SafetyDecision(worst, 0.0 if worst >= Action.HOLD else share, reasons, holding_faults, unasked)


def make_supervisor(table: FaultTable, motion: MotionPlanner) -> Supervisor:
    """The supervisor of a cell, for a run and for its replay alike."""
    row = next(fault for fault in table.faults if fault.signal == "arm_not_obeying")
    limits = StopLimits(row.stop_s or math.inf, row.stop_m or math.inf)
    separation, robot = motion.separation, motion.settings.robot
    reaction_s, tool_m = separation.settings.reaction_s, motion.kinematics.position_m
    monitor = ArmMonitor(robot, reaction_s, limits, tool_m, separation.slow_share)
    checks = {**CHECKS, **arm_checks(monitor), **person_checks(separation), **tick_checks(motion.settings.tick_s)}
    return Supervisor(table, checks, motion.settings.speed_share, monitor, robot.gripper)


def _update(fault: Fault, state: _State, report: FaultReport | None, seen: Observation) -> None:
    now_s = seen.time_s
    acknowledged = seen.acknowledged and not (report is not None and report.early)
    if acknowledged:
        state.acknowledged_s = now_s
    if report is not None:
        state.first_seen_s = now_s if state.first_seen_s is None else state.first_seen_s
        state.last_seen_s, state.report = now_s, report
        if state.active_since_s is None and _lasts(fault, "delay_s", now_s - state.first_seen_s, ">=", fault.delay_s):
            state.active_since_s, state.acknowledged_s = now_s, now_s if acknowledged else -math.inf
    else:
        state.first_seen_s = None
        if state.active_since_s is not None and _clears(fault, state, seen):
            state.active_since_s, state.expired = None, False
    if state.active_since_s is not None:
        limit_s = fault.stop_after_s
        lasts = limit_s is not None and _lasts(fault, "stop_after_s", now_s - state.active_since_s, ">", limit_s)
        state.expired |= lasts and fault.does > Action.WARN
        state.expired |= fault.clear == "person" and state.report.acknowledged_in_vain


def _answer(fault: Fault, state: _State) -> tuple[Action, float]:
    """What a row does that acts, and the share of speed that it leaves."""
    if state.expired:
        return Action.STOP, 0.0
    if fault.does is Action.HOLD and (leaving := _share(state.report.retreat_scale)) > 0:
        return Action.SLOW, leaving
    return fault.does, min(fault.share, _share(state.report.speed_scale)) if fault.does is Action.SLOW else 1.0


def _share(value: float) -> float:
    """A share of speed; none where the value is not one, as NaN."""
    return value if 0 <= value <= 1 else 0.0


def _waits_for_person(fault: Fault, state: _State) -> bool:
    late = state.acknowledged_s < state.last_seen_s - LIMITS.acknowledged_s
    return state.active_since_s is not None and not state.expired and fault.clear == "person" and late


def _clears(fault: Fault, state: _State, seen: Observation) -> bool:
    if fault.clear == "never" or state.expired:
        return False
    if _waits_for_person(fault, state) or (fault.signal in LOST and seen.acknowledged):  # its path goes first
        return False
    if fault.clear == "standstill" and not seen.arm.stands:
        state.last_seen_s = seen.time_s
        return False
    return _lasts(fault, "clear_s", seen.time_s - state.last_seen_s, ">=", fault.clear_s)


def _lasts(fault: Fault, parameter: str, lasted_s: float, relation: str, limit_s: float) -> bool:
    """Whether something lasts as long as a row of the table says."""
    return compared(f"supervisor {fault.signal}", parameter, lasted_s, relation, limit_s, "table of faults")
