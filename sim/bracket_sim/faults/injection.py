"""Fault injection: faults by name or as data, put in by proxies around the devices in a state of the work.

Nothing of a controller knows of it: a proxy answers as a broken device would. Faults that pass end by themselves.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import can

from bracket_cell.running.inference import Executor, FaultInjection
from bracket_cell.skills.drivers.can_gripper import CanGripper
from bracket_cell.watching.observer import TickRecord
from bracket_cell.watching.work_state import OTHER_STATES, STATES, WorkState
from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_sim.faults.faulty_devices import FaultyArm, FaultyBus, FaultyCamera, FaultyDetector, FaultyPanel
from bracket_sim.faults.named_faults import AS_DATA, FAULTS, FaultKind, signals_of
from bracket_sim.faults.signal_faults import ORDERS, SignalFault

NOTICES_S = 3.0
BEGINS_TICKS = 5  # a state has lasted this long when the fault comes, so that the arm is under way
SHORT_TICKS = {"grasp": 2, "release": 2}  # states that are over sooner
SIGNALS = {"sigint": [signal.SIGINT], "sigterm_twice": [signal.SIGTERM] * 2, "sighup": [signal.SIGHUP]}


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


class Injection(FaultInjection):
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
    def parse(cls, text: str, joints: int | None = None) -> Injection | Injections:
        """Of the option `--inject FAULT@STATE[,FAULT@STATE...]`, for an arm of so many joints where that is known."""
        pairs = [entry.partition("@") for entry in text.split(",")]
        for fault, _, _ in pairs:
            signals_of(fault, joints)
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
        return FAULTS.get(self.fault, AS_DATA)

    @property
    def told(self) -> str:
        """When the fault came, or that it never did."""
        never = f"{self.fault} never came: the work was not, or too briefly, in state {self.state}"
        return never if self.began_s is None else f"{self.fault} came at {self.began_s:.2f} s"

    @property
    def of_orders(self) -> bool:
        """Only the next command shows it."""
        return bool(self._faults) and all(fault.device == "arm" and fault.signal in ORDERS for fault in self._faults)

    def on(self, device: str) -> Sequence[SignalFault]:
        """What is wrong with a device now."""
        return [fault for fault in self._faults if fault.device == device] if self.active else ()

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
        elif any(fault.device == "bus" for fault in self._faults):
            raise InputError(f"fault {self.fault!r} needs a gripper of kind can")
        overhead, wrist = (
            FaultyCamera(camera, name, self)
            for name, camera in (("overhead", devices.overhead), ("wrist", devices.wrist))
        )
        arm, panel = FaultyArm(devices.arm, self), FaultyPanel(pressed, self)
        return replace(devices, arm=arm, overhead=overhead, wrist=wrist, panel=attendant, pressed=panel)

    def detectors(
        self, watcher: Executor[Frame, BenchView], finder: Executor[Frame, PartsView]
    ) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
        """The same detectors with proxies: of overhead and of wrist frames."""
        return (
            FaultyDetector(watcher, self, "bench", ("hand", "hole")),
            FaultyDetector(finder, self, "parts", ("part",)),
        )

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


class Injections(FaultInjection):
    """Several faults in one run, each in its state; an observer, too."""

    def __init__(self, injections: Sequence[Injection]) -> None:
        self.injections = tuple(injections)

    @property
    def told(self) -> str:
        """The same of all."""
        return "; ".join(injection.told for injection in self.injections)

    def devices(self, devices: Devices) -> Devices:
        """The same devices with the proxies of all."""
        for injection in self.injections:
            devices = injection.devices(devices)
        return devices

    def detectors(
        self, watcher: Executor[Frame, BenchView], finder: Executor[Frame, PartsView]
    ) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
        """The same detectors with the proxies of all."""
        for injection in self.injections:
            watcher, finder = injection.detectors(watcher, finder)
        return watcher, finder

    def tick(self, record: TickRecord) -> None:
        """All see the same states."""
        for injection in self.injections:
            injection.tick(record)
