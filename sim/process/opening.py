"""Opens the simulated cell of a configuration: in this process, or in a world of its own."""

from __future__ import annotations

import hashlib
import multiprocessing
import signal
import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cell.configuration import Configuration
from cell.errors import CellError, InputError, SettingError
from cell.interfaces.devices import Devices
from cell.interfaces.product import Product
from sim.process import pacing as real_time
from sim.process.buses import CarriedBuses
from sim.process.client import RemoteCell, connected
from sim.process.messages import Ask, Drawn, Pace
from sim.process.server import WorldServer

if TYPE_CHECKING:
    from sim.cell import SimCell

PATIENCE_S = 60.0  # until a world of our own must be there
JOIN_S = 5.0


def open_simulation(
    configuration: Configuration, product: Product, seed: int, goal: str = "random", rendered: bool = True
) -> SimCell:
    """The simulated cell of a configuration, in this process; its cameras are told what the bench file says.

    Raises:
        CellError: it could not be opened.
    """
    from sim.cell import SimCell  # only now: a cell of real devices needs no simulator

    settings, (interface, channel) = configuration.devices.simulation, configuration.devices.gripper_bus
    bench, overlap = configuration.bench.drawn, settings.overlap and rendered
    return SimCell(
        product,
        bench,
        settings,
        interface,
        channel,
        seed,
        goal,
        overlap=overlap,
        rendered=rendered,
        robot=configuration.robot,
    )


def open_world(
    configuration: Configuration,
    product: Product,
    seed: int,
    goal: str,
    address: Path,
    private: bool = False,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[WorldServer, Devices]:
    """A simulated cell, and what serves it at an address; who calls closes its devices.

    Raises:
        CellError: it could not be opened, or the address cannot be had.
    """
    if not configuration.devices.simulated:
        raise SettingError((("devices",), "none of the devices is simulated: there is no world to open"))
    devices = open_simulation(configuration, product, seed, goal).devices
    period_s = configuration.devices.simulation.physics.control_period_s
    with ExitStack() as unless_opened:
        unless_opened.callback(devices.close)
        buses = CarriedBuses(configuration.devices.virtual_channels)
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
        InputError: no world is there, or it does not say.
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
        InputError: no world is there, or it does not accept such a controller.
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
    buses = CarriedBuses(configuration.devices.virtual_channels)
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
