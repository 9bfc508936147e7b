"""Opens the simulated cell of a configuration: in this process, or in a world of its own."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bracket_cell.configuration import Configuration
from bracket_cell.remote import priority
from bracket_cell.remote.channel import Channel, Failure
from bracket_cell.remote.child import Child
from bracket_cell.remote.detecting import DetectByCamera
from bracket_ground.errors import CellError, InputError, LatchedFault, SettingError
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.product import Product
from bracket_sim.process.buses import CarriedBuses
from bracket_sim.process.client import RemoteCell, connected
from bracket_sim.process.messages import Ask, Drawn, FromNewcomer, Pace, ToNewcomer
from bracket_sim.process.server import WorldServer, peer
from bracket_sim.scene.settings import settings_of

if TYPE_CHECKING:
    from bracket_sim.cell import DrivenArm, SimCell
    from bracket_sim.scene.world import World

ANSWER_S = 5.0  # in which a world must say what it is; it may be in the middle of an advance
LEAVE_S = 0.5  # in which a world of our own must end once it was left


def open_simulation(
    configuration: Configuration,
    product: Product,
    seed: int,
    goal: str = "random",
    rendered: bool = True,
    detect: Callable[[], DetectByCamera] | None = None,
    arm: Callable[[World], DrivenArm] | None = None,
    worker: bool = True,
    watched: bool = True,
) -> SimCell:
    """The simulated cell of a configuration, in this process; its cameras are told what the bench file says.

    Args:
        detect: makes the detectors that run beside it, where frames are made beside it, too.
        arm: makes what drives the joints; by default an arm that follows joint trajectories.
        worker: with the person, or the robot alone.
        watched: cameras make frames; without, faster.

    Raises:
        CellError: it could not be opened.
    """
    from bracket_sim.cell import SimCell  # only now: a cell of real devices needs no simulator

    settings, (interface, channel) = settings_of(configuration.devices.simulation), configuration.devices.gripper_bus
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
        detect=detect,
        arm=arm,
        worker=worker,
        watched=watched,
    )


def open_world(
    configuration: Configuration,
    product: Product,
    seed: int,
    goal: str,
    door: Path | socket.socket,
    detect: Callable[[], DetectByCamera] | None = None,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[WorldServer, Devices]:
    """A simulated cell, and what serves it at an address or to one controller; who calls closes its devices.

    Raises:
        CellError: it could not be opened, or the address cannot be had.
    """
    if not configuration.devices.simulated:
        raise SettingError((("devices",), "none of the devices is simulated: there is no world to open"))
    cell = open_simulation(configuration, product, seed, goal, detect=detect)
    period_s = settings_of(configuration.devices.simulation).physics.control_period_s
    with ExitStack() as unless_opened:
        unless_opened.callback(cell.close)
        cell.await_ready()
        buses = CarriedBuses(configuration.devices.virtual_channels)
        unless_opened.callback(buses.close)
        server = WorldServer(cell.devices, buses, door, period_s, identity(product), Drawn(seed, goal), watch)
        unless_opened.pop_all()
    return server, cell.devices


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
    connection: Channel[Any] = Channel(connected(address), ToNewcomer)
    try:
        connection.send(Ask(), ANSWER_S)
        drawn = connection.receive(ANSWER_S)
    except (EOFError, TimeoutError):
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
    connection = connected(address)
    number = peer(connection)[0]
    return _remote(configuration, product, connection, f"world (pid {number})" if number else "world", pace)


def own_world(configuration: Configuration, product: Product, seed: int, goal: str) -> RemoteCell:
    """A world in a process of its own, on the wall's time, that ends with this one; nobody else can reach it.

    Raises:
        CellError: it could not be opened.
    """
    child = Child("world", partial(_serve, configuration, product, seed, goal))

    def glance() -> None:
        if child.halted:
            raise LatchedFault(str(child), "somebody stopped it")
        if (code := child.code()) is not None:
            raise LatchedFault(str(child), f"it died (exit code {code})")

    try:
        return _remote(configuration, product, child.socket, str(child), "real", glance, lambda: child.close(LEAVE_S))
    except BaseException:
        child.close()
        raise


def identity(product: Product) -> Mapping[str, str]:
    """What controller and world must agree about, by name."""
    return {"product": hashlib.sha256(product.model_dump_json().encode()).hexdigest()}


def _remote(
    configuration: Configuration, product: Product, connection: socket.socket, name: str, pace: Pace, *more: Any
) -> RemoteCell:
    """A world at the other end of a connection; the buses are closed where it takes no controller."""
    buses = CarriedBuses(configuration.devices.virtual_channels)
    try:
        return RemoteCell(connection, name, pace, identity(product), buses, *more)
    except BaseException:
        buses.close()
        raise


def _serve(configuration: Configuration, product: Product, seed: int, goal: str, connection: socket.socket) -> None:
    """The process of a world of one's own."""
    try:
        server, devices = open_world(configuration, product, seed, goal, connection)
    except CellError as error:
        Channel[Any](connection, FromNewcomer).send(Failure.of(error), ANSWER_S)
        return
    try:
        with priority.preferred():
            server.serve()
    finally:
        devices.close()
