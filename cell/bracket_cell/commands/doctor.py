"""`cell doctor`: what is missing on this machine, and the exact command that gets it."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import metadata
from itertools import groupby
from pathlib import Path
from typing import Annotated

import can
import typer

from bracket_cell.commands.options import CONFIGURATION, ROS2_HELP, ConfigOption, JsonOption, SlowerOption
from bracket_cell.commands.terminal import print_json, wait_for_enter
from bracket_cell.configuration import Configuration, load_configuration, load_product, located
from bracket_cell.kinds import made
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.packages import LABORATORY, SIMULATOR, damaged_packages, how_to_install, missing_packages, offers
from bracket_cell.simulator import installed, simulator
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_cell.skills.motion.postures import misplaced_flange
from bracket_cell.wiring.bench_checks import bench_problems
from bracket_cell.wiring.detectors import check_detectors, with_detectors_for
from bracket_cell.wiring.devices import examined, find_drivers
from bracket_cell.wiring.limits import described
from bracket_ground.errors import CellError, InputError, Problem, SettingError, words_of
from bracket_ground.files.yaml_file import place_of
from bracket_ground.interfaces.product import Product

FREE_GB = 1.0  # a log takes about 0.02 GB a minute
TRIAL_S = 2.0  # of simulated time, to see how fast it passes
INSTALL = "make .venv/runtime in a clone, or pip install again"
BENCH = ("the arm rests in nothing", "bins, tray, bracket and obstacles do not overlap, and no hole is hidden")
ANEW = "make clean, then make run; with pip: delete the environment and install again"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        remedy: a command or sentence that helps; empty where all is well.
        needed: a run is not possible without.
    """

    what: str
    ok: bool
    remedy: str = ""
    needed: bool = True

    def __str__(self) -> str:
        state = "ok" if self.ok else "MISSING" if self.needed else "note"
        return f"{state:8}{self.what}" + (f"\n{'':8}{self.remedy}" if self.remedy else "")


def doctor(
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
    limits: Annotated[bool, typer.Option("--limits", help="Print the numbers in code that guard people.")] = False,
    contract: Annotated[
        str | None, typer.Option("--contract", metavar="KIND", help="Try what every arm, gripper, camera must do.")
    ] = None,
    ros2: Annotated[Path | None, typer.Option("--ros2", metavar="BAG", help=ROS2_HELP)] = None,
    slower: SlowerOption = 1.0,
) -> int:
    """Say what is missing on this machine and how to get it; status 1 if the cell cannot run.

    With --contract a device of the configuration, by its kind or role, is tried alone: it moves.
    """
    if limits:
        return _print_limits(as_json)
    if ros2 is not None:
        findings = _bag(ros2, config)
    else:
        findings = examine(config, slower) if contract is None else _contracted(config, contract, slower)
    healthy = all(finding.ok for finding in findings if finding.needed)
    if as_json:
        print_json({"healthy": healthy, "findings": [vars(finding) for finding in findings]})
    else:
        sys.stdout.writelines(f"{finding}\n" for finding in findings)
    return 0 if healthy else 1


def _contracted(path: Path, kind: str, slower: float) -> list[Finding]:
    """The contract suite on one device."""
    from bracket_cell.wiring.contracted import MOVES, contracted, role_of

    configuration = load_configuration(path)
    product = load_product(configuration, path)
    with located(path, configuration):
        role = role_of(configuration, kind)
        driver = find_drivers(configuration).get(role)
        if role in MOVES and driver is not None and driver.on_the_wall:
            wait_for_enter(MOVES[role])
        found = contracted(configuration, product, role, slower)
        return [Finding(check.what, not check.remedy, check.remedy) for check in found]


def _bag(path: Path, config: Path) -> list[Finding]:
    """What of a recording the cell's devices could take: notes."""
    from bracket_cell.plant.ros_bag import examined_bag

    configuration = load_configuration(config)
    found = examined_bag(path, configuration.robot, configuration.bench)
    return [Finding(check.what, not check.remedy, check.remedy, needed=False) for check in found]


def _print_limits(as_json: bool) -> int:
    if as_json:
        print_json({limit.key: vars(limit) for limit in described()})
        return 0
    for origin, group in groupby(described(), lambda limit: (limit.key.rpartition(".")[0], limit.origin)):
        sys.stdout.write(f"\n{origin[0]}: {origin[1]}\n")
        sys.stdout.writelines(f"  {limit.key:34} {limit.value!s:20} {limit.meaning}\n" for limit in group)
    return 0


