"""Faults as data: what can be asked for happens, on arms of any count of joints, and the rest is refused in words."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.pose import Pose
from bracket_sim.faults.faulty_devices import FaultyArm, FaultyCamera, FaultyPanel
from bracket_sim.faults.injection import Injection
from bracket_sim.faults.signal_faults import ANY, DETECTED, SIGNALS, UNDRAWN, SignalFault, Spread

PERIOD_S = 0.04
KINDS = {
    name: (*(SIGNALS | DETECTED).get(name, Spread(())).kinds, *UNDRAWN.get(name, ()))
    for name in {**SIGNALS, **DETECTED, **UNDRAWN}
}
ASKED = [f"{name}:{kind}" for name, kinds in KINDS.items() for kind in kinds]


class Device:
    """An arm of seven joints, a camera and a panel, all sound; the path that was ordered last."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.path: JointTrajectory | None = None

    def state(self) -> ArmState:
        self.now_s += PERIOD_S
        return ArmState(self.now_s, (self.now_s,) * 7, (1.0,) * 7, True, path_s=self.now_s)

    def follow(self, path: JointTrajectory) -> None:
        self.path = path

    def pace(self, share: float) -> None:
        assert np.isfinite(share)

    def stop(self) -> None:
        """It stands."""

    acknowledge = trigger = stop

    def latest(self) -> Frame:
        self.now_s += PERIOD_S
        image = np.full((6, 8, 3), 90, np.uint8)
        return Frame("overhead", round(self.now_s / PERIOD_S), self.now_s, image, Pose((0.0, 0.0, 1.0)))

    def __call__(self) -> list[OperatorOrder]:
        return [OperatorOrder("pause", "now")]


def begun(text: str, device: Device) -> Injection:
    injection = Injection(text, "carry")
    injection.now_s = lambda: device.now_s
    injection.begin(text, 0.0)
    return injection


@pytest.mark.parametrize("text", [text for text in ASKED if text.startswith(("arm", "panel", "overhead", "wrist"))])
def test_what_can_be_asked_for_happens_without_another_error(text: str) -> None:
    device: Any = Device()
    injection, role = begun(text, device), "wrist" if text.startswith("wrist") else "overhead"
    arm, camera = FaultyArm(device, injection), FaultyCamera(device, role, injection)
    path = JointTrajectory(np.array([0.0, 1.0, 2.0]), np.linspace(np.zeros(7), np.ones(7), 3))
    acts = (arm.state, lambda: arm.follow(path), lambda: arm.pace(0.5), arm.stop, arm.acknowledge, camera.latest)
    for _ in range(9):
        for act in (*acts, FaultyPanel(device, injection)):
            with suppress(DeviceFault, OSError):
                act()
    if device.path is not None:
        assert device.path.positions_rad.shape[1] == 7


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_that_a_signal_cannot_have_is_refused_with_those_it_can(name: str) -> None:
    for kind in set(ANY) - set(KINDS[name]):
        with pytest.raises(InputError, match=f"no kind of fault in {name} is '{kind}'; legal: {KINDS[name][0]}"):
            SignalFault.parse(f"{name}:{kind}")


@pytest.mark.parametrize(
    ("text", "legal"),
    [
        ("arm.pace:foreign:slow", "a number"),
        ("arm.pace:foreign:nan", "a number"),
        ("arm.positions_rad:late:-1", "a number, 0 or more"),
        ("arm.follow:scaled:0", "a number, 0.001 or more"),
        ("overhead.image:flipped:up", "a number"),
        ("arm.mode:foreign:asleep", "reduced, protective_stop"),
        ("panel.orders:foreign:go", "pause, resume"),
        ("bus.GripperCommand:foreign:rACT", "REGISTER=NUMBER"),
        ("bus.GripperCommand:foreign:rACT=on", "REGISTER=NUMBER"),
    ],
)
def test_a_size_that_cannot_be_used_is_refused(text: str, legal: str) -> None:
    with pytest.raises(InputError, match=f"the size of .* must be {legal}"):
        SignalFault.parse(text)


def test_a_joint_is_one_that_the_arm_has() -> None:
    Injection.parse("arm.positions_rad.6:offset:0.1@carry", 7)
    with pytest.raises(InputError, match="the arm has joints 0 to 5"):
        Injection.parse("arm.positions_rad.6:offset:0.1@carry", 6)
    with pytest.raises(InputError, match=r"with a joint, from 0 on, of arm\.positions_rad"):
        Injection.parse("arm.pace.2:offset:0.1@carry", 6)
