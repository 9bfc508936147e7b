"""The contract suite on a device of a configuration: what every arm, gripper or camera must do, tried on this one."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from bracket_cell.configuration import Configuration
from bracket_cell.simulator import simulator
from bracket_cell.wiring.devices import attached, find_drivers, opened_alone
from bracket_ground.contracts import arm, camera, gripper
from bracket_ground.errors import CellError, SettingError
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.product import Product

Check = Callable[[Any], None]
CHECKS: Mapping[str, tuple[Check, ...]] = {
    "arm": tuple(check for check in arm.CHECKS if check is not arm.check_protective_stop),
    "gripper": tuple(check for check in gripper.CHECKS if check is not gripper.check_a_part_is_held_and_kept),
    **dict.fromkeys(
        ("overhead", "wrist"),
        tuple(check for check in camera.CHECKS if check is not camera.check_a_lost_camera_says_so_and_comes_back),
    ),
}  # what nobody need lend a hand for
MOVES = {
    "arm": f"the arm moves, each joint by up to {max(map(abs, arm.WAY_RAD))} rad from where it is: keep away",
    "gripper": "the fingers open and close: take everything out of them",
}


def role_of(configuration: Configuration, kind: str) -> str:
    """Which device of a configuration has a kind.

    Raises:
        SettingError: none has.
    """
    kinds = {role: getattr(configuration.devices, role).kind for role in CHECKS}
    if (role := next((role for role in CHECKS if kind in (role, kinds[role])), None)) is None:
        legal = ", ".join(dict.fromkeys([*kinds, *kinds.values()]))
        raise SettingError((("devices",), f"no device has the kind {kind!r}; legal: {legal}"))
    return role


def contracted(configuration: Configuration, product: Product, role: str, slower: float = 1.0) -> Iterator[DeviceCheck]:
    """Each check, with where it failed; the device is opened anew for each, and moves.

    Raises:
        CellError: it cannot be opened.
    """
    for check in CHECKS[role]:
        words = check.__doc__ or check.__name__.removeprefix("check_").replace("_", " ")
        what = f"{role}: {' '.join(words.split())}"
        with _opened(configuration, product, role, slower) as (device, clock):
            try:
                check(_bench(configuration, role, device, clock))
            except (AssertionError, CellError) as error:
                line = traceback.extract_tb(error.__traceback__)[-1].line
                yield DeviceCheck(what, str(error) or f"does not hold: {line}")
            else:
                yield DeviceCheck(what)


@contextmanager
def _opened(configuration: Configuration, product: Product, role: str, slower: float) -> Iterator[tuple[Any, Clock]]:
    """The device, in front of the simulated one where its driver asks for that."""
    drivers = {name: driver for name, driver in find_drivers(configuration).items() if name == role}
    if role in drivers and drivers[role].on_the_wall:
        with opened_alone(configuration, product, role, slower) as found:
            yield found
        return
    devices = simulator().opened(configuration, product, 0, rendered=role not in ("arm", "gripper"))
    try:
        with attached(configuration, product, devices, drivers) as opened:
            yield getattr(opened, role), opened.clock
    finally:
        devices.close()


def _bench(configuration: Configuration, role: str, device: Any, clock: Clock) -> Any:
    if role == "arm":
        return arm.Bench(device, clock)
    if role == "gripper":
        return gripper.Bench(device, clock, lambda _: None)
    setup = getattr(configuration.bench, role)
    return camera.Bench(device, clock, (setup.width_px, setup.height_px))
