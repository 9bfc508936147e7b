"""What the supervisor looks for: one pure function a signal, on the observation, the command and a short memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.running.gripper_checks import GripperMemory, refusal_words, stale_words
from bracket_cell.running.hand_checks import HandMemory
from bracket_cell.skills.motion.arm_monitor import ARM, ArmMonitor
from bracket_cell.skills.motion.known_bench import PLAUSIBLE
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.observation import LETS_GO, STALE_ARM_S, ArmMode, Observation
from bracket_ground.interfaces.perception import BenchView
from btxml.engine.causes import compared


@dataclass(frozen=True)
class FaultLimits:
    """When a device or the loop counts as faulty. Origin: chosen, and tried with simulated faults (`cell lab eval
    faults`).

    Attributes:
        lost_arm_s: [s] age of an arm's state that is no state: the arm stands by itself by then.
        lost_gripper_s: [s] likewise of the gripper.
        late: [periods of the control loop] of a late tick.
        very_late: [periods of the control loop] of a very late tick.
        off_path_rad: [rad] of a joint from its path.
        arrived_rad: [rad] from its end at which a path is over.
        rest_rad: [rad] likewise of a long path.
        vain_times: [acknowledgements] in a row that no trajectory came to its end after.
        servo_lags_s: [s] by which an arm may trail its trajectory.
    """

    lost_arm_s: float = 0.25
    lost_gripper_s: float = 1.0
    late: int = 2
    very_late: int = 10
    off_path_rad: float = 0.025
    arrived_rad: float = 0.006
    rest_rad: float = 0.012
    vain_times: int = 3
    servo_lags_s: tuple[float, ...] = (0.0, 0.008, 0.016)


LIMITS = FaultLimits()


OTHER_MASTER = "another master commands the gripper"
OF_OVERHEAD = ("camera overhead", "detector overhead")


@dataclass(frozen=True)
class FaultReport:
    """Something was found.

    Attributes:
        reason: in words for an operator.
        speed_scale: largest share of speed where the fault's action is to slow down.
        retreat_scale: share of speed at which the arm may go on although the fault's action is to hold; 0: it stands.
        acknowledged_in_vain: too often already: where it would wait for a person again, the run stops.
        early: to acknowledge it does not count yet, as what it is about goes on.
    """

    reason: str
    speed_scale: float = 1.0
    retreat_scale: float = 0.0
    acknowledged_in_vain: bool = False
    early: bool = False


@dataclass(eq=False)
class Memory:
    """What a check must know of earlier ticks.

    Attributes:
        too_near: the hand was too near in the tick before.
        leasts_m: when which protective distance was asked for, of late: a hand that screws is slow and fast.
        retreat_scale: share of speed at which an arm that is too near may go on.
        speed_scale: of speed, as the arm was last told.
        backwards: the arm's newest stamp is before the one that came before it.
        trajectory: what the arm was last sent and was not told to give up.
        given_up: trajectories that were given up by an acknowledgement since one came to its end.
    """

    gripper: GripperMemory = field(default_factory=GripperMemory)
    hands: HandMemory = field(default_factory=HandMemory)
    too_near: bool = False
    leasts_m: tuple[tuple[float, float], ...] = ()
    retreat_scale: float = 0.0
    speed_scale: float = 1.0
    backwards: bool = False
    trajectory: JointTrajectory | None = None
    given_up: int = 0
    _arm_s: float = field(default=-math.inf, init=False)

    def see(self, observation: Observation) -> None:
        """A tick begins."""
        self.gripper.see(observation.gripper, observation.time_s)
        self.hands.see(observation)
        self.backwards = observation.arm.time_s < self._arm_s
        self._arm_s = min(observation.arm.time_s, observation.time_s)
        if observation.arm.mode in LETS_GO:  # it stands where it was stopped, off its path
            self.trajectory = None
        elif self.trajectory is not None and _far_rad(self.trajectory) > LIMITS.off_path_rad:
            self.given_up = 0 if _arrived(observation, self.trajectory) else self.given_up

    def command(self, observation: Observation, command: Command, judgement: SafetyDecision) -> None:
        """A tick ends with what goes out."""
        self.speed_scale = judgement.speed_scale
        self.gripper.command(command, judgement, observation.time_s)
        given_up = judgement.gives_path_up(acknowledged=observation.acknowledged)
        self.given_up += given_up and self.trajectory is not None
        if command.stop_arm or given_up:
            self.trajectory = None
        elif command.follow is not None and judgement.new_path:
            self.trajectory = command.follow


Check = Callable[[Observation, Command, Memory], FaultReport | None]


def _trouble_of(*devices: str) -> Check:
    def check(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        found = [trouble.reason for trouble in seen.troubles if trouble.device in devices]
        return FaultReport("; ".join(found)) if found else None

    return check


def _mode(text: str, *modes: ArmMode) -> Check:
    def check(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        return FaultReport(seen.arm.reason or text) if seen.arm.mode in modes else None

    return check


def _safeguard(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
    if seen.arm.mode not in ("safeguard_stop", "safeguard_closed"):
        return None
    return FaultReport(seen.arm.reason or "safeguard stop of the arm", early=seen.arm.mode == "safeguard_stop")


def arm_checks(monitor: ArmMonitor) -> dict[str, Check]:
    """Checks that need to know what the arm can do, and what it was told."""
    slow: list[tuple[JointTrajectory | None, float]] = [(None, 1.0)]

    def watched(seen: Observation, memory: Memory) -> ArmMonitor:
        monitor.see(seen.time_s, seen.arm, memory.speed_scale, memory.trajectory)
        return monitor

    def not_plausible(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        words = watched(seen, memory).implausible
        return FaultReport(words) if words else None

    def not_obeying(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        words = watched(seen, memory).disobeys
        return FaultReport(words) if words else None

    def stale(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        if words := _old_arm(seen, "STALE_ARM_S", STALE_ARM_S):
            return FaultReport(words)
        repeats_s = watched(seen, memory).repeats_s
        return (
            FaultReport(Message("the arm moves and tells the same for {repeats_s} s", repeats_s=f"{repeats_s:.2f}"))
            if compared("supervisor arm_stale", "repeats_s", repeats_s, ">", ARM.repeats_s, ArmMonitor.__module__)
            else None
        )

    def path_unknown(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        path = memory.trajectory
        if path is None or not seen.arm.moving or (seen.arm.path_s is not None and not _why_off_path(seen, path)):
            return None
        if slow[0][0] is not path:
            slow[0] = path, monitor.slow_share(path)
        return FaultReport("slower, as the arm does not tell how far along its path it is", slow[0][1])

    def slower(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        words = watched(seen, memory).lags
        return FaultReport(words) if words else None

    return {
        "arm_not_plausible": not_plausible,
        "arm_slower": slower,
        "arm_not_obeying": not_obeying,
        "arm_stale": stale,
        "arm_path_unknown": path_unknown,
    }


def _old_arm(seen: Observation, name: str, limit_s: float) -> str:
    """How old the arm's state is, where it is too old, and why in the arm's words."""
    age_s = seen.time_s - seen.arm.time_s
    if compared("supervisor arm", name, age_s, "<=", limit_s, __name__):
        return ""
    words = Message("the arm's state is {age_s} s old", age_s=f"{age_s:.2f}")
    return Message("{words} ({reason})", words=words, reason=seen.arm.reason) if seen.arm.reason else words


def _lost_arm(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
    words = "; ".join(trouble.reason for trouble in seen.troubles if trouble.device == "arm")
    return _unless_vain(words or _old_arm(seen, "lost_arm_s", LIMITS.lost_arm_s), memory)


def _lost_gripper(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
    words = "; ".join(trouble.reason for trouble in seen.troubles if trouble.device == "gripper")
    words = words or stale_words(seen, LIMITS.lost_gripper_s)
    return FaultReport(words) if words else None


def _time_wrong(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
    if not seen.arm.time_s <= seen.time_s + PLAUSIBLE.future_s:
        return FaultReport("the arm's state is stamped with a time to come")
    return FaultReport("the stamps of the arm's states go backwards") if memory.backwards else None


def _off_path(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
    """The arm is elsewhere than its trajectory has it, or does not follow it at all."""
    return _unless_vain(_why_off_path(seen, memory.trajectory), memory)


def _unless_vain(words: str, memory: Memory) -> FaultReport | None:
    """What a person clears, as long as that helps."""
    if words and memory.given_up >= LIMITS.vain_times:
        return FaultReport(
            Message(
                "{words}, although it was acknowledged {given_up} times in a row", words=words, given_up=memory.given_up
            ),
            acknowledged_in_vain=True,
        )
    return FaultReport(words) if words else None


def _why_off_path(seen: Observation, sent: JointTrajectory | None) -> str:
    path_s = seen.arm.path_s
    if sent is None or seen.arm.known_rad(sent.positions_rad.shape[1]) is None:
        return ""
    measured = np.array(seen.arm.positions_rad)
    if seen.arm.moving and path_s is not None:
        off = float(np.abs(measured - sent.along(path_s - np.array(LIMITS.servo_lags_s))).max(axis=1).min())
        return Message("a joint is {off} rad off its path", off=f"{off:.3f}") if _off(off, LIMITS.off_path_rad) else ""
    if seen.arm.moving:  # somewhere along its path
        off = float(np.abs(measured - sent.positions_rad).max(axis=1).min())
        return Message("a joint is {off} rad off its path", off=f"{off:.3f}") if _off(off, LIMITS.off_path_rad) else ""
    return "the arm does not follow its trajectory" if _off(_missed_rad(seen, sent), _near_rad(sent)) else ""


def _off(measured_rad: float, limit_rad: float) -> bool:
    return compared("supervisor arm_off_path", "off_path_rad", measured_rad, ">", limit_rad, __name__)


def _far_rad(sent: JointTrajectory) -> float:
    """How far the joint goes that goes farthest."""
    return float(np.abs(sent.positions_rad[-1] - sent.positions_rad[0]).max())


def _arrived(seen: Observation, sent: JointTrajectory) -> bool:
    """Whether the arm stands at the end of a trajectory; a short way is missed by less."""
    if seen.arm.moving or not seen.arm.stands or seen.arm.known_rad(sent.positions_rad.shape[1]) is None:
        return False
    return _missed_rad(seen, sent) <= _near_rad(sent)


def _missed_rad(seen: Observation, sent: JointTrajectory) -> float:
    """How far the joint is from the end of a trajectory that is farthest from it."""
    return float(np.abs(np.array(seen.arm.positions_rad) - sent.positions_rad[-1]).max())


def _near_rad(sent: JointTrajectory) -> float:
    """How near its end counts as there; a short way is missed by less."""
    return max(LIMITS.arrived_rad, min(LIMITS.rest_rad, _far_rad(sent) / 2))


def _of_gripper(words: Callable[[Observation, Memory], str]) -> Check:
    def check(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        return FaultReport(found) if (found := words(seen, memory)) else None

    return check


def _restarted(how: str, words: str) -> Check:
    def check(_: Observation, __: Command, memory: Memory) -> FaultReport | None:
        return (
            FaultReport(Message("the gripper restarted {words}", words=words))
            if memory.gripper.restarted == how
            else None
        )

    return check


def _stale_bench(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
    if seen.bench is None:
        why = [trouble.reason for trouble in seen.troubles if trouble.device in OF_OVERHEAD]
        return FaultReport("; ".join([*why, "no view of the bench yet"]))
    age_s = seen.time_s - seen.bench.time_s
    return (
        FaultReport(Message("the view of the bench is {age_s} s old", age_s=f"{age_s:.1f}"))
        if not compared("supervisor bench_stale", "stale_s", age_s, "<=", PLAUSIBLE.stale_s, PLAUSIBLE.__module__)
        else None
    )


def _future_bench(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
    ahead = seen.bench is not None and not seen.bench.time_s <= seen.time_s + PLAUSIBLE.future_s
    return FaultReport("the view of the bench is stamped with a time to come") if ahead else None


def _of_view(words: Callable[[BenchView], str]) -> Check:
    def check(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        found = "" if seen.bench is None else words(seen.bench)
        return FaultReport(found) if found else None

    return check


def _health(view: BenchView) -> str:
    """What is wrong with the image; what it does not show has rows of its own."""
    return "" if view.unseen or view.unexplained else _with("the overhead image is", view.health)


def _with(beginning: str, found: str) -> str:
    return Message("{beginning} {found}", beginning=beginning, found=found) if found else ""


def _camera_moved(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
    told = [view.calibration for view in (seen.bench, seen.parts) if view is not None and view.calibration]
    return FaultReport("; ".join(told)) if told else None


def _hand_unknown(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
    text = "" if seen.bench is None else seen.bench.hand_unknown
    words = text or "it is not seen any more, and no edge is told by which it left" * memory.hands.vanished
    return FaultReport(_with("where the hand is, is not known:", words)) if words else None


def _blind(_: Observation, __: Command, memory: Memory) -> FaultReport | None:
    return FaultReport(memory.hands.blind) if memory.hands.blind else None


def tick_checks(tick_s: float) -> dict[str, Check]:
    """Checks of a control loop with this period."""
    return {
        "tick_late": _late("late", LIMITS.late * tick_s),
        "tick_very_late": _late("very_late", LIMITS.very_late * tick_s),
    }


def _late(name: str, limit_s: float) -> Check:
    def check(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        return (
            FaultReport(Message("a tick came {late_s} s late", late_s=f"{seen.late_s:.2f}"))
            if compared("supervisor tick_late", name, seen.late_s, ">", limit_s, __name__)
            else None
        )

    return check


def _contested(_: Observation, command: Command, __: Memory) -> FaultReport | None:
    return (
        FaultReport(Message("two nodes commanded the {contested}", contested=" and the ".join(command.contested)))
        if command.contested
        else None
    )


def _rule(action: str) -> Check:
    def check(_: Observation, command: Command, __: Memory) -> FaultReport | None:
        found = [why for does, why in command.broken if does == action]
        return FaultReport("; ".join(found)) if found else None

    return check


def _either(*checks: Check) -> Check:
    """The first detection of several checks."""

    def look(seen: Observation, command: Command, memory: Memory) -> FaultReport | None:
        return next((found for check in checks if (found := check(seen, command, memory)) is not None), None)

    return look


CHECKS: Mapping[str, Check] = {
    "arm_lost": _lost_arm,
    "arm_lost_long": _lost_arm,
    "arm_time_wrong": _time_wrong,
    "arm_off_path": _off_path,
    "arm_off_path_long": _off_path,
    "arm_protective_stop": _mode("protective stop of the arm", "protective_stop", "recovery"),
    "arm_safeguard_stop": _safeguard,
    "arm_emergency_stop": _mode("emergency stop", "emergency_stop"),
    "arm_not_controlled": _mode("the arm takes no commands", "not_controlled"),
    "arm_fault": _either(_trouble_of("arm fault"), _mode("the arm reports a fault", "violation", "fault")),
    "arm_reduced": _mode("the arm is in reduced mode", "reduced"),
    "gripper_lost": _lost_gripper,
    "gripper_lost_long": _lost_gripper,
    "gripper_fault": _trouble_of("gripper fault"),
    "gripper_two_nodes": _of_gripper(
        lambda seen, _: (
            "statuses of the gripper contradict one another: two nodes speak under its identifier"
            * seen.gripper.two_nodes
        )
    ),
    "gripper_stale": _of_gripper(lambda seen, _: stale_words(seen)),
    "gripper_not_plausible": _of_gripper(lambda _, memory: memory.gripper.contradicts),
    "gripper_not_obeying": _of_gripper(lambda _, memory: memory.gripper.disobeys),
    "gripper_refuses": _of_gripper(lambda seen, memory: refusal_words(seen.gripper, memory.gripper)),
    "gripper_other_master": _of_gripper(
        lambda seen, _: "another master commands the gripper" * seen.gripper.other_master
    ),
    "gripper_bus_errors": _of_gripper(lambda seen, _: seen.gripper.bus_errors),
    "gripper_restarted_empty": _restarted("empty", "with empty fingers; once acknowledged, they open and close"),
    "gripper_restarted_holding": _restarted("holding", "with a part between its fingers"),
    "detector_lost": _trouble_of("detector overhead", "detector wrist"),
    "camera_lost": _trouble_of("camera overhead", "camera wrist"),
    "signals_lost": _trouble_of("signals"),
    "bench_stale": _stale_bench,
    "bench_in_the_future": _future_bench,
    "camera_unhealthy": _of_view(_health),
    "bench_not_seen": _of_view(lambda view: _with("overhead camera:", view.unseen)),
    "camera_moved": _camera_moved,
    "hand_unknown": _hand_unknown,
    "hand_detector_blind": _blind,
    "hand_cues_disagree": _of_view(lambda view: view.unexplained),
    "hand_depth_missing": _of_view(lambda view: view.depth_missing),
    **{f"rule_{action}s": _rule(action) for action in ("warn", "hold", "stop")},
    "command_contested": _contested,
}
