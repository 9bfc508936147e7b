"""The contract suite on a device of a configuration: what every arm, gripper or camera must do, tried on this one."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
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
MOST_S = 120.0  # of one check on the clock; the longest takes a quarter of it
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

    One that waits is the last; so is the first, which moves nothing, where it does not hold.

    Raises:
        CellError: it cannot be opened.
    """
    for check in CHECKS[role]:
        words = check.__doc__ or check.__name__.removeprefix("check_").replace("_", " ")
        what = f"{role}: {' '.join(words.split())}"
        found: list[str | CellError] = []
        tried = partial(_outcome, configuration, product, role, slower, check)
        thread = threading.Thread(target=lambda tried=tried, found=found: found.append(tried()), daemon=True)
        thread.start()
        thread.join(MOST_S * slower)
        if not found:
            last = traceback.extract_stack(sys._current_frames().get(thread.ident or 0))[-1]
            waits = f"does not come back within {MOST_S * slower:g} s, and no more is tried"
            yield DeviceCheck(what, f"{waits}; it is at {last.filename}:{last.lineno}: {last.line}")
            return
        if isinstance(found[0], CellError):
            raise found[0]
        yield DeviceCheck(what, found[0])
        if found[0] and check is CHECKS[role][0]:
            return


def _outcome(configuration: Configuration, product: Product, role: str, slower: float, check: Check) -> str | CellError:
    """What a check found, in words; why the device could not be opened."""
    try:
        with _opened(configuration, product, role, slower) as (device, clock):
            return _broken(check, _bench(configuration, role, device, clock))
    except CellError as error:
        return error
    except (Exception, SystemExit) as error:
        return _raised(error)


def _broken(check: Check, bench: object) -> str:
    try:
        check(bench)
    except (AssertionError, CellError) as error:
        line = traceback.extract_tb(error.__traceback__)[-1].line
        return str(error) or f"does not hold: {line}"
    except (Exception, SystemExit) as error:
        return _raised(error)
    return ""


def _raised(error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    words = f"{type(error).__name__} {' '.join(str(error).split())}".strip()
    return f"raises {words} at {last.filename}:{last.lineno}: a lost device raises DeviceFault, else nothing"


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
        return arm.Bench(device, clock, joints=len(configuration.robot.joints))
    if role == "gripper":
        return gripper.Bench(device, clock, lambda _: None)
    setup = getattr(configuration.bench, role)
    return camera.Bench(device, clock, (setup.width_px, setup.height_px))