def examine(path: Path, slower: float = 1.0) -> list[Finding]:
    """Look at everything that `cell run` needs with this configuration; what matters first comes first."""
    rendering = _rendering()
    rest = [_training(), _font(), _python(), _packages()]
    try:
        configuration = load_configuration(path)
        product = load_product(configuration, path)
    except CellError as error:
        return [rendering, Finding("configuration", False, str(error)), *rest]
    logs = configuration.log.folder
    rendering = replace(rendering, needed=bool(configuration.devices.simulated))
    machine = [rendering, _disk(logs), _writable(logs), *_can(configuration), _drivers(configuration, path)]
    there = all(finding.ok for finding in (rendering, *machine[3:]) if finding.needed)
    devices = [*_devices(configuration, product, path), *_examined(configuration, product, slower)] if there else []
    bench = _bench(configuration, product, path) if rendering.ok else ()  # without it the simulator is not loaded
    own = [Finding(f"configuration {path}", True), _arm(configuration), *bench]
    return [
        *machine,
        *devices,
        *own,
        _detectors(configuration, product),
        *(_weights(name, configuration, product) for name in ("semantic", "grasp")),
        *_signed(configuration, path),
        *rest,
    ]


def _arm(configuration: Configuration) -> Finding:
    """What was taken for granted about the arm, such as shapes of links whose meshes are missing, or looks wrong."""
    remarks = [*configuration.robot.remarks, *misplaced_flange(configuration.robot)]
    return Finding(f"shapes and joints of {configuration.robot.name}", not remarks, "; ".join(remarks), needed=False)


def _bench(configuration: Configuration, product: Product, path: Path) -> Iterator[Finding]:
    """Whether the arm rests in nothing, and all that stands on the bench has a place of its own, which may wait."""
    for what, wrong, needed in zip(BENCH, bench_problems(configuration, product), (True, False), strict=True):
        told = [str(Problem(place_of(path, where), what)) for where, what in wrong]
        yield Finding(what, not told, "; ".join(told), needed)


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    fits = (3, 11) <= sys.version_info[:2] < (3, 13)
    return Finding(f"Python {version}", fits, "" if fits else "install Python 3.11 or 3.12, remove .venv, make run")


def _packages() -> Finding:
    """The runtime's packages, as the installed project lists them."""
    try:
        needed, missing = missing_packages()
    except metadata.PackageNotFoundError:
        return Finding("the project is not installed in this environment", False, INSTALL)
    if missing:
        return Finding(f"{len(missing)} of {len(needed)} packages: {', '.join(missing)}", False, INSTALL)
    if damaged := damaged_packages():
        text = "; ".join(f"{name}: {why}" for name, why in sorted(damaged.items()))
        return Finding(f"packages whose files are not as they were installed: {text}", False, ANEW)
    return Finding(f"{len(needed)} packages, and all files of what is installed", True)


def _disk(folder: Path) -> Finding:
    free_gb = shutil.disk_usage(_there(folder)).free / 1e9
    enough = free_gb >= FREE_GB
    remedy = "" if enough else f"logs take 0.02 GB a minute: make room, or log to another disk (--log, {FREE_GB:g} GB)"
    return Finding(f"{free_gb:.1f} GB free for logs", enough, remedy, needed=False)


def _there(folder: Path) -> Path:
    """The folder, or what it would be made in."""
    return next(parent for parent in (folder, *folder.parents) if parent.exists())


def _drivers(configuration: Configuration, path: Path) -> Finding:
    """Whether the drivers are there and take their settings (opened only by a run)."""
    try:
        with located(path, configuration):
            drivers = find_drivers(configuration)
    except CellError as error:
        return Finding("drivers of the devices", False, str(error))
    own = [f"{role} {driver.make.__name__}" for role, driver in drivers.items()]
    return Finding(f"drivers: {', '.join(own) or 'the simulator alone'}", True)


def _examined(configuration: Configuration, product: Product, slower: float) -> Iterator[Finding]:
    """The real devices, each opened and looked at; nothing moves."""
    if drivers := find_drivers(configuration):
        from bracket_cell.skills.motion.kinematics import Kinematics

        for check in examined(configuration, drivers, product, Kinematics(configuration.motion).forward, slower):
            yield Finding(check.what, not check.remedy, check.remedy)


