"""Finds the drivers that a configuration names, and opens them: alone, or in front of the simulator's devices."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

from bracket_cell.configuration import Configuration
from bracket_cell.device_settings import KINDS, NoGripper, NoPanel, OwnDevice, PagePanel, SimulatedDevice
from bracket_cell.plugins import asked, attribute, found_by, lacking, offered_by_packages, settings_of
from bracket_cell.skills.drivers.settings import CALIBRATIONS, DRIVERS, EXAMINERS, EXTRAS, READERS, RecordedSettings
from bracket_ground.errors import CellError, DeviceFault, SettingError
from bracket_ground.interfaces import devices
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.devices import (
    ROLES,
    Arm,
    Camera,
    DeviceCheck,
    Devices,
    EmptyPanel,
    Gripper,
    Panel,
    Signals,
)
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import Calibration

ENTRY_POINTS = "cell.devices"
RECORDED = {role: f"bracket_cell.log.replay.recorded:Recorded{name}" for role, name in (
    ("arm", "Arm"), ("gripper", "Gripper"), ("overhead", "Camera"), ("wrist", "Camera")
)}  # fmt: skip
PROTOCOLS: Mapping[str, type] = {
    "arm": Arm, "gripper": Gripper, "overhead": Camera, "wrist": Camera, "panel": Panel, "signals": Signals
}  # fmt: skip
OFFERED = ("settings", "clock", "bench", "product", "robot", "role", "simulated")  # what a driver may ask for, by name
AT_THE_BENCH = ("arm", "overhead", "wrist")  # the cameras see the arm: all are simulated, or none is


VIRTUAL = "virtual"  # a CAN bus within a process: a simulated node is at its other end
PANELS = (NoPanel, PagePanel)  # the page is opened by who runs: it shows more than a panel
TIMELESS = (*PANELS, NoGripper, RecordedSettings)


@dataclass(frozen=True)
class Driver:
    """What opens one device.

    Attributes:
        make: its class.
        asks: names of what it wants, of OFFERED.
    """

    role: str
    make: Callable[..., Any]
    settings: BaseModel
    asks: tuple[str, ...]

    @property
    def on_the_wall(self) -> bool:
        """Whether its time is the wall's: it stands in front of no simulated device, and tells nothing recorded."""
        virtual = getattr(self.settings, "interface", None) == VIRTUAL
        return not (virtual or "simulated" in self.asks or isinstance(self.settings, TIMELESS))

    def opened(self, **offered: object) -> Any:
        """The device.

        Raises:
            CellError: as the driver raised it, or a DeviceFault for anything else.
        """
        try:
            return self.make(**{name: value for name, value in offered.items() if name in self.asks})
        except CellError:
            raise
        except (Exception, SystemExit) as error:  # a user's driver may raise anything, or end the program
            raise DeviceFault(self.role, f"cannot be opened: {type(error).__name__}: {error}") from error


Drivers = Mapping[str, Driver]


def find_drivers(configuration: Configuration) -> Drivers:
    """The drivers of all devices that are not the simulator's, by role.

    Raises:
        SettingError: there is no such driver, its settings are wrong, or it cannot be mixed with simulated devices.
    """
    found: dict[str, Driver] = {}
    for role in ROLES:
        device = getattr(configuration.devices, role)
        if isinstance(device, OwnDevice):
            found[role] = _own_driver(role, device)
        elif device is not None and not isinstance(device, SimulatedDevice):
            make = _our_driver(role, device)
            found[role] = Driver(role, make, device, _asked(role, make))
    _refuse_mixture(configuration, found)
    return found


@contextmanager
def attached(
    configuration: Configuration,
    product: Product,
    simulated: Devices | None = None,
    drivers: Drivers | None = None,
    slower: float = 1.0,
) -> Iterator[Devices]:
    """Open the drivers, in front of the simulator's devices where there are such; they are closed at the end.

    Args:
        simulated: of the simulator, which is left open.
        drivers: those of the configuration by default.
        slower: how many times slower than the wall's a real cell's clock goes, as its twin does.

    Raises:
        CellError: a device could not be opened.
    """
    drivers = find_drivers(configuration) if drivers is None else drivers
    clock = WallClock(slower) if simulated is None else simulated.clock
    offered = {"clock": clock, "bench": configuration.bench, "product": product, "robot": configuration.robot}
    with ExitStack() as stack:
        opened: dict[str, Any] = {}
        for role, driver in drivers.items():
            behind = getattr(simulated, role, None)
            device = opened[role] = driver.opened(settings=driver.settings, simulated=behind, role=role, **offered)
            stack.callback(device.close)
        yield Devices(clock=clock, **opened) if simulated is None else replace(simulated, **opened)


