"""Opens the devices that the configuration names: in this process, or in a world of their own."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

from cell.configuration import Configuration
from cell.errors import CellError, InputError, SettingError
from cell.interfaces.devices import Devices
from cell.interfaces.product import Product
from sim.process import pacing as real_time
from sim.process.buses import CarriedBuses
from sim.process.client import RemoteCell, connected
from sim.process.messages import Ask, Drawn, Pace
from sim.process.server import WorldServer

SIMULATED = "sim.cell:open_cell"  # the factory whose devices may live in a process of their own
PATIENCE_S = 60.0  # until a world of our own must be there
JOIN_S = 5.0


def configured_devices(configuration: Configuration, product: Product, seed: int, goal: str = "random") -> Devices:
    """As the configured factory opens them; it is told of the cameras what the bench file says.

    Raises:
        DeviceFault: a device could not be opened.
        SettingError: there is no such factory.
    """
    can_settings = configuration.gripper_can
    arguments = (
        product,
        configuration.bench.drawn,
        configuration.devices.simulation,
        can_settings.interface,
        can_settings.channel,
        seed,
        goal,
    )
    return _factory(configuration.devices.factory, arguments)(*arguments)


def open_world(
    configuration: Configuration,
    product: Product,
    seed: int,
    goal: str,
    address: Path,
    private: bool = False,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[WorldServer, Devices]:
    """The configured devices, and what serves them at an address; who calls closes them.

    Raises:
        CellError: they could not be opened, or the address cannot be had.
    """
    devices = configured_devices(configuration, product, seed, goal)
    period_s = configuration.devices.simulation.physics.control_period_s
    with ExitStack() as unless_opened:
        unless_opened.callback(devices.close)
        buses = CarriedBuses(configuration)
        unless_opened.callback(buses.close)
        server = WorldServer(devices, buses, address, period_s, identity(product), Drawn(seed, goal), private, watch)
        unless_opened.pop_all()
    return server, devices


def is_there(address: Path) -> bool:
    """Whether a world answers at an address; one that was killed leaves its socket behind."""
    try:
        drawn_from(address)
    except InputError:
        return False
    return True


def drawn_from(address: Path) -> Drawn:
    """What the world at an address was drawn from.

    Raises:
        InputError: nobody is there, or nobody who tells.
    """
    connection = connected(address)
    try:
        connection.send(Ask())
        drawn = connection.recv()
    except (EOFError, OSError):
        drawn = None
    finally:
        connection.close()
    if not isinstance(drawn, Drawn):
        raise InputError(f"{address}: the world does not tell what it was drawn from")
    return drawn


def connect(configuration: Configuration, product: Product, address: Path, pace: Pace) -> RemoteCell:
    """A world that somebody opened at an address.

    Raises:
        InputError: nobody is there, or the world takes no such controller.
    """
    return _remote(configuration, product, address, pace)


def own_world(configuration: Configuration, product: Product, seed: int, goal: str) -> RemoteCell:
    """A world in a process of its own, on the wall's time, that ends with this one.

    Raises:
        CellError: it could not be opened.
    """
    folder = tempfile.TemporaryDirectory(prefix="cell-")
    address = Path(folder.name) / "world.sock"
    context = multiprocessing.get_context("spawn")
    failed, theirs = context.Pipe(duplex=False)
    process = context.Process(
        target=_serve, args=(configuration, product, seed, goal, address, theirs), name="world", daemon=False
    )
    process.start()
    theirs.close()

    def closed() -> None:
        process.join(JOIN_S)
        if process.is_alive():
            process.kill()
            process.join(JOIN_S)
        folder.cleanup()

    def alive() -> bool:
        if failed.poll():
            try:
                raise failed.recv()
            except EOFError:
                return False
        return process.is_alive()

    try:
        return _remote(configuration, product, address, "real", PATIENCE_S, alive, closed)
    except BaseException:
        process.kill()
        closed()
        raise


def identity(product: Product) -> Mapping[str, str]:
    """What controller and world must agree about, by name."""
    return {"product": hashlib.sha256(product.model_dump_json().encode()).hexdigest()}


def _remote(configuration: Configuration, product: Product, address: Path, pace: Pace, *waiting: Any) -> RemoteCell:
    """A world at an address; the buses are closed where nobody is there."""
    buses = CarriedBuses(configuration)
    try:
        return RemoteCell(address, pace, identity(product), buses, *waiting)
    except BaseException:
        buses.close()
        raise


def _serve(configuration: Configuration, product: Product, seed: int, goal: str, address: Path, failed: Any) -> None:
    """The process of a world of one's own."""
    # Signals often go to all processes of a group: this one lives until the controller has stopped the arm.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    try:
        server, devices = open_world(configuration, product, seed, goal, address, private=True)
    except CellError as error:
        failed.send(error)
        return
    try:
        with real_time.preferred():
            server.serve()
    finally:
        devices.close()


def _factory(dotted: str, arguments: tuple[Any, ...]) -> Callable[..., Devices]:
    """The function that opens the devices, by its name in the configuration.

    Raises:
        SettingError: there is none, or it does not take these arguments.
    """
    where = ("devices", "factory")
    module, _, function = dotted.partition(":")
    try:
        factory: Callable[..., Devices] = getattr(_imported(module), function)
        inspect.signature(factory).bind(*arguments)
    except (ImportError, AttributeError) as error:
        raise SettingError((where, f"no such factory: {error}")) from None
    except (TypeError, ValueError) as error:
        raise SettingError((where, f"{dotted} opens no devices: {error}")) from None
    return factory


def _imported(module: str) -> ModuleType:
    """A module that may be a user's.

    Raises:
        ImportError: there is none.
        SettingError: it raises something else, or ends the program.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"{module} cannot be loaded: {type(error).__name__}: {error}"
        raise SettingError((("devices", "factory"), problem)) from error
