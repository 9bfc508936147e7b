"""Fault injection: one list of faults, put in by proxies around the devices and the CAN bus in a state of the work.

Nothing of a controller knows of it: a proxy answers as a broken device would. Faults that pass end by themselves.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import can

from cell.errors import InputError
from cell.faults.faulty_devices import FaultyArm, FaultyBus, FaultyCamera
from cell.interfaces.devices import Devices
from cell.interfaces.operator import OperatorOrder
from cell.watching.observer import Observer, TickRecord
from skills.drivers.can_gripper import CanGripper

PASSES_S = 1.5
ACKNOWLEDGED = ("arm_protective_stop", "gripper_reboots")
SHORT_S = {"status_gap": 0.4, "status_cut": 0.4}
BEGINS_TICKS = 5  # a state has lasted this long when the fault comes, so that the arm is under way
SHORT_TICKS = {"grasp": 2, "release": 2}  # states that are over sooner

# By how a skill's note begins.
STATES = {
    "look": "moving to look",
    "above": "moving above",
    "down": "going down",
    "grasp": "grasping",
    "lift": "lifting",
    "carry": "carrying",
    "lower": "lowering",
    "release": "letting go",
    "leave": "leaving",
    "park": "moving to park",
}
STARTING = "activating"  # of the fingers: not idle yet
OTHER_STATES = ("idle", "waiting_for_help")


@dataclass(frozen=True)
class FaultKind:
    """One fault.

    Attributes:
        what: in words.
        passes: it goes away by itself after PASSES_S.
        ends: how a run may end with it, by names of `Outcome.end`: what the table of faults promises.
        holding_ends: the same where a part is between the fingers; None for no difference.
    """

    what: str
    passes: bool
    ends: tuple[str, ...]
    holding_ends: tuple[str, ...] | None = None


def _stops(what: str) -> FaultKind:
    return FaultKind(what, False, ("fault",))


def _recovers(what: str) -> FaultKind:
    return FaultKind(what, True, ("finished",))


FAULTS: dict[str, FaultKind] = {
    "arm_frozen": _stops("the arm's state does not change any more, its time stamp neither"),
    "arm_nan": _stops("the arm's joints are not numbers"),
    "arm_velocity_nan": _stops("one joint's speed is not a number"),
    "arm_five_joints": _stops("the arm reports five joints"),
    "arm_offset": FaultKind("the arm reports its base joint 0.03 rad off", False, ("fault", "finished")),
    "arm_lost": _stops("reading the arm raises"),
    "arm_deaf": _stops("reading and commanding the arm raise"),
    "arm_refuses": FaultKind("the arm refuses trajectories", False, ("fault", "finished")),
    "arm_ignores": FaultKind("the arm ignores trajectories", False, ("fault", "finished")),
    "arm_protective_stop": FaultKind("protective stop until it is acknowledged", False, ("finished",)),
    "arm_safeguard": _recovers("the safeguard opens and closes"),
    "arm_emergency": _stops("an emergency stop is pressed"),
    "arm_reduced": _recovers("reduced mode for a while"),
    "heartbeat_lost": _stops("no heartbeat of the gripper"),
    "status_lost": _stops("no status of the gripper, although its heartbeat comes"),
    "status_gap": _recovers("no status of the gripper for 0.4 s"),
    "bus_silent": _stops("nothing comes over the bus"),
    "bus_off": _stops("reading the bus raises"),
    "bus_deaf": _stops("what is sent is lost"),
    "status_cut": _recovers("the gripper's status is cut to three bytes for 0.4 s"),
    "status_twice": _recovers("every frame of the gripper comes twice"),
    "gripper_fault": _stops("gFLT 0x0E, overcurrent"),
    "gripper_refuses": _stops("gFLT 7, not activated"),
    "gripper_stopped": _stops("the gripper's node says that it is stopped"),
    "gripper_reboots": FaultKind(
        "the gripper's node starts again; empty, it is acknowledged", False, ("finished",), ("fault",)
    ),
    "camera_dead": _recovers("the overhead camera sends nothing for a while"),
    "camera_raises": _recovers("the overhead camera raises for a while"),
    "camera_frozen": _recovers("the same image with new numbers and stamps for a while"),
    "camera_black": _recovers("black images for a while"),
    "camera_swapped": _recovers("red and blue swapped for a while"),
    "camera_future": _recovers("stamps of the future for a while"),
    "sigint": FaultKind("SIGINT", False, ("interrupted",)),
    "sigterm_twice": FaultKind("SIGTERM, twice", False, ("interrupted",)),
    "sighup": FaultKind("SIGHUP", False, ("interrupted",)),
    "observer_raises": FaultKind("an observer raises in every tick", False, ("finished",)),
}


OF_THE_BUS = frozenset(name for name in FAULTS if name.startswith(("heartbeat_", "status_", "bus_", "gripper_")))


class WorkState:
    """Which state the work is in, from what skills note.

    Attributes:
        name: of STATES or OTHER_STATES; "start" before the arm is ready.
        ticks: how long it has been that.
    """

    def __init__(self) -> None:
        self.name, self.ticks = "start", 0

    def see(self, record: TickRecord) -> None:
        """A tick is over."""
        before = self.name
        for topic, fields in record.notes:
            if topic == "help":
                self.name = "waiting_for_help"
            elif topic == "skill":
                reason = str(fields.get("reason", ""))
                other = "start" if reason.startswith(STARTING) or self.name == "start" else "idle"
                self.name = next((name for name, start in STATES.items() if reason.startswith(start)), other)
        self.ticks = self.ticks + 1 if self.name == before else 0


class Injection(Observer):
    """One fault in one state; also an observer, which sees the states come.

    Attributes:
        fault: a name of FAULTS; empty until one is chosen.
        began_s: when the fault came; None before.
        shown: a device has answered with it.
        first_frame: number of the first frame that it spoiled.
        cleared: somebody has put an end to it.
    """

    def __init__(self, fault: str, state: str) -> None:
        """Args:
        fault: a name of FAULTS, or empty: one is chosen when it begins.
        state: a name of STATES, or of OTHER_STATES.

        Raises:
            InputError: there is none of that name.
        """
        if fault and fault not in FAULTS:
            raise InputError(f"unknown fault {fault!r}; legal: {', '.join(FAULTS)}")
        if state not in (*STATES, *OTHER_STATES):
            raise InputError(f"unknown state {state!r}; legal: {', '.join((*STATES, *OTHER_STATES))}")
        self.fault, self.state = fault, state
        self.began_s: float | None = None
        self.shown = self.cleared = False
        self.first_frame: int | None = None
        self._work = WorkState()
        self._presses_s = -1.0
        self._said: Literal["acknowledge", "resume", ""] = ""
        self._clock: Callable[[], float] = lambda: 0.0

    @classmethod
    def parse(cls, text: str) -> Injection | Injections:
        """Of the option `--inject FAULT@STATE[,FAULT@STATE...]`."""
        pairs = [entry.partition("@") for entry in text.split(",")]
        found = [cls(fault or "nothing", state or "carry") for fault, _, state in pairs]
        return found[0] if len(found) == 1 else Injections(found)

    @property
    def active(self) -> bool:
        """Whether the fault is there now."""
        if self.began_s is None or self.cleared:
            return False
        lasts_s = SHORT_S.get(self.fault, PASSES_S)
        return not FAULTS[self.fault].passes or self._clock() - self.began_s < lasts_s

    def begin(self, fault: str, time_s: float) -> None:
        """The fault comes now."""
        self.fault, self.began_s = fault, time_s
        numbers = {"sigint": [signal.SIGINT], "sigterm_twice": [signal.SIGTERM] * 2, "sighup": [signal.SIGHUP]}
        for number in numbers.get(fault, []):
            os.kill(os.getpid(), number)

    def devices(self, devices: Devices) -> Devices:
        """The same devices with proxies; a gripper on CAN gets a bus with the fault.

        Raises:
            InputError: it is a fault of the gripper, which is not on CAN.
        """
        self._clock = devices.clock.now_s
        arm, overhead = FaultyArm(devices.arm, self), FaultyCamera(devices.overhead, self)

        def pressed() -> Sequence[OperatorOrder]:
            return (*devices.pressed(), *self._acknowledgement())

        if isinstance(devices.gripper, CanGripper):
            devices.gripper.change_bus(self._bus)
        elif self.fault in OF_THE_BUS:
            raise InputError(f"fault {self.fault!r} needs a gripper of kind can")
        return replace(devices, arm=arm, overhead=overhead, pressed=pressed)

    def _acknowledgement(self) -> Sequence[OperatorOrder]:
        """Somebody at the bench acknowledges what waits for that, after a while and again, and then lets it go on."""
        if self.fault not in ACKNOWLEDGED or self.began_s is None or self._clock() < self._presses_s:
            return ()
        first, said = self._presses_s < self.began_s, self._said
        self._presses_s = (self.began_s if first else self._clock()) + PASSES_S
        if first:
            return ()
        self._said = "resume" if said == "acknowledge" else "acknowledge" if self.active else ""
        return (OperatorOrder(self._said),) if self._said else ()

    def _bus(self, bus: can.BusABC, database: Any) -> can.BusABC:
        """The same bus with a proxy."""
        faulty: Any = FaultyBus(bus, self, database)
        return faulty  # type: ignore[no-any-return]

    def tick(self, record: TickRecord) -> None:
        """See in which state the work is; at the wanted one the fault comes."""
        self._work.see(record)
        lasted = self._work.ticks >= SHORT_TICKS.get(self.state, BEGINS_TICKS)
        if self.began_s is None and self._work.name == self.state and lasted:
            self.reached(record.observation.time_s)
        if self.fault == "observer_raises" and self.active:
            raise OSError(28, "No space left on device")

    def reached(self, time_s: float) -> None:
        """The work is in the wanted state."""
        self.begin(self.fault, time_s)


class Injections(Observer):
    """Several faults in one run, each in its state; an observer, too."""

    def __init__(self, injections: Sequence[Injection]) -> None:
        self.injections = tuple(injections)

    def devices(self, devices: Devices) -> Devices:
        """The same devices with the proxies of all."""
        for one in self.injections:
            devices = one.devices(devices)
        return devices

    def tick(self, record: TickRecord) -> None:
        """All see the same states."""
        for one in self.injections:
            one.tick(record)
