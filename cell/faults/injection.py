"""Fault injection: faults by name or as data, put in by proxies around the devices in a state of the work.

Nothing of a controller knows of it: a proxy answers as a broken device would. Faults that pass end by themselves.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import can

from cell.errors import InputError
from cell.faults.faulty_devices import FaultyArm, FaultyBus, FaultyCamera, FaultyPanel
from cell.faults.signal_faults import ORDERS, SignalFault
from cell.interfaces.command import Display
from cell.interfaces.devices import Devices
from cell.interfaces.operator import OperatorOrder
from cell.watching.observer import Observer, TickRecord
from skills.drivers.can_gripper import CanGripper

PASSES_S, SHORT_S = 1.5, 0.4
NOTICES_S = 3.0
BEGINS_TICKS = 5  # a state has lasted this long when the fault comes, so that the arm is under way
SHORT_TICKS = {"grasp": 2, "release": 2}  # states that are over sooner
SIGNALS = {"sigint": [signal.SIGINT], "sigterm_twice": [signal.SIGTERM] * 2, "sighup": [signal.SIGHUP]}

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
    """One fault with a name.

    Attributes:
        what: in words.
        ends: how a run may end with it, by names of `Outcome.end`: what the table of faults promises.
        signals: what is wrong, as `SignalFault.parse` reads it.
        lasts_s: after so long it goes away by itself; None for never.
        holding_ends: as `ends`, where a part is between the fingers; None for no difference.
        acknowledged: somebody acknowledges it, and an arm's mode is normal then.
        states: in which it can come; empty for all. One with states is of the world, a mishap with a part.
        promise: how the cell answers a mishap, in words.
    """

    what: str
    ends: tuple[str, ...]
    signals: tuple[str, ...] = ()
    lasts_s: float | None = None
    holding_ends: tuple[str, ...] | None = None
    acknowledged: bool = False
    states: tuple[str, ...] = ()
    promise: str = ""

    @property
    def of_world(self) -> bool:
        """No device has the fault."""
        return bool(self.states)


STOPS, RECOVERS, EITHER = ("fault",), ("finished",), ("fault", "finished")
STANDS = ("arm.follow:refused", "arm.pace:scaled:0")  # by itself, in some modes
RESTARTS = ("bus.GripperCommand:foreign:rACT=0", "bus.GripperHeartbeat:foreign:NodeState=0")


def _passes(what: str, *signals: str, lasts_s: float = PASSES_S) -> FaultKind:
    return FaultKind(what, RECOVERS, signals, lasts_s)


def _mishap(what: str, states: str, promise: str, *, asks: bool = False) -> FaultKind:
    """With the part that is held or about to be taken; where a person is asked and does not answer, the tree fails."""
    return FaultKind(what, (*RECOVERS, "failed") if asks else RECOVERS, states=tuple(states.split()), promise=promise)


def _stops(what: str, *signals: str) -> FaultKind:
    return FaultKind(what, STOPS, signals)


FAULTS: dict[str, FaultKind] = {
    "arm_frozen": _stops("the arm's state does not change any more, its time stamp neither", "arm.answer:stuck"),
    "arm_restamped": _stops("the arm's state does not change any more, but has new stamps", "arm.state:stuck"),
    "arm_nan": _stops("the arm's joints are not numbers", *(f"arm.positions_rad.{joint}:lost" for joint in range(6))),
    "arm_velocity_nan": _stops("one joint's speed is not a number", "arm.velocities_rad_s.3:lost"),
    "arm_five_joints": _stops("the arm reports five joints", "arm.positions_rad:cut"),
    "arm_offset": FaultKind(
        "the arm reports its base joint 0.03 rad off", EITHER, ("arm.positions_rad.0:offset:0.03",)
    ),
    "arm_lost": _stops("reading the arm raises", "arm.answer:refused"),
    "arm_deaf": _stops(
        "reading and commanding the arm raise",
        *("arm.answer:refused", "arm.follow:refused", "arm.stop:refused", "arm.pace:refused"),
    ),
    "arm_refuses": FaultKind("the arm refuses trajectories", EITHER, ("arm.follow:refused",)),
    "arm_ignores": FaultKind("the arm ignores trajectories", EITHER, ("arm.follow:lost",)),
    "arm_protective_stop": FaultKind(
        "protective stop until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:protective_stop", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_safeguard": _passes("the safeguard opens and closes", "arm.mode:foreign:safeguard_stop", *STANDS),
    "arm_emergency": FaultKind(
        "an emergency stop is pressed, until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:emergency_stop", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_not_controlled": FaultKind(
        "somebody stops the arm's program, until it is acknowledged",
        RECOVERS,
        ("arm.mode:foreign:not_controlled", "arm.stop:foreign", *STANDS),
        acknowledged=True,
    ),
    "arm_reduced": _passes("reduced mode for a while", "arm.mode:foreign:reduced"),
    "heartbeat_lost": _stops("no heartbeat of the gripper", "bus.GripperHeartbeat:lost"),
    "status_lost": _stops("no status of the gripper, although its heartbeat comes", "bus.GripperStatus:lost"),
    "status_gap": _passes("no status of the gripper for 0.4 s", "bus.GripperStatus:lost", lasts_s=SHORT_S),
    "bus_silent": _stops("nothing comes over the bus, and nothing goes", "bus.frames:lost"),
    "bus_off": _stops("reading the bus raises", "bus.frames:refused"),
    "bus_deaf": _stops("what is sent is lost", "bus.GripperCommand:lost"),
    "status_cut": _passes(
        "the gripper's status is cut to three bytes for 0.4 s", "bus.GripperStatus:cut", lasts_s=SHORT_S
    ),
    "status_twice": _passes("every frame comes twice", "bus.frames:repeated"),
    "gripper_fault": _stops("gFLT 0x0E, overcurrent", "bus.gFLT:foreign:14"),
    "gripper_refuses": _stops("gFLT 7, not activated", "bus.gFLT:foreign:7"),
    "gripper_stopped": _stops("the gripper's node says that it is stopped", "bus.NodeState:foreign:4"),
    "gripper_reboots": FaultKind(
        "the gripper's node starts again; empty, it is acknowledged",
        RECOVERS,
        RESTARTS,
        holding_ends=STOPS,
        acknowledged=True,
    ),
    "camera_dead": _passes("the overhead camera sends nothing for a while", "overhead.frame:lost"),
    "camera_raises": _passes("the overhead camera raises for a while", "overhead.frame:refused"),
    "camera_frozen": _passes("the same image with new numbers and stamps for a while", "overhead.image:stuck"),
    "camera_black": _passes("black images for a while", "overhead.image:lost"),
    "camera_swapped": _passes("red and blue swapped for a while", "overhead.image:flipped:2"),
    "camera_future": _passes("stamps of the future for a while", "overhead.time_s:offset:1000"),
    "sigint": FaultKind("SIGINT", ("interrupted",)),
    "sigterm_twice": FaultKind("SIGTERM, twice", ("interrupted",)),
    "sighup": FaultKind("SIGHUP", ("interrupted",)),
    "observer_raises": FaultKind("an observer raises in every tick", RECOVERS),
    "part_falls": _mishap(
        "the held part slips out of the fingers", "lift carry lower", "noticed by the fingers; another one is fetched"
    ),
    "part_sticks": _mishap(
        "the part stays at a finger that opens, until somebody takes it",
        "lift carry lower",
        "the hole is seen empty, the fingers close and feel the part: it is asked to be taken",
        asks=True,
    ),
    "part_jams": _mishap(
        "the peg does not go into its hole, until it was pulled out again",
        "lift carry",
        "felt; pulled out, and tried once more",
    ),
    "tray_pushed": _mishap(
        "all parts in the tray slide 3 cm", "look above down", "the fingers meet nothing or something else; seen anew"
    ),
    "hole_covered": _mishap(
        "another part comes to lie over the hole as the part is brought",
        "lift carry",
        "felt, or seen; nothing is let go, and it is asked to be cleared",
        asks=True,
    ),
    "part_missing": _mishap(
        "all parts of the type are gone from the tray", "look above down", "seen; it is asked for more", asks=True
    ),
    "part_broken": _mishap(
        "the peg of the part is bent and goes into no hole",
        "look above",
        "felt; after a second try it goes back, and another one is fetched",
    ),
    "part_wrong": _mishap(
        "another type stands where the part was seen", "look above down", "the fingers meet it, or feel its width"
    ),
}


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


class Attendant:
    """Somebody at the bench who acknowledges, after a while, what the panel says waits for that, and lets it go on.

    Implements `Panel`.
    """

    def __init__(self, devices: Devices) -> None:
        self._panel, self._clock, self._others = devices.panel, devices.clock, devices.pressed
        self._due_s: float | None = None
        self._stands = self._said = False

    def show(self, display: Display) -> None:
        """For the person who assembles."""
        self._panel.show(display)

    def alarm(self, text: str) -> None:
        """A trouble waits from now on, or none."""
        self._panel.alarm(text)
        self._stands = bool(text)
        self._due_s = self._clock.now_s() + NOTICES_S if text or self._said else None

    def pressed(self) -> Sequence[OperatorOrder]:
        """What was pressed since the last call; once more where the trouble is still there after as long again."""
        others = self._others()
        if self._due_s is None or self._clock.now_s() < self._due_s:
            return others
        self._said = self._stands
        self._due_s = self._clock.now_s() + NOTICES_S if self._stands else None
        return (*others, OperatorOrder("acknowledge" if self._stands else "resume"))


def attended(devices: Devices) -> Devices:
    """The same devices with somebody at them who acknowledges troubles."""
    attendant = Attendant(devices)
    return replace(devices, panel=attendant, pressed=attendant.pressed)


class Injection(Observer):
    """One fault in one state; also an observer, which sees the states come.

    Attributes:
        fault: a name of FAULTS, or what `SignalFault.parse` reads; empty until one is chosen.
        began_s: when the fault came; None before.
        shown: a device has answered with it.
        first_frame: number of the first frame that it spoiled.
        cleared: somebody has put an end to it.
    """

    def __init__(self, fault: str, state: str) -> None:
        """Args:
        fault: a name of FAULTS, a fault as data, or empty: one is chosen when it begins.
        state: a name of STATES, or of OTHER_STATES.

        Raises:
            InputError: there is none of that name.
        """
        kind = FAULTS.get(fault)
        legal = (kind.states if kind else ()) or (*STATES, *OTHER_STATES)
        if state not in legal:
            of = f" of fault {fault}" if kind is not None and kind.of_world else ""
            raise InputError(f"unknown state {state!r}{of}; legal: {', '.join(legal)}")
        self.fault, self.state = fault, state
        self.began_s: float | None = None
        self.shown = self.cleared = False
        self.first_frame: int | None = None
        self._faults, self._work = signals_of(fault), WorkState()
        self.now_s: Callable[[], float] = lambda: 0.0
        self._upset: Callable[[str], None] = lambda _: None

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
        lasts_s = self._kind.lasts_s
        return lasts_s is None or self.now_s() - self.began_s < lasts_s

    @property
    def _kind(self) -> FaultKind:
        return FAULTS.get(self.fault, FaultKind("as data", EITHER))

    @property
    def of_orders(self) -> bool:
        """Only the next command shows it."""
        return bool(self._faults) and all(one.device == "arm" and one.signal in ORDERS for one in self._faults)

    def on(self, device: str) -> Sequence[SignalFault]:
        """What is wrong with a device now."""
        return [one for one in self._faults if one.device == device] if self.active else ()

    def begin(self, fault: str, time_s: float) -> None:
        """The fault comes now."""
        self.fault, self._faults, self.began_s = fault, signals_of(fault), time_s
        for number in SIGNALS.get(fault, []):
            os.kill(os.getpid(), number)
        if self._kind.of_world:
            self._upset(fault)

    def acknowledged(self) -> None:
        """Somebody acknowledged what the arm tells: a stop by itself is over."""
        self.cleared |= self.active and self._kind.acknowledged

    def devices(self, devices: Devices) -> Devices:
        """The same devices with proxies; a gripper on CAN gets a bus with the fault.

        Raises:
            InputError: it is a fault of the gripper, which is not on CAN, or of the world, which is real.
        """
        self.now_s = devices.clock.now_s
        if devices.upset is not None:
            self._upset = devices.upset
        elif self._kind.of_world:
            raise InputError(f"fault {self.fault!r} needs a simulated bench")
        attendant = Attendant(devices)

        def pressed() -> Sequence[OperatorOrder]:
            return attendant.pressed() if self._kind.acknowledged else devices.pressed()

        if isinstance(devices.gripper, CanGripper):
            devices.gripper.change_bus(self._bus)
        elif any(one.device == "bus" for one in self._faults):
            raise InputError(f"fault {self.fault!r} needs a gripper of kind can")
        overhead, wrist = (
            FaultyCamera(camera, name, self)
            for name, camera in (("overhead", devices.overhead), ("wrist", devices.wrist))
        )
        arm, panel = FaultyArm(devices.arm, self), FaultyPanel(pressed, self)
        return replace(devices, arm=arm, overhead=overhead, wrist=wrist, panel=attendant, pressed=panel)

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


def signals_of(fault: str) -> tuple[SignalFault, ...]:
    """What is wrong with devices in a fault: one with a name, or one as data.

    Raises:
        InputError: it is neither.
    """
    if not fault or fault in FAULTS:
        return tuple(SignalFault.parse(text) for text in (FAULTS[fault].signals if fault else ()))
    if ":" not in fault:
        raise InputError(f"unknown fault {fault!r}; legal: {', '.join(FAULTS)}, or DEVICE.SIGNAL:KIND[:SIZE]")
    return (SignalFault.parse(fault),)