def _devices(configuration: Configuration, product: Product, path: Path) -> Iterator[Finding]:
    """Cameras and speed of the simulated cell."""
    if not configuration.devices.simulated:
        return
    try:
        with located(path, configuration):
            devices = simulator().opened(configuration, product, 0)
    except InputError as error:
        yield Finding("the simulated cell", False, str(error))
        return
    try:
        devices.wrist.trigger()
        begun_s = time.perf_counter()
        devices.clock.sleep_until(devices.clock.now_s() + TRIAL_S)
        speed = TRIAL_S / (time.perf_counter() - begun_s)
        blind = [name for name in ("overhead", "wrist") if getattr(devices, name).latest() is None]
    finally:
        devices.close()
    text = f"simulation {speed:.1f} x real time on {os.cpu_count()} CPUs"
    yield Finding(text, speed >= 1, "" if speed >= 1 else "--real-time will fall behind; end other programs", False)
    yield Finding("cameras overhead, wrist", not blind, f"no frame of {', '.join(blind)}" if blind else "")


def _training() -> Finding:
    """Only `cell train` needs it."""
    there = offers(LABORATORY)
    return Finding("training", there, "" if there else f"install it: {how_to_install(LABORATORY)}", needed=False)


def _rendering() -> Finding:
    if (found := installed()) is None:
        return Finding("the simulator", False, f"install it: {how_to_install(SIMULATOR)}")
    backend, remedy = found.rendering()
    return Finding(f"rendering by {backend}", not remedy, remedy)


def _font() -> Finding:
    """Only `cell show --png` needs it, so that a run begins without."""
    from btxml.views.picture import FONT_PACKAGE, draws_text

    what = "a font for pictures of trees (cell show --png)"
    return Finding(what, True) if draws_text() else Finding(what, False, f"apt-get install -y {FONT_PACKAGE}", False)


def _signed(configuration: Configuration, path: Path) -> Iterator[Finding]:
    """Whether a person signed the safety configuration, where something real moves."""
    from bracket_cell.runs.signing import moves_something, required_signature
    from bracket_cell.wiring.safety import safety_from

    with suppress(SettingError):  # said of the drivers
        if moves_something(find_drivers(configuration).values()):
            yield _signature(lambda: required_signature(path, safety_from(path)))


def _signature(required: Callable[[], object]) -> Finding:
    try:
        return Finding(f"safety configuration {required()}", True)
    except CellError as error:
        return Finding("signature of the safety configuration", False, str(error), needed=False)


def _detectors(configuration: Configuration, product: Product) -> Finding:
    """The trained detectors, as a run makes them; that a product of one's own is seen by colour is a note."""
    what = f"detectors {configuration.perception.words}"
    try:
        seen, notice = with_detectors_for(configuration, product)
        check_detectors(seen.bench, product, seen.perception)
    except SettingError as error:
        return Finding(what, False, f"{'; '.join(map(str, error.problems))}; cell train --all makes weights")
    return Finding(what, not notice, notice, needed=not notice)


def _weights(name: str, configuration: Configuration, product: Product) -> Finding:
    planner = getattr(configuration.planners, name)
    goals = OpenGoals.of(product, configuration.planners.semantic.new_goals)
    try:
        made(name, planner, product=product, goals=goals, confusions=None)
    except CellError as error:
        return Finding(f"{name} planner {planner.kind}", False, f"{error}; cell train --only {name}")
    return Finding(f"{name} planner {planner.kind}", True)


def _can(configuration: Configuration) -> Iterator[Finding]:
    settings = configuration.devices.gripper
    if not isinstance(settings, CanSettings):
        return
    what = f"CAN {settings.interface} {settings.channel}"
    try:
        can.Bus(interface=settings.interface, channel=settings.channel, bitrate=settings.bitrate).shutdown()
    except (can.CanError, OSError, ValueError) as error:
        remedy = f"for SocketCAN: ip link set {settings.channel} up type can bitrate {settings.bitrate}"
        yield Finding(what, False, f"{words_of(error)}; {remedy}")
        return
    yield Finding(what, True)


def _writable(folder: Path) -> Finding:
    try:
        with tempfile.TemporaryFile(dir=_there(folder)):
            return Finding(f"logs can be written to {folder}", True)
    except OSError as error:
        return Finding(f"logs can be written to {folder}", False, f"{error.strerror}; choose a file with --log")
