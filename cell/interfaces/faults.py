"""What the supervisor may decide and by which table: actions, conditions for clearing, faults (config/faults.yaml)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, get_args

from pydantic import Field, model_validator

from cell.files.model import Disagreement, Model

Signal = Literal[
    "arm_lost",
    "arm_not_plausible",
    "arm_stale",
    "arm_off_path",
    "arm_protective_stop",
    "arm_safeguard_stop",
    "arm_emergency_stop",
    "arm_fault",
    "arm_reduced",
    "gripper_lost",
    "gripper_stale",
    "gripper_refuses",
    "gripper_restarted_empty",
    "gripper_restarted_holding",
    "detector_lost",
    "camera_lost",
    "bench_stale",
    "bench_in_the_future",
    "camera_unhealthy",
    "camera_moved",
    "hand_unknown",
    "hand_near",
    "hand_too_near",
    "blind_area",
    "tick_late",
    "tick_very_late",
    "command_contested",
]

SIGNALS: dict[Signal, str] = {
    "arm_lost": "the arm's state cannot be read, or the arm refuses a command",
    "arm_not_plausible": "the arm's state has a value that is not finite, beyond its limits, or not six joints",
    "arm_stale": "two states of the arm in a row are missing",
    "arm_off_path": "the arm is more than 0.025 rad from where its trajectory has it, or does not follow it",
    "arm_protective_stop": "the arm stopped by itself because it was held back",
    "arm_safeguard_stop": "the arm's safeguard input is open",
    "arm_emergency_stop": "an emergency stop is pressed",
    "arm_fault": "the arm reports a fault",
    "arm_reduced": "the arm's reduced mode is on",
    "gripper_lost": "no heartbeat, a dead bus, or a major fault of the gripper",
    "gripper_stale": "no status of the gripper for more than 0.1 s, although its heartbeat comes",
    "gripper_refuses": "an active gripper does not take commands (gFLT 5 or 7), or its node is stopped",
    "gripper_restarted_empty": "the gripper lost its activation; nothing was between its fingers",
    "gripper_restarted_holding": "the gripper lost its activation with a part between its fingers",
    "detector_lost": "the process of a detector died",
    "camera_lost": "a camera raises an error, or what detects in its images does not answer",
    "bench_stale": "the newest view of the bench is older than 0.35 s, or there is none yet",
    "bench_in_the_future": "the view of the bench has a time stamp that is still to come",
    "camera_unhealthy": "the overhead image is dark, bright, frozen, discoloured, blurred, or its landmarks moved",
    "camera_moved": "a camera sees holes or tray more than 10 mm off, at the start or once a minute",
    "hand_unknown": "the hand vanished inside the view without leaving by its edge",
    "hand_near": "the hand is nearer than the protective distance at full speed: the share of speed is computed",
    "hand_too_near": "the hand is nearer than the protective distance at the slow speed; the arm may only leave it",
    "blind_area": "no hand is seen, and the tool works where the overhead camera does not look: share is computed",
    "tick_late": "a tick began more than two periods late",
    "tick_very_late": "a tick began more than ten periods late",
    "command_contested": "two nodes commanded the arm or the gripper in one tick",
}
assert set(SIGNALS) == set(get_args(Signal))
HAND_TOO_NEAR: Signal = "hand_too_near"
OFF_PATH: Signal = "arm_off_path"
USUAL = ("hand_near", "blind_area")  # slower for these is how the cell works; the log has them, nobody is told
ACKNOWLEDGE = "acknowledge it when it may go on"  # how words end that wait for a person


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
        acknowledged_s: with `clear: person`, how long before it went it may have been acknowledged: fingers that are
            activated anew, or an arm that unlocks its brakes, take their time.
        person_after_s: what lasts longer than this is cleared as by `clear: person`; None for never.
        stop_after_s: a hold or slow that lasts longer than this becomes a stop; None for never.
        share: largest share of speed of a `slow`; what a check itself finds may be less.
    """

    signal: Signal
    action: Literal["run", "warn", "slow", "hold", "stop"]
    clear: Literal["itself", "standstill", "person", "never"]
    delay_s: float = Field(default=0.0, ge=0, le=10, allow_inf_nan=False)
    clear_s: float = Field(default=0.0, ge=0, le=60, allow_inf_nan=False)
    acknowledged_s: float = Field(default=5.0, ge=0, le=60, allow_inf_nan=False)
    person_after_s: float | None = Field(default=None, gt=0, le=3600, allow_inf_nan=False)
    stop_after_s: float | None = Field(default=None, gt=0, le=3600, allow_inf_nan=False)
    share: float = Field(default=1.0, gt=0, le=1, allow_inf_nan=False)

    @property
    def does(self) -> Action:
        """The action, in the order of severity."""
        return Action[self.action.upper()]


class FaultTable(Model):
    """What the supervisor does about each sign of trouble: every signal has one row.

    Attributes:
        faults: the rows, in any order.
    """

    faults: tuple[Fault, ...]

    @model_validator(mode="after")
    def _every_signal_once(self) -> FaultTable:
        found: set[str] = set()
        wrong: list[tuple[tuple[str | int, ...], str]] = []
        for row, fault in enumerate(self.faults):
            if fault.signal in found:
                wrong.append((("faults", row), f"signal {fault.signal} stands in the table twice"))
            found.add(fault.signal)
        wrong += [
            (("faults",), f"no row for signal {name}: {what}") for name, what in SIGNALS.items() if name not in found
        ]
        if wrong:
            raise Disagreement(wrong)
        return self


@dataclass(frozen=True)
class Judgement:
    """What the supervisor allows in one tick.

    Attributes:
        share: of the speed along the path, 0 to 1; 0 holds the arm on its path.
        reasons: (signal, words for an operator) of all that acts, the gravest first.
        held_by: signals that hold the arm; empty where it is not held, and where the run is stopped.
    """

    action: Action = Action.RUN
    share: float = 1.0
    reasons: tuple[tuple[str, str], ...] = ()
    held_by: tuple[str, ...] = ()

    @property
    def new_path(self) -> bool:
        """Whether the arm may be given another path; a held one stands at its beginning."""
        return self.action < Action.HOLD or self.held_by == (HAND_TOO_NEAR,)

    def gives_path_up(self, *, acknowledged: bool) -> bool:
        """Whether an arm that is held off its path forgets it and stays where somebody saw it."""
        return acknowledged and OFF_PATH in self.held_by

    @property
    def words(self) -> str:
        """All reasons, for people."""
        return "; ".join(what for _, what in self.reasons)


def fault_table_markdown(table: FaultTable) -> str:
    """The table for docs/safety.md."""
    rows = [
        "| signal | seen when | action | clears | after s | gone s | person after s | stops after s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for fault in table.faults:
        action = f"{fault.action} to {fault.share:.0%}" if fault.share < 1 else fault.action
        asks, stops = ("" if one is None else f"{one:g}" for one in (fault.person_after_s, fault.stop_after_s))
        cells = (fault.signal, SIGNALS[fault.signal], action, fault.clear, f"{fault.delay_s:g}")
        rows.append(f"| {' | '.join(cells)} | {fault.clear_s:g} | {asks} | {stops} |")
    return "\n".join(rows) + "\n"
