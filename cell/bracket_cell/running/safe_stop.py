"""The safe stop: arm and gripper are ordered to stop, and again where that was refused, until the arm stands."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

from bracket_cell.running.device_reader import describe
from bracket_cell.running.gripper_checks import stale_words
from bracket_ground.interfaces.devices import Devices, Gripper
from bracket_ground.interfaces.observation import ObjectStatus, Observation

Answer = TypeVar("Answer")
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):
    """A second signal ended a tick that did not end by itself."""


class StopSignals:
    """Knows whether SIGINT, SIGTERM or SIGHUP came.

    Attributes:
        name: of the first signal; empty before it.
        taken: they come here.
    """

    def __init__(self) -> None:
        self.name = ""
        self.taken = False
        self._noted = self._interruptible = False

    @contextmanager
    def handled(self) -> Iterator[None]:
        """From here to the end of the block they come here, and raise KeyboardInterrupt."""
        before = {number: signal.signal(number, self._note) for number in STOPPING}
        self.taken = True
        try:
            yield
        finally:
            self.taken = False
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextmanager
    def heard(self) -> Iterator[None]:
        """In this block none raises, but within `interruptible`."""
        self._noted = True
        try:
            yield
        finally:
            self._noted = False

    def interruptible(self, work: Callable[[], Answer]) -> Answer:
        """Do work that a second signal may break off.

        Raises:
            Interrupted: it did. The handler raises at most once, and only between the two outer lines of this `try`.
        """
        try:
            try:
                self._interruptible = True
                return work()
            finally:
                self._interruptible = False
        except KeyboardInterrupt:
            raise Interrupted("interrupted in mid-tick") from None

    def _note(self, number: int, _: FrameType | None) -> None:
        again, self.name = bool(self.name), self.name or signal.Signals(number).name
        if not self._noted:
            raise KeyboardInterrupt
        if again and self._interruptible:
            self._interruptible = False
            raise KeyboardInterrupt


Order = Callable[[], object]


def stop_orders(devices: Devices, gripper: Gripper, seen: Observation | None) -> Mapping[str, Order]:
    """What has to be ordered, by what is wrong while it is not done; an emergency stop cuts the gripper's power."""
    orders: dict[str, Order] = {"the arm did not stop": devices.arm.stop}
    if seen is None or seen.arm.mode != "emergency_stop":
        orders["the gripper did not hold"] = gripper.hold
    return orders


def failure(order: Order) -> str:
    """What an order raised, in words; empty for nothing."""
    try:
        order()
    except (Exception, SystemExit) as error:  # whatever one raises, the safe stop goes on with the others
        return describe(error)
    return ""


def await_rest(
    orders: Mapping[str, Order],
    problems: dict[str, str],
    tick: Callable[[], Observation | None],
    now_s: Callable[[], float],
    timeout_s: float,
    gone: Callable[[], bool] = lambda: False,
) -> Observation | None:
    """Tick until the arm stands or the time is over; orders that were refused are given again.

    Args:
        gone: whether nobody need wait, as the arm is gone for good.
        problems: what went wrong so far, by what is wrong; kept up to date.
        tick: sleeps to the next tick and observes; None where nothing could be observed.

    Returns:
        The last observation.
    """
    until_s = now_s() + timeout_s
    while True:
        seen = tick()
        if seen is not None and at_rest(seen):
            return seen
        if gone() or now_s() >= until_s:
            what = "still moving" if seen is not None and seen.arm_answers else "not known to stand"
            problems["the arm did not come to rest"] = what if gone() else f"{what} {timeout_s:g} s after the stop"
            return seen
        for what, order in orders.items():
            if what in problems and not failure(order):
                del problems[what]


def at_rest(seen: Observation) -> bool:
    """The arm answered in this tick, gave up its trajectory, and no joint moves."""
    return seen.arm_answers and not seen.arm.moving and seen.arm.stands


def condition(seen: Observation | None, part: str) -> str:
    """How the cell was left, for people.

    Args:
        part: what the tree picked last; empty where it picked nothing.
    """
    if seen is None:
        return f"nothing is known of arm and gripper; it may hold {part or 'a part'}"
    arm = "the arm stands" if at_rest(seen) else "the arm is not known to stand"
    gripper = seen.gripper
    troubled = any(trouble.device.startswith("gripper") for trouble in seen.troubles)
    told = gripper.echoed and not stale_words(seen) and not troubled
    if not told or not gripper.activated or gripper.object_status is ObjectStatus.MOVING:
        return f"{arm}, nothing is known of the gripper; it may hold {part or 'a part'}"
    holds = f"holds {part or 'a part'}" if seen.gripper.holding else "holds nothing"
    return f"{arm}, the gripper {holds}"
