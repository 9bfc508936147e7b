"""What the supervisor looks for in the gripper: it answers, obeys, and contradicts neither itself nor its command."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand, HandCommand
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.gripper import Gripper
from bracket_ground.interfaces.observation import GripperState, ObjectStatus, Observation

LEAST_SPEED_M_S, LEAST_FORCE_N = 0.02, 20.0  # of usual fingers: under the 140 N of ISO/TS 15066 for fingers


@dataclass(frozen=True)
class GripperLimits:
    """When the gripper contradicts its commands; stroke and speeds are in its file. Origin: chosen, and tried with
    simulated faults.

    Attributes:
        stale_gripper_s: [s] age of a state that counts.
        held_lately_s: [s] in which a restart may show in another frame than the part that was held.
        echo_s: [s] in which a command is echoed; a lost one is repeated by half of it.
        beyond_m: [m] openings beyond closed and open that it may tell.
        off_m: [m] from the ordered opening.
        went_m: [m] less is no way at all.
        still_s: [s] in which fingers that move are seen to, or press.
        still_m: [m] that count as motion.
        slowest_s: [s] for speeding up, braking and pressing.
    """

    stale_gripper_s: float = 0.1
    held_lately_s: float = 0.25
    echo_s: float = 0.16
    beyond_m: float = 0.002
    off_m: float = 0.006
    went_m: float = 0.001
    still_s: float = 0.5
    still_m: float = 0.0002
    slowest_s: float = 1.0


LIMITS = GripperLimits()


@dataclass(eq=False)
class GripperMemory:
    """What is known of earlier ticks.

    Attributes:
        restarted: "empty" or "holding" from when the gripper lost its activation until it has it again; else empty.
        ever_active: the gripper was active at some time of the run.
        contradicts, disobeys: what is wrong now, in words; empty for nothing.
        stroke_m, fastest_m_s: of the gripper.
        held_kpa: of a cup, the pressure below the air's from which on it holds.
    """

    ever_active: bool = False
    restarted: str = ""
    contradicts: str = ""
    disobeys: str = ""
    stroke_m: float = 0.085
    fastest_m_s: float = 0.15
    held_kpa: float = 0.0
    _active: bool = field(default=False, init=False)
    _held_s: float = field(default=-math.inf, init=False)
    _goal: GripperCommand | None = field(default=None, init=False)
    _free_s: float = field(default=-math.inf, init=False)  # since when it may go; then when it was seen to
    _echoed_s: float = field(default=-math.inf, init=False)
    _moved_s: float = field(default=-math.inf, init=False)
    _opening_m: float = field(default=0.0, init=False)
    _from_m: float | None = field(default=None, init=False)  # where they rested free as they were sent
    _opens: bool = field(default=False, init=False)  # they were sent farther apart
    _before: GripperState | None = field(default=None, init=False)

    @staticmethod
    def of(gripper: Gripper) -> GripperMemory:
        """For a gripper, before its first state."""
        held_kpa = 0.0 if gripper.cup is None else gripper.cup.held_kpa
        return GripperMemory(stroke_m=gripper.stroke_m, fastest_m_s=gripper.does.speed_m_s[1], held_kpa=held_kpa)

    def see(self, gripper: GripperState, now_s: float) -> None:
        """A tick begins."""
        if gripper.activated:
            self.restarted = ""
        elif self._active:
            self.restarted = "holding" if now_s - self._held_s <= LIMITS.held_lately_s else "empty"
        if gripper.activated and gripper.holding:
            self._held_s = now_s
        self._active = gripper.activated
        self.ever_active |= gripper.activated
        told = self._before is None or gripper.time_s > self._before.time_s
        if gripper.echoed or not gripper.activated or not told:  # what tells nothing is stale, and no liar
            self._echoed_s = now_s
        self._follow(gripper, now_s)
        self.contradicts = self._impossible(gripper) or self._elsewhere(gripper, now_s)
        self.disobeys = self._disobeys(gripper, now_s)
        self._before = gripper

    def command(self, command: Command, judgement: SafetyDecision, now_s: float) -> None:
        """A tick ends with what goes out; held fingers stand, but for those that a hand gives or takes with."""
        goal = command.gripper or self._goal
        moves = goal is not None and self._before is not None and with_hand(goal, self._before, judgement)
        held = judgement.action >= Action.HOLD and not moves
        if command.gripper is not None and not held:
            self._goal, before = command.gripper, self._before
            rests = before is not None and before.object_status is ObjectStatus.AT_POSITION
            self._from_m = before.opening_m if before is not None and rests else None
            self._opens = self._before is not None and command.gripper.opening_m > self._before.opening_m
        if held or command.gripper is not None:
            self._free_s = self._moved_s = now_s

    def _follow(self, gripper: GripperState, now_s: float) -> None:
        """Where fingers were that rest, and when they moved last."""
        before = self._before
        changed = before is None or before.object_status is not gripper.object_status
        if changed or abs(gripper.opening_m - self._opening_m) > LIMITS.still_m:
            self._moved_s = now_s
        resting = gripper.object_status is not ObjectStatus.MOVING
        if changed or not resting or now_s - self._free_s <= LIMITS.echo_s:
            self._opening_m = gripper.opening_m

    def _impossible(self, gripper: GripperState) -> str:
        if not (math.isfinite(gripper.opening_m) and math.isfinite(gripper.current_a)):
            return "the gripper told a value that is not finite"
        if (before := self._before) is not None and gripper.activated and before.activated:
            took_s, moved_m = gripper.time_s - before.time_s, abs(gripper.opening_m - before.opening_m)
            if moved_m > self.fastest_m_s * max(took_s, 0.0) + 2 * LIMITS.off_m:
                return Message(
                    "the fingers went {moved_m} mm in {took_s} s, faster than they can",
                    moved_m=f"{moved_m * 1000:.0f}",
                    took_s=f"{took_s:.2f}",
                )
        if gripper.holding and gripper.vacuum_kpa is not None and not gripper.vacuum_kpa >= self.held_kpa:
            return Message("the cup says that it holds, at {kpa} kPa", kpa=f"{gripper.vacuum_kpa:.0f}")
        if not -LIMITS.beyond_m <= gripper.opening_m <= self.stroke_m + LIMITS.beyond_m:
            return Message("the gripper told an opening of {opening_m} mm", opening_m=f"{gripper.opening_m * 1000:.0f}")
        return ""

    def _elsewhere(self, gripper: GripperState, now_s: float) -> str:
        """Its fingers say that they have arrived or met something where they cannot have."""
        if self._goal is None or not self._settled(gripper, now_s):
            return ""
        beyond_m = gripper.opening_m - min(max(self._goal.opening_m, 0.0), self.stroke_m + LIMITS.beyond_m)
        wrong = {
            ObjectStatus.AT_POSITION: abs(beyond_m) > LIMITS.off_m,
            ObjectStatus.CONTACT_CLOSING: beyond_m < -LIMITS.off_m or self._opens,
            ObjectStatus.CONTACT_OPENING: beyond_m > LIMITS.off_m or not self._opens,
        }
        if gripper.object_status is ObjectStatus.CONTACT_CLOSING and self._never_went(gripper.opening_m):
            return "the fingers say that they met something, and never left where they were open"
        if not wrong.get(gripper.object_status, False):
            return ""
        told = gripper.object_status.name.lower().replace("_", " ")
        sent = "to open" if self._opens else "to close"
        return Message(
            "the fingers say {told}, {beyond_m} mm beside where they were sent {sent}",
            told=told,
            beyond_m=f"{abs(beyond_m) * 1000:.0f}",
            sent=sent,
        )

    def _never_went(self, opening_m: float) -> bool:
        """They were sent to close from where they rested free, and are still there: nothing is that wide."""
        if self._from_m is None or self._goal is None:
            return False
        return self._from_m - self._goal.opening_m > LIMITS.off_m and abs(opening_m - self._from_m) < LIMITS.went_m

    def _disobeys(self, gripper: GripperState, now_s: float) -> str:
        if now_s - self._echoed_s > LIMITS.echo_s:
            return Message(
                "for {now_s} s the gripper does not repeat what it was told", now_s=f"{now_s - self._echoed_s:.2f}"
            )
        if self._goal is None or not self._settled(gripper, now_s):
            return ""
        if gripper.object_status is not ObjectStatus.MOVING:
            moved_m = abs(gripper.opening_m - self._opening_m)
            unasked = Message("the fingers moved by {moved_m} mm unasked", moved_m=f"{moved_m * 1000:.0f}")
            return unasked if moved_m > LIMITS.off_m else ""
        longest_s = (self.stroke_m + LIMITS.beyond_m) / self._goal.speed_m_s + LIMITS.slowest_s
        if now_s - self._moved_s > LIMITS.still_s:
            return Message("the fingers do not move for {still_s} s, although they say so", still_s=LIMITS.still_s)
        late = Message("the fingers do not arrive within {longest_s} s", longest_s=f"{longest_s:.1f}")
        return late if now_s - self._free_s > longest_s else ""

    def _settled(self, gripper: GripperState, now_s: float) -> bool:
        """The status is about what the fingers were told, and nothing stops them."""
        return gripper.activated and gripper.echoed and now_s - self._free_s > LIMITS.echo_s


def stale_words(seen: Observation, limit_s: float = LIMITS.stale_gripper_s) -> str:
    """How old the status is, where that is too old."""
    age_s = seen.time_s - seen.gripper.time_s
    return Message("the gripper's status is {age_s} s old", age_s=f"{age_s:.2f}") if not age_s <= limit_s else ""


def refusal_words(gripper: GripperState, memory: GripperMemory) -> str:
    """Why it takes no command."""
    if gripper.node_state == "stopped":
        return "the gripper's node is stopped"
    refused = memory.ever_active and gripper.activated and gripper.fault > 0
    return Message("the gripper takes no command, gFLT 0x{fault}", fault=f"{gripper.fault:02X}") if refused else ""


def with_hand(goal: GripperCommand, gripper: GripperState, judgement: SafetyDecision) -> bool:
    """Whether fingers may move though a near hand, and nothing else, holds the arm: open, or close at their least."""
    gentle = goal.speed_m_s <= LEAST_SPEED_M_S and goal.force_n <= LEAST_FORCE_N
    opens = goal.opening_m >= gripper.opening_m
    return isinstance(goal, HandCommand) and judgement.new_path and gripper.activated and (opens or gentle)
