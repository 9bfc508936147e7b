"""`cell twin`: the simulated cell behind the wires of real devices, and its faults on demand."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Annotated, Any

import typer

from bracket_cell.commands.options import CONFIGURATION, ROS2_HELP, ConfigOption, JsonOption, SeedOption, SlowerOption
from bracket_cell.commands.terminal import console, print_json
from bracket_cell.configuration import Configuration, load_configuration, load_product, located, simulated
from bracket_cell.device_settings import OwnDevice
from bracket_cell.plugins import found_by
from bracket_cell.runs.options import GOAL_HELP, LOOK_HELP, PERSON_HELP
from bracket_cell.skills.drivers.settings import Ros2ArmSettings, Ros2CameraSettings, Ros2GripperSettings
from bracket_cell.wiring.devices import find_drivers
from bracket_ground.errors import InputError
from bracket_ground.interfaces.devices import ROLES
from bracket_sim.process.opening import open_simulation
from bracket_sim.scene.settings import settings_of
from bracket_sim.scene.world import World
from bracket_sim.twin.arm import TwinArm
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.control import ADDRESS, ControlDoor, ask
from bracket_sim.twin.ur_model import MODELS

CYCLE_S = 0.008  # of a controller of which nothing is known
DOMAINS = 232
CAMERA = {
    "topic": "color/image_raw/compressed",
    "info": "color/camera_info",
    "depth": "aligned_depth_to_color/image_raw",
}  # as realsense-ros names them

SocketOption = Annotated[Path, typer.Option("--socket", help="Socket file by which `cell twin fault` reaches it.")]

twin_app = typer.Typer(invoke_without_command=True, help="Serve the simulated cell by the wires of real devices.")


@twin_app.callback()
def twin(
    context: typer.Context,
    config: ConfigOption = CONFIGURATION,
    slower: SlowerOption = 1.0,
    goal: Annotated[str, typer.Option(help=GOAL_HELP)] = "random",
    seed: SeedOption = 0,
    person: Annotated[str | None, typer.Option(help=PERSON_HELP)] = None,
    look: Annotated[str | None, typer.Option(help=LOOK_HELP)] = None,
    ros2: Annotated[bool, typer.Option("--ros2", help=ROS2_HELP)] = False,
    at: SocketOption = ADDRESS,
) -> None:
    """Serve the simulated cell by the wires that the configuration's devices have; Ctrl-C ends it."""
    if context.invoked_subcommand is not None:
        return
    configuration = simulated(load_configuration(config), look, person)
    configuration = behind_ros2(configuration) if ros2 else configuration
    with located(config, configuration):
        cell = open_twin(configuration, config, seed, goal, slower)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: ended.set())
    try:
        wires = cell.serve()
        door = ControlDoor(cell, at)
        for wire in wires:
            console().print(wire.banner, highlight=False, soft_wrap=True)
        console().print(f"faults: cell twin fault NAME --socket {at}; Ctrl-C ends it", highlight=False, soft_wrap=True)
        ended.wait()
        door.close()
    finally:
        cell.close()


@twin_app.command()
def fault(
    name: Annotated[str | None, typer.Argument(help="Which; without one, all are listed.")] = None,
    at: SocketOption = ADDRESS,
) -> None:
    """Make something go wrong in a running twin."""
    if name is not None:
        console().print(ask(at, {"fault": name}), highlight=False)
        return
    for known, what in ask(at, {"faults": True}).items():
        console().print(f"{known}: {what}", highlight=False, soft_wrap=True)


@twin_app.command()
def report(at: SocketOption = ADDRESS, as_json: JsonOption = False) -> None:
    """Say how the assembly in a running twin stands, by the truth."""
    answer = ask(at, {"report": True})
    if as_json:
        print_json(answer)
        return
    for key, value in answer.items():
        console().print(f"{key}: {value}", highlight=False)


def behind_ros2(configuration: Configuration) -> Configuration:
    """With arm, gripper and cameras of the kind ros2; those that have this kind already stay as they are.

    Raises:
        InputError: ROS_DOMAIN_ID is no domain.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    if not (domain.isdecimal() and int(domain) <= DOMAINS):
        raise InputError(f"ROS_DOMAIN_ID is {domain!r}, must be 0 to {DOMAINS}")
    where: dict[str, Any] = {"domain": int(domain)}
    made: dict[str, Any] = {"arm": Ros2ArmSettings(**where), "gripper": Ros2GripperSettings(**where)}
    for role in ("overhead", "wrist"):
        topics: dict[str, Any] = {name: f"/{role}/{topic}" for name, topic in CAMERA.items()}
        if not getattr(configuration.bench, role).depth:
            topics["depth"] = ""
        made[role] = Ros2CameraSettings(**where, **topics)
    devices = configuration.devices
    changed = {role: device for role, device in made.items() if getattr(devices, role).kind != device.kind}
    return configuration.model_copy(update={"devices": devices.model_copy(update=changed)})


def open_twin(configuration: Configuration, path: Path, seed: int, goal: str, slower: float) -> TwinCell:
    """The twin of a configuration's cell, whose time stands until it serves; who calls closes it.

    Raises:
        CellError: it could not be opened.
    """
    product, name = load_product(configuration, path), configuration.robot.name
    devices, simulation = configuration.devices, settings_of(configuration.devices.simulation)
    known = MODELS.get(name.lower())
    period_s = CYCLE_S if known is None else 1.0 / known.rate_hz
    physics = simulation.physics.model_copy(update={"control_period_s": period_s})
    devices = devices.model_copy(update={"simulation": simulation.model_copy(update={"physics": physics})})
    arms: list[TwinArm] = []

    def made(world: World) -> TwinArm:
        arms.append(TwinArm(world))
        return arms[0]

    sim = open_simulation(configuration.model_copy(update={"devices": devices}), product, seed, goal, arm=made)
    sim.await_ready()
    settings = {role: device.model_dump() for role in ROLES if (device := getattr(devices, role)) is not None}
    return TwinCell(sim, arms[0], settings, name, period_s, slower, dict(_own_wires(configuration)))


def _own_wires(configuration: Configuration) -> Iterator[tuple[str, Any]]:
    """By role, what serves the wire of a driver of one's own: MODULE:CLASS in the class's attribute `twin`."""
    for role, driver in find_drivers(configuration).items():
        device, named = getattr(configuration.devices, role), getattr(driver.make, "twin", None)
        if isinstance(device, OwnDevice) and named is not None:
            yield role, found_by(named, {}, ("devices", role), device.folder, (), (type, FunctionType))
