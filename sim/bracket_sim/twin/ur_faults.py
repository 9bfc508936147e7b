"""What goes wrong with the twin's arm on demand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.controller import Controller

BY_HAND_RAD = 0.3
LATE_S, SILENT_S = 0.15, 2.0
SLOW_SHARE, HEAVY_KG = 0.3, 2.0


class Samples(Protocol):
    """What tells where the arm is: late, not at all, or cut off until it is connected to again."""

    late_until_s: float
    silent_until_s: float

    def cut(self) -> None: ...


def offer_faults(cell: TwinCell, of: Controller, rtde: Samples, name: str = "rtde") -> None:
    """Add the faults of an arm with its controller to those of the cell.

    Args:
        name: of what tells the samples.
    """

    def put(name: str, value: object) -> Callable[[], None]:
        return lambda: setattr(of, name, value)

    def local(on: bool) -> None:
        of.remote = not on
        if on:
            of.stop_program()

    def moved() -> None:
        of.arm.push(np.array([0.0, 0.0, 0.0, 0.0, 0.0, BY_HAND_RAD]))

    def later(attribute: str, by_s: float) -> None:
        setattr(rtde, attribute, cell.now_s() + by_s)

    def restarted() -> None:
        of.restart()
        rtde.cut()

    def mended() -> None:
        of.mend()
        rtde.late_until_s = rtde.silent_until_s = 0.0

    cell.offer("mended", "nothing is wrong with the arm any more, it stands with its brakes off", mended)
    cell.offer("protective_stop", "the arm stops by itself", of.protective_stop)
    cell.offer("safeguard", "the safeguard opens", lambda: of.safeguard(closed=False))
    cell.offer("safeguard_closed", "the safeguard closes again", lambda: of.safeguard(closed=True))
    cell.offer("reduced", "reduced mode begins", lambda: of.reduce(on=True))
    cell.offer("reduced_over", "reduced mode ends", lambda: of.reduce(on=False))
    cell.offer("emergency_stop", "an emergency stop is pressed", lambda: of.emergency(pressed=True))
    cell.offer("emergency_released", "the button is pulled out again", lambda: of.emergency(pressed=False))
    cell.offer("local", "somebody switches to local control; the program stops", lambda: local(True))
    cell.offer("remote", "somebody switches back to remote control", lambda: local(False))
    cell.offer("paused", "somebody pauses the program at the pendant", of.pause)
    cell.offer("moved_by_hand", f"somebody turns the last wrist by {BY_HAND_RAD} rad", moved)
    cell.offer("played", "somebody lets the paused program go on", of.play)
    cell.offer("slider", f"the pendant's speed slider goes to {SLOW_SHARE:.0%}", put("slider", SLOW_SHARE))
    cell.offer("slider_full", "the slider goes to 100 %", put("slider", 1.0))
    cell.offer("fieldbus", "a fieldbus owns the lower registers", put("fieldbus", True))
    cell.offer("fieldbus_gone", "no fieldbus owns registers", put("fieldbus", False))
    cell.offer(
        f"{name}_late", f"samples come {LATE_S:g} s late, then all at once", lambda: later("late_until_s", LATE_S)
    )
    cell.offer(f"{name}_silent", f"nothing comes for {SILENT_S:g} s", lambda: later("silent_until_s", SILENT_S))
    cell.offer(f"{name}_cut", "all that tells of the arm is cut off", rtde.cut)
    cell.offer("controller_restarted", "the controller is switched off and on", restarted)
    cell.offer("payload_wrong", f"{HEAVY_KG:g} kg more hang on the tool than told", put("extra_kg", HEAVY_KG))
    cell.offer("payload_right", "what hangs on the tool is what was told", put("extra_kg", 0.0))
    cell.offer("turned", "the last wrist tells a whole turn more", lambda: of.turned_rad.__setitem__(5, 2 * np.pi))