def _our_driver(role: str, device: Any) -> type:
    """The class of a driver of the project, with the packages that it needs.

    Raises:
        SettingError: a package is missing.
    """
    if isinstance(device, PANELS):
        return EmptyPanel
    if isinstance(device, NoGripper):
        return devices.NoGripper
    name = RECORDED[role] if isinstance(device, RecordedSettings) else DRIVERS[type(device)]
    try:
        found: type = attribute(name)
    except ImportError as error:
        what = f"the driver needs the package {error.name}: pip install 'bracket-cell[{EXTRAS.get(str(error.name))}]'"
        raise SettingError((_kind(role), what)) from error
    return found


def examined(
    configuration: Configuration, drivers: Drivers, product: Product, forward: Callable[[Any], Any], slower: float = 1.0
) -> Iterator[DeviceCheck]:
    """What a look at each real device shows; nothing moves. Devices of one's own have a static function `examine`.

    Args:
        forward: world_from_tool of joints (n,).
        slower: how many times slower than the wall's the devices' time goes, as their twin's does.
    """
    offered = {
        "clock": WallClock(slower), "bench": configuration.bench, "product": product, "robot": configuration.robot,
        "forward": forward,
    }  # fmt: skip
    for role, driver in drivers.items():
        ours = EXAMINERS.get(type(driver.settings))  # type: ignore[arg-type]
        look = getattr(driver.make, "examine", None) if ours is None else attribute(ours)
        if look is None:
            continue
        given = {**offered, "settings": driver.settings, "role": role}
        asked = inspect.signature(look).parameters
        try:
            yield from look(**{name: value for name, value in given.items() if name in asked})
        except CellError as error:
            yield DeviceCheck(role, str(error))


@contextmanager
def opened_alone(
    configuration: Configuration, product: Product, role: str, slower: float = 1.0
) -> Iterator[tuple[Any, WallClock]]:
    """One real device without the others, and its clock.

    Raises:
        CellError: it is simulated, or could not be opened.
    """
    driver = find_drivers(configuration).get(role)
    if driver is None:
        raise SettingError((_kind(role), f"the {role} is simulated: there is nothing that a person could lead or try"))
    clock = WallClock(slower)
    offered = {"clock": clock, "bench": configuration.bench, "product": product, "robot": configuration.robot}
    device = driver.opened(settings=driver.settings, role=role, simulated=None, **offered)
    try:
        yield device, clock
    finally:
        device.close()


@contextmanager
def joints_by_hand(configuration: Configuration, product: Product) -> Iterator[Callable[[], Sequence[float]]]:
    """Tells the joints (n,) of a real arm while somebody leads it: without control over it, where its driver can.

    Raises:
        CellError: the arm is simulated, or cannot be read.
    """
    reader = READERS.get(type(configuration.devices.arm))
    if reader is not None:
        read = attribute(reader)
        yield lambda: read(configuration.devices.arm)
        return
    with opened_alone(configuration, product, "arm") as (arm, _):
        yield lambda: arm.state().positions_rad


def own_calibration(configuration: Configuration) -> Calibration:
    """What the arm tells of itself.

    Raises:
        CellError: it tells nothing of the kind.
    """
    read = CALIBRATIONS.get(type(configuration.devices.arm))
    if read is None:
        raise SettingError((_kind("arm"), "this arm tells no calibration of its own"))
    found: Calibration = attribute(read)(configuration.devices.arm)
    return found


def _own_driver(role: str, device: OwnDevice) -> Driver:
    section, installed = ("devices", role), offered_by_packages(ENTRY_POINTS)
    make = found_by(device.kind, installed, section, device.folder, KINDS[role])
    if missing := lacking(make, PROTOCOLS[role], "close"):
        raise SettingError((_kind(role), f"{device.kind} lacks {', '.join(missing)}; see `cell docs drivers`"))
    settings = settings_of(make, device.kind, device.settings, section, device.folder)
    return Driver(role, make, settings, _asked(role, make))


def _asked(role: str, make: Callable[..., Any]) -> tuple[str, ...]:
    return asked(make, OFFERED, ("devices", role), "driver")


def _refuse_mixture(configuration: Configuration, drivers: Drivers) -> None:
    simulated = configuration.devices.simulated
    wrong = [role for role in AT_THE_BENCH if role in drivers and "simulated" not in drivers[role].asks]
    if simulated and wrong:
        what = (
            f"cannot work with the simulated {', '.join(simulated)}: these know the simulated bench alone. "
            "Give them drivers of their own, too (panel may be none), or let this driver ask for `simulated` "
            "(`cell docs drivers`)"
        )
        raise SettingError(*((_kind(role), f"{role} {what}") for role in wrong))


def _kind(role: str) -> tuple[str, ...]:
    return ("devices", role, "kind")
