"""Opens a cell without a tree, moves its arm slowly, and takes frames of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.simulator import simulator
from bracket_cell.skills.drivers.checked_arm import CheckedArm
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.wiring.devices import attached
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import Arm, Camera, Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

SHARE = 0.5  # of the speed of the arm
MOVING_MODES = ("normal", "reduced")
ARRIVED_RAD = 0.02
PATIENCE_S, PERIOD_S, STILL_S = 5.0, 0.04, 0.3


@contextmanager
def opened(configuration: Configuration, product: Product, seed: int = 0, slower: float = 1.0) -> Iterator[Devices]:
    """The devices of a cell, simulated ones among them; the arm is never sent what it must not follow.

    Raises:
        CellError: one could not be opened.
    """
    with ExitStack() as stack:
        simulated = None
        if configuration.devices.simulated:
            simulated = simulator().opened(configuration, product, seed)
            stack.callback(simulated.close)
        devices = stack.enter_context(attached(configuration, product, simulated, slower=slower))
        yield replace(devices, arm=CheckedArm(devices.arm, configuration.robot))


def move_to(devices: Devices, motion: MotionPlanner, goal_rad: Array, share: float = SHARE) -> None:
    """Bring the arm to joints, and wait until it stands; raises DeviceFault where it cannot get there."""
    start = np.array(devices.arm.state().positions_rad)
    way = motion.free_move(start, goal_rad, Load(motion.open_m))
    if isinstance(way, str):
        raise DeviceFault("arm", f"cannot get there: {way}")
    devices.arm.follow(way)
    begun_s = devices.clock.now_s()
    _follow(devices.arm, devices.clock, begun_s + way.duration_s / share + PATIENCE_S, share)
    off = float(np.abs(np.array(devices.arm.state().positions_rad) - goal_rad).max())
    if off > ARRIVED_RAD:
        raise DeviceFault("arm", f"it stands {off:.3f} rad beside where it was sent, limit {ARRIVED_RAD} rad")


def _follow(arm: Arm, clock: Clock, until_s: float, share: float) -> None:
    """Keep the arm going until it stands."""
    still_s = 0.0
    while still_s < STILL_S:
        arm.pace(share)
        clock.sleep_until(clock.now_s() + PERIOD_S)
        state = arm.state()
        if state.mode not in MOVING_MODES:
            arm.stop()
            raise DeviceFault("arm", state.reason or f"it went into the mode {state.mode}")
        still_s = 0.0 if state.moving else still_s + PERIOD_S
        if clock.now_s() > until_s:
            arm.stop()
            raise DeviceFault("arm", "it did not come to the end of its way")


def next_frame(camera: Camera, clock: Clock) -> Frame:
    """A frame that is newer than what the camera has now."""
    before, until_s = camera.latest(), clock.now_s() + PATIENCE_S
    while (frame := camera.latest()) is None or frame is before:
        if clock.now_s() > until_s:
            raise DeviceFault("camera", f"no frame came for {PATIENCE_S:g} s")
        camera.trigger()
        clock.sleep_until(clock.now_s() + PERIOD_S)
    return frame


def placed(frame: Frame, devices: Devices, motion: MotionPlanner) -> Frame:
    """A frame of a standing arm, with where its camera is."""
    if not frame.at_tool:
        return frame
    tool = motion.kinematics.forward(np.array(devices.arm.state().positions_rad))
    return frame.seen_from(tool @ frame.world_from_camera)
