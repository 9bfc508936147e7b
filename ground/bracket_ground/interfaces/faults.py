"""What the supervisor may decide and by which table: actions, conditions for clearing, faults (config/faults.yaml)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pydantic import Field, model_validator

from bracket_ground.files.files import shipped
from bracket_ground.files.model import Disagreement, Model
from bracket_ground.files.yaml_file import load_yaml


def shipped_faults() -> Path:
    """The table that comes with the cell; drivers are made and tried where no cell is installed."""
    return shipped("bracket_cell.config", "faults.yaml")


class FailureMode(NamedTuple):
    """What a signal means.

    Attributes:
        detected_when: what is seen of it.
        proven_by: what proves, in a sound cell, that the sense behind it works; where that ends is a sign of its own.
    """

    detected_when: str
    proven_by: str


ARM_ANSWERS, ARM_MOVES = "the arm answers in every tick", "joints and `path_s` go on while the arm moves"
STATUS, ECHO = "a status in every 0.1 s", "the status repeats the last command"
FRAMES, HAND = "new frames, each with its own number and stamp", "a hand was seen, and left by an edge of the view"
RULE = "`cell check` knows what the rule names"
NOTHING = "nothing: it counts as absent until it is told"
SIGNALS: Mapping[str, FailureMode] = {
    "arm_lost": FailureMode(
        "the arm's state cannot be read or is older than 0.25 s, or the arm refuses a command; acknowledged, it gets a "
        "new path",
        ARM_ANSWERS,
    ),
    "arm_lost_long": FailureMode("the arm stays lost", ARM_ANSWERS),
    "arm_not_plausible": FailureMode(
        "the arm's state has a value that is not finite, beyond its limits, or joints too few or many; or they move "
        "otherwise than its speeds say",
        "differences of positions and told speeds agree",
    ),
    "arm_stale": FailureMode(
        "two states of the arm in a row are missing, or the same one comes for 0.1 s while the arm moves", ARM_MOVES
    ),
    "arm_time_wrong": FailureMode("the arm's stamp is still to come, or goes backwards", "stamps increase, up to now"),
    "arm_off_path": FailureMode(
        "the arm is more than 0.025 rad from where its trajectory has it, or does not follow it", ARM_MOVES
    ),
    "arm_off_path_long": FailureMode("it stays off its path, such as by somebody who leans on it", ARM_MOVES),
    "arm_not_obeying": FailureMode(
        "the arm goes on faster than it may after reaction and braking, does not stand when it must, does not go on, "
        "or tells the same for 0.3 s while it moves",
        ARM_MOVES,
    ),
    "arm_slower": FailureMode("for a second the arm goes at less than a fifth of the speed that it may", ARM_MOVES),
    "arm_path_unknown": FailureMode(
        "the arm moves and does not tell `path_s`, or is not there: share is computed", "`path_s` is told"
    ),
    "arm_protective_stop": FailureMode("the arm stopped by itself because it was held back", ARM_ANSWERS),
    "arm_safeguard_stop": FailureMode(
        "the arm's safeguard input is open; it is acknowledged once it is closed, when nobody is inside", ARM_ANSWERS
    ),
    "arm_emergency_stop": FailureMode("an emergency stop is pressed", ARM_ANSWERS),
    "arm_fault": FailureMode("the arm reports a fault", ARM_ANSWERS),
    "arm_not_controlled": FailureMode(
        "the arm takes no commands: local control, its program stopped or paused, no power, brakes on", ARM_ANSWERS
    ),
    "arm_reduced": FailureMode("the arm's reduced mode is on", ARM_ANSWERS),
    "gripper_lost": FailureMode(
        "no heartbeat, a dead bus, or no status for a second; acknowledged, the arm gets a new path",
        "the node's heartbeat",
    ),
    "gripper_lost_long": FailureMode("the gripper stays lost", "the node's heartbeat"),
    "gripper_fault": FailureMode("a major fault of the gripper", STATUS),
    "gripper_stale": FailureMode("no status of the gripper for more than 0.1 s, although its heartbeat comes", STATUS),
    "gripper_not_plausible": FailureMode(
        "the gripper tells an opening that it cannot have or cannot have reached yet, or one that its own status "
        "contradicts, such as contact where the fingers never moved",
        STATUS,
    ),
    "gripper_not_obeying": FailureMode(
        "for 0.2 s the gripper does not repeat what it was told, its fingers move unasked, or do not arrive", ECHO
    ),
    "gripper_refuses": FailureMode(
        "an active gripper takes no commands (gFLT 5, 7 or unknown), or its node is stopped", ECHO
    ),
    "gripper_restarted_empty": FailureMode("the gripper lost its activation; nothing was between its fingers", STATUS),
    "gripper_restarted_holding": FailureMode("the gripper lost its activation with a part between its fingers", STATUS),
    "gripper_two_nodes": FailureMode(
        "statuses there and back again: two nodes speak under the gripper's identifier", STATUS
    ),
    "gripper_other_master": FailureMode("somebody else commands the gripper on its bus", NOTHING),
    "gripper_bus_errors": FailureMode(
        "error frames, more frames than can be read, or heartbeats that contradict one another or are unknown",
        "frames without errors",
    ),
    "detector_lost": FailureMode("the process of a detector died", "it answers"),
    "camera_lost": FailureMode(
        "a camera raises an error, what detects in its images does not answer, or the wrist image still shows a part "
        "that the robot took away",
        FRAMES,
    ),
    "signals_lost": FailureMode("the module or PLC with the digital signals is silent", "its words, or its questions"),
    "bench_stale": FailureMode("the newest view of the bench is older than 0.35 s, or there is none yet", FRAMES),
    "bench_in_the_future": FailureMode(
        "the view of the bench has a time stamp that is still to come", "stamps up to now"
    ),
    "camera_unhealthy": FailureMode(
        "the overhead image, or a part of it, is dark, glaring, frozen, noise, discoloured or blurred",
        "every part of an image has new pixels, in the light and colours of the first ones",
    ),
    "bench_not_seen": FailureMode(
        "the overhead image shows another place, a moved or covered view, or one from some time ago, as where the arm "
        "is seen moving later than its joints say",
        "edges of plate and tray are seen where the calibration has them, three times a second, and the rest looks as "
        "it did but for robot and hands",
    ),
    "camera_moved": FailureMode(
        "a camera sees holes or tray more than 10 mm off, at the start or once a minute", "holes and tray are found"
    ),
    "hand_not_plausible": FailureMode(
        "the answer about an overhead image has a hand that cannot be: a number that is not finite, a place, height or "
        "speed that no hand in view has, a box outside of the image, or a stamp of its own that is older or later",
        "every hand is where the camera looks, in the frame that was answered",
    ),
    "hand_unknown": FailureMode("the hand vanished inside the view without leaving by its edge", HAND),
    "hand_detector_blind": FailureMode(
        "a hole was filled or emptied, the gripper held nothing, and no hand was seen within 1 s",
        "a hand is seen where parts change",
    ),
    "hand_cues_disagree": FailureMode(
        "something large reaches into the view over the person's edge, and no hand is seen there",
        "hands are where the image differs from the empty bench",
    ),
    "hand_depth_missing": FailureMode(
        "the depth camera knows no depth under a hand for half a second", "depths under hands"
    ),
    "hand_near": FailureMode(
        "the hand is nearer than the protective distance at full speed: the share of speed is computed", HAND
    ),
    "hand_too_near": FailureMode(
        "the hand is nearer than the protective distance at the slow speed; the arm may only leave it", HAND
    ),
    "blind_area": FailureMode(
        "no hand is seen, and the tool works where the overhead camera does not look: share is computed", HAND
    ),
    "tick_late": FailureMode("a tick began more than two periods late", "the clock"),
    "tick_very_late": FailureMode("a tick began more than ten periods late", "the clock"),
    "rule_warns": FailureMode("a rule of the tree is broken, whose action is warn", RULE),
    "rule_holds": FailureMode("a rule of the tree is broken, whose action is hold", RULE),
    "rule_stops": FailureMode("a rule of the tree is broken, whose action is stop", RULE),
    "command_contested": FailureMode("two nodes commanded the arm or the gripper in one tick", "none is needed"),
}
HAND_TOO_NEAR, OFF_PATH, OFF_PATH_LONG = "hand_too_near", "arm_off_path", "arm_off_path_long"
LOST = ("arm_lost", "gripper_lost")
SAFEGUARD = "arm_safeguard_stop"
USUAL = ("hand_near", "blind_area")  # slower for these is how the cell works; the log has them, no message is shown
ACKNOWLEDGE = "acknowledge it when it may go on"  # how words end that wait for a person


if TYPE_CHECKING:
    Signal = str
else:
    Signal = Literal[tuple(SIGNALS)]


class Action(IntEnum):
    """What is done about a sign of trouble; the greatest of all wins."""

    RUN = 0
    WARN = 1
    SLOW = 2
    HOLD = 3
    STOP = 4


class Fault(Model):
    """One row of the table.

    Attributes:
        signal: what is seen.
        action: run, warn, slow, hold or stop.
        clear: itself (once it has gone), standstill (and the arm stands), person (and somebody acknowledged it), never.
        delay_s: how long it must be seen before anything is done.
        clear_s: how long it must be gone.
        stop_after_s: a hold or slow that lasts longer than this becomes a stop; None for never.
        share: largest share of speed of a `slow`; what a check itself finds may be less.
        stop_s, stop_m: of `arm_not_obeying`: how long a held arm may take to stand, and how far its tool may go
            meanwhile; None for no limit but the braking that is worked out.
        because: of `arm_safeguard_stop` that clears itself: what sees who is inside. Behind a gate somebody may stand
            when it closes; a scanner that sees the whole space needs no acknowledgement.
    """

    signal: Signal
    action: Literal["run", "warn", "slow", "hold", "stop"]
    clear: Literal["itself", "standstill", "person", "never"]
    delay_s: float = Field(default=0.0, ge=0, le=60, allow_inf_nan=False)
    clear_s: float = Field(default=0.0, ge=0, le=60, allow_inf_nan=False)
    stop_after_s: float | None = Field(default=None, gt=0, le=3600, allow_inf_nan=False)
    share: float = Field(default=1.0, gt=0, le=1, allow_inf_nan=False)
    stop_s: float | None = Field(default=None, gt=0, le=10, allow_inf_nan=False)
    stop_m: float | None = Field(default=None, gt=0, le=5, allow_inf_nan=False)
    because: str | None = Field(default=None, max_length=300)

    @model_validator(mode="after")
    def _because_of_a_safeguard(self) -> Fault:
        if self.because is not None and (self.signal, self.clear) != (SAFEGUARD, "itself"):
            raise ValueError(f"because belongs to {SAFEGUARD} with clear: itself")
        if self.because is not None and not self.because.strip():
            raise ValueError("because is empty: it says what sees who is inside")
        return self

    @property
    def does(self) -> Action:
        """The action, in the order of severity."""
        return Action[self.action.upper()]


class FaultTable(Model):
    """What the supervisor does about each sign of trouble: every signal has one row.

    Attributes:
        extends: shipped, where every signal that has no row here has that of the shipped table.
        faults: the rows, in any order.
    """

    extends: Literal["shipped"] | None = None
    faults: tuple[Fault, ...]

    @model_validator(mode="before")
    @classmethod
    def _with_shipped_rows(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("extends") != "shipped" or not isinstance(data.get("faults"), list):
            return data
        own = {str(row.get("signal")) for row in data["faults"] if isinstance(row, dict)}
        return {**data, "faults": data["faults"] + [row for row in shipped_table().faults if row.signal not in own]}

    @model_validator(mode="after")
    def _every_signal_once(self) -> FaultTable:
        found: set[str] = set()
        wrong: list[tuple[tuple[str | int, ...], str]] = []
        for row, fault in enumerate(self.faults):
            if fault.signal in found:
                wrong.append((("faults", row), f"signal {fault.signal} is in the table twice"))
            found.add(fault.signal)
        wrong += [
            (("faults",), f"no row for signal {name}: {mode.detected_when}")
            for name, mode in SIGNALS.items()
            if name not in found
        ]
        if wrong:
            raise Disagreement(wrong)
        return self


@cache
def shipped_table() -> FaultTable:
    """The table that comes with the program."""
    return load_yaml(shipped_faults(), FaultTable)


CLEARS = ("itself", "standstill", "person", "never")  # the easiest first


def weaker(table: FaultTable, floor: FaultTable) -> list[str]:
    """In which rows a table does less than another: a milder action, an easier clearing, a longer delay or limit."""
    rows = {fault.signal: fault for fault in floor.faults}
    return [f"{row.signal}: {what}" for row in table.faults for what in _weaker(row, rows[row.signal])]


def _weaker(row: Fault, floor: Fault) -> Iterator[str]:
    if row.does < floor.does:
        yield f"action {row.action} is milder than {floor.action}"
        return
    longer = ["delay_s"]
    if row.does is not Action.STOP:
        if CLEARS.index(row.clear) < CLEARS.index(floor.clear) and row.because is None:
            yield f"clear {row.clear} is easier than {floor.clear}"
        if row.clear_s < floor.clear_s:
            yield f"clear_s {row.clear_s:g} is shorter than {floor.clear_s:g}"
        longer.append("stop_after_s")
    if row.does is Action.SLOW:
        longer.append("share")
    for name in (*longer, "stop_s", "stop_m"):
        value, most = getattr(row, name), getattr(floor, name)
        if most is not None and (value is None or value > most):
            yield f"{name} {'without a limit' if value is None else f'{value:g}'} is more than {most:g}"


@dataclass(frozen=True)
class SafetyDecision:
    """What the supervisor allows in one tick.

    Attributes:
        speed_scale: of the speed along the path, 0 to 1; 0 holds the arm on its path.
        reasons: (signal, words for an operator) of all that acts, the gravest first.
        holding_faults: signals that hold the arm; empty where it is not held, and where the run is stopped.
        brings_back: a safeguard closed, and its row does not wait for a person: the arm is to be brought back.
    """

    action: Action = Action.RUN
    speed_scale: float = 1.0
    reasons: tuple[tuple[str, str], ...] = ()
    holding_faults: tuple[str, ...] = ()
    brings_back: bool = False

    @property
    def new_path(self) -> bool:
        """Whether the arm may be given another path; a held one stands at its beginning."""
        return self.action < Action.HOLD or self.holding_faults == (HAND_TOO_NEAR,)

    def gives_path_up(self, *, acknowledged: bool) -> bool:
        """Whether an arm that is held off its path or was lost forgets it and stays where somebody saw it."""
        return acknowledged and not {OFF_PATH, OFF_PATH_LONG, *LOST}.isdisjoint(self.holding_faults)

    @property
    def words(self) -> str:
        """All reasons, for people."""
        return "; ".join(dict.fromkeys(what for _, what in self.reasons))
