"""The cell's configuration (config/cell.yaml): one model for the whole file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field, model_validator

from bracket_cell.device_settings import DeviceSettings, NoGripper, OwnDevice, SimulatedDevice
from bracket_cell.kinds import DETECTORS, KindSettings, files_of, kind_of
from bracket_cell.settings import (
    ControllerSettings,
    LogSettings,
    PageSettings,
    Perception,
    Planners,
    PlantSettings,
    ProductionSettings,
)
from bracket_cell.simulator import simulator
from bracket_cell.skills.drivers.settings import (
    CanSettings,
    FingerSettings,
    ModbusSignalSettings,
    RecordedSettings,
    Ros2SignalSettings,
    SignalSettings,
    UrSettings,
    UrSignalSettings,
)
from bracket_cell.skills.motion.settings import MotionSettings, SeparationSettings
from bracket_cell.trees.guard import GuardSettings
from bracket_cell.trees.node_library import USUAL_FOLDER
from bracket_ground.errors import InputError, Problem, SettingError
from bracket_ground.files.files import shipped
from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.yaml_file import load_yaml, place_of
from bracket_ground.interfaces.bench import Bench, Calibration
from bracket_ground.interfaces.faults import FaultTable, shipped_faults, shipped_table, weaker
from bracket_ground.interfaces.gripper import NamedGripper
from bracket_ground.interfaces.places import EMPTY
from bracket_ground.interfaces.product import PartType, Product
from bracket_ground.interfaces.robot import NamedRobot, default_robot

DEFAULT_CONFIGURATION = shipped("bracket_cell.config", "cell.yaml")
FINGER_DRIVERS = (CanSettings, FingerSettings)
SHIFT_PART_S = 300.0  # the longest part of a shift's log, also where no bracket begins
SHIFT_LOG_MB = 4000.0  # parts of a shift's log that are kept where the configuration does not say how much
CALIBRATION = "calibration.yaml"  # what `cell setup calibrate` writes beside a configuration
DEFAULT_TREE = shipped("bracket_cell.trees", "ahead.xml")


class Configuration(Model):
    """Everything that a run needs to know beside its tree.

    Attributes:
        product: the product file, relative to this file.
        calibration: file of `cell setup calibrate`, relative to this file, in place of the bench's cameras.
        bench: where arm, bracket, tray and cameras stand. World frame: origin at the arm's base on the table top, x
            towards the person, z up.
        robot: the arm: one that is shipped, or a robot file, relative to this file.
        gripper: what is mounted on the arm, in place of what the robot's file says: a gripper that is shipped, or a
            gripper file, relative to this file.
        faults: what the supervisor does about each sign of trouble, relative to this file; none for the shipped table.
        nodes: files, folders and packages with nodes of your own, which every command loads; named from the folder
            of this file or the one above it.
        unsafe_table: a table or a separation that does less than the shipped one is taken, and said in red.
    """

    moved: ClassVar[Mapping[str, str]] = {
        "gripper_can": "the gripper is one of the devices now: devices: gripper: {kind: can, ...}",
        "signals": "signals are one of the devices now: devices: signals: {kind: can, ...}",
    }
    product: Path
    robot: NamedRobot = Field(default_factory=default_robot, json_schema_extra={"default": "ur10"})
    gripper: NamedGripper | None = None
    faults: Path | None = None
    nodes: tuple[str, ...] = ()
    unsafe_table: bool = False
    calibration: Path | None = None
    bench: Bench
    controller: ControllerSettings = ControllerSettings()
    perception: Perception = Perception()
    planners: Planners
    guard: GuardSettings = GuardSettings()
    motion: MotionSettings = MotionSettings()
    devices: DeviceSettings = Field(default_factory=DeviceSettings)
    log: LogSettings = LogSettings()
    page: PageSettings = PageSettings()
    plant: PlantSettings = PlantSettings()
    production: ProductionSettings = ProductionSettings()

    @property
    def signals(
        self,
    ) -> SignalSettings | ModbusSignalSettings | UrSignalSettings | Ros2SignalSettings | OwnDevice | None:
        """The module with digital signals, whose names tree files may use."""
        return self.devices.signals

    @property
    def timing_s(self) -> tuple[float, float]:
        """Period of the control loop, and by how much the arm's joints trail their set points (0: not said).

        What was measured of their reaction counts where it is more.
        """
        arm = self.devices.arm
        lag_s, measured_s = arm.lag_s if isinstance(arm, UrSettings) else 0.0, self.motion.stopping.reacts_s
        return 1.0 / self.controller.tick_hz, max(lag_s, max(measured_s, default=0.0) - SeparationSettings.arm_cycle_s)

    @model_validator(mode="after")
    def _poses_are_in_range(self) -> Configuration:
        places = []
        joints = self.robot.joints
        for name in ("arm_park_rad", "arm_look_rad"):
            if (given := getattr(self.bench, name)) and len(given) != len(joints):
                count = f"{name} has {len(given)} values, {self.robot.name} has {len(joints)} joints"
                places.append((("bench", name), f"{count}: {', '.join(joints)}; left out, it is found"))
                continue
            limits = self.robot.limits_rad.T.tolist()[: len(given)]
            for joint, value, (least, most) in zip(joints, given, limits, strict=False):
                if not least <= value <= most:
                    what = f"{name}: {joint} has {value:g}, {self.robot.name} turns from {least:.3f} to {most:.3f}"
                    places.append((("bench", name), what))
        if places:
            raise Disagreement(places)
        return self

    @model_validator(mode="after")
    def _the_shapes_of_a_real_arm_are_known(self) -> Configuration:
        links = self.robot.unshaped
        if links and not isinstance(self.devices.arm, SimulatedDevice | RecordedSettings):
            what = f"meshes of {', '.join(links)} are missing, and what a real arm would hit is not known"
            raise Disagreement([(("robot",), f"{what}: put them where {self.robot.urdf} says")])
        return self

    @model_validator(mode="after")
    def _the_driver_moves_such(self) -> Configuration:
        gripper = self.gripper or self.robot.gripper
        place, driver = ("devices", "gripper", "kind"), self.devices.gripper
        if isinstance(driver, NoGripper) and not gripper.nothing:
            raise Disagreement([(place, f"none moves nothing, and {gripper.name} holds parts; write gripper: none")])
        if gripper.fingers is None and isinstance(driver, FINGER_DRIVERS):
            legal = "none" if gripper.nothing else "simulated, or MODULE:CLASS of your own"
            raise Disagreement([(place, f"{driver.kind} moves fingers, and {gripper.name} has none; legal: {legal}")])
        return self

    @model_validator(mode="after")
    def _somebody_knows_the_holes(self) -> Configuration:
        if self.perception.chosen("holes").kind == "none" and self.guard.holes == "seen":
            what = "none reads no hole, and the robot would wait for ever: another kind, or guard.holes: graph"
            raise Disagreement([(("perception", "holes", "kind"), what)])
        return self

    @model_validator(mode="after")
    def _bits_are_signals(self) -> Configuration:
        module, bits = self.signals, self.plant.bits
        inputs, outputs = ((), ()) if module is None else (tuple(module.inputs), tuple(module.outputs))
        used: list[tuple[tuple[str, ...], str, tuple[str, ...]]]
        used = [(("shows", state), name, outputs) for state, name in bits.shows.items()]
        used += [(("orders", order), name, inputs) for order, name in bits.orders.items()]
        used += [(("recipe",), name, inputs) for name in bits.recipe]
        used += [(("begin",), name, inputs) for name in (bits.begin,) if name]
        places = [
            (("plant", "bits", *place), f"devices.signals has no {name!r} there; legal: {', '.join(legal) or 'none'}")
            for place, name, legal in used
            if name not in legal
        ]
        if places:
            raise Disagreement(places)
        return self

    def by_hand(self) -> Configuration:
        """The same cell without a hole reader, as the paper's: the hand alone tells what is placed."""
        guard = self.guard.model_copy(update={"holes": "graph"})
        return self.model_copy(update={"perception": self.perception.with_detector("holes", "none"), "guard": guard})


def load_configuration(path: Path | str = DEFAULT_CONFIGURATION, rested: bool = True) -> Configuration:
    """Read a configuration; paths in it become absolute.

    Args:
        rested: resting poses that it leaves out are found.

    Raises:
        InputError: with every problem of the file.
    """
    path = Path(path)
    read = load_yaml(path, Configuration)
    folder = path.parent.resolve()
    planners = {name: planner.model_copy(update=_beside(planner, folder)) for name, planner in read.planners}
    detectors = ((name, getattr(read.perception, name)) for name in DETECTORS)
    perception: dict[str, object] = {
        **{name: own.model_copy(update=_beside(own, folder)) for name, own in detectors if own is not None},
        "folder": read.perception.folder and folder / read.perception.folder,
        "crops": _crops(read, planners["grasp"], path),
    }
    faults = shipped_faults() if read.faults is None else folder / read.faults
    log = read.log.model_copy(update={"folder": Path.cwd() / read.log.folder})
    calibration = read.calibration and folder / read.calibration
    bench = read.bench if calibration is None else read.bench.calibrated(load_yaml(calibration, Calibration))
    robot = read.robot if read.gripper is None else read.robot.model_copy(update={"gripper": read.gripper})
    complete = read.model_copy(
        update={
            "product": folder / read.product,
            "robot": robot,
            "calibration": calibration,
            "bench": bench,
            "faults": faults,
            "nodes": nodes_from(read.nodes, path.parent),
            "perception": read.perception.model_copy(update=perception),
            "planners": read.planners.model_copy(update=planners),
            "devices": read.devices.beside(folder),
            "page": read.page.model_copy(update=_tls(read.page, folder)),
            "plant": read.plant.beside(folder),
            "motion": read.motion.of(robot, *read.timing_s),
            "log": log,
        }
    )
    if not rested or (bench.arm_look_rad and bench.arm_park_rad):
        return complete
    return with_rest(complete, load_product(complete, path), path)


def with_rest(configuration: Configuration, product: Product, path: Path) -> Configuration:
    """The same with resting poses of an arm whose file leaves them out."""
    from bracket_cell.learned.classical.bench_evidence import leaves_in_view
    from bracket_cell.skills.motion.resting import with_resting_poses  # a second that nobody else needs

    bench = configuration.bench
    try:
        bench = with_resting_poses(bench, product, configuration.motion, leaves_in_view(bench, product))
    except ValueError as error:
        raise InputError(Problem(place_of(path, ("bench",)), str(error))) from None
    return configuration.model_copy(update={"bench": bench})


def nodes_from(names: Iterable[str], folder: Path) -> tuple[str, ...]:
    """Nodes that a configuration names: absolute where there is such a file or folder, else the name of a package.

    The folder in which `cell new leaf` writes may be made later.
    """
    folders = (folder.resolve(), folder.resolve().parent)
    found = {name: next((str(place / name) for place in folders if (place / name).exists()), name) for name in names}
    return tuple(path for name, path in found.items() if path != name or name != str(USUAL_FOLDER))


def simulated(configuration: Configuration, look: str | None = None, person: str | None = None) -> Configuration:
    """The same cell with another look or person in its simulation; None leaves the configured one.

    Args:
        look: a preset, one section of it as in "hard:light", or a look file.
        person: a person's name or file; several with commas between take turns in a shift, a bracket each.

    Raises:
        InputError: there is no such look or person, or the file is wrong.
    """
    if look is None and person is None:
        return configuration
    return _simulated_by(configuration, look=look, person=person)


def _simulated_by(configuration: Configuration, **changes: Any) -> Configuration:
    devices = configuration.devices
    simulation = simulator().changed(devices.simulation, **changes)
    return configuration.model_copy(update={"devices": devices.model_copy(update={"simulation": simulation})})


def detected_by(configuration: Configuration, kind: str | None) -> Configuration:
    """The same cell with all detectors of one kind, classical or learned; None leaves the configured ones."""
    if kind is None:
        return configuration
    chosen = {"kind": kind, **dict.fromkeys(DETECTORS)}
    return configuration.model_copy(update={"perception": configuration.perception.model_copy(update=chosen)})


def unnamed_calibration(path: Path, configuration: Configuration) -> str:
    """What to say where a calibration lies beside a configuration that names none; empty otherwise."""
    beside = path.parent / CALIBRATION
    if configuration.calibration is not None or not beside.exists():
        return ""
    return f"{beside} is not used: {path} does not name it; to use it, add there: calibration: {CALIBRATION}"


def for_shift(configuration: Configuration, brackets: int) -> Configuration:
    """The same cell for many brackets in a row: more time, a part of the log for each, and a person who goes on.

    Args:
        brackets: how many; 0 for until the run is stopped.
    """
    if configuration.devices.simulated:
        configuration = _simulated_by(configuration, shift=True)
    longest_s = configuration.controller.max_duration_s * brackets if brackets else math.inf
    log = configuration.log
    if log.rotate_mb is None and log.rotate_s is None:
        log = log.model_copy(update={"rotate_brackets": True, "rotate_s": SHIFT_PART_S})
    if log.keep_mb is None and log.keep_parts is None:
        log = log.model_copy(update={"keep_mb": SHIFT_LOG_MB})
    return configuration.model_copy(
        update={"controller": configuration.controller.model_copy(update={"max_duration_s": longest_s}), "log": log}
    )


def _beside(chosen: KindSettings, folder: Path) -> dict[str, Path]:
    """Files of a detector or planner that are named relative to the configuration."""
    names = ("weights", "goals", "confusions")
    return {name: folder / file for name in names if (file := getattr(chosen, name, None)) is not None}


def _tls(page: PageSettings, folder: Path) -> dict[str, Path]:
    files = {"certificate": page.certificate, "key": page.key}
    return {name: folder / file for name, file in files.items() if file is not None}


def _crops(read: Configuration, grasp: KindSettings, path: Path) -> Path | None:
    """The network that the grasp planner wants beside the part detector; none for kinds that are yet to be found."""
    if read.perception.crops is not None:
        return path.parent.resolve() / read.perception.crops
    if ":" in grasp.kind:
        return None  # a class of the user's own is loaded where it is made
    try:
        crops = kind_of("grasp", grasp).crops
    except SettingError:  # whoever makes the planners says so, with all else that is wrong
        return None
    return crops and crops(next(iter(files_of("grasp", grasp).values())))


def load_faults(configuration: Configuration) -> FaultTable:
    """Read the table of faults that a configuration names.

    Raises:
        InputError: with every problem of the file.
    """
    return load_yaml(configuration.faults or shipped_faults(), FaultTable)


def weaknesses(configuration: Configuration, table: FaultTable) -> list[str]:
    """Where a cell's table of faults or its separation does less than the shipped one."""
    separation = configuration.motion.separation
    less = separation.weaker(separation.least_reaction_s(*configuration.timing_s))
    motion, robot = configuration.motion, configuration.robot
    return weaker(table, shipped_table()) + less + motion.stopping.weaker(robot.acceleration_rad_s2, robot.joints)


@contextmanager
def located(path: Path, configuration: Configuration) -> Iterator[None]:
    """Say of every SettingError in which line of which file it is.

    Args:
        path: the configuration's file.

    Raises:
        InputError: for a SettingError.
    """
    try:
        yield
    except SettingError as error:
        raise InputError(*(_located(path, configuration, *place) for place in error.places)) from error


def _located(path: Path, configuration: Configuration, location: tuple[str | int, ...], what: str) -> Problem:
    if location[0] == "product":
        return Problem(place_of(configuration.product, location[1:]), what)
    return Problem(place_of(path, location), what)


def load_product(configuration: Configuration, path: Path | str = DEFAULT_CONFIGURATION) -> Product:
    """Read the product that a configuration names and check that the bench serves it.

    Args:
        path: the configuration's file, for messages.

    Raises:
        InputError: with every problem of the product file, or of the bench that has no bin for a part type, or a place
            for something else.
    """
    product, bench = load_yaml(configuration.product, Product), configuration.bench
    missing = [part for part in product.assembled if part not in bench.bins_m]
    wrong: list[tuple[Location, str]] = [
        (("bench", "bins_m"), f"no bin for part type {part!r} of {product.name!r}") for part in missing
    ]
    wrong += [
        ((*at, "built_at"), f"{kind.built_at!r} must be a place of the bench that {what}")
        for name, kind in product.wholes.items()
        if (what := _cannot_build(bench, name, kind))
        for at in [("product", "parts", name)]
    ]
    for name, spots in bench.places.items():
        where, legal = ("bench", "places", name), ", ".join(product.parts)
        if name in product.positions:
            wrong.append((where, f"{name!r} is a position of {product.name!r}; give the place another name"))
        for key in ("holds", "filled"):
            unknown = sorted({*getattr(spots, key)} - {*product.parts, EMPTY})
            wrong += [((*where, key), f"no part type {part!r} in {product.name!r}; legal: {legal}") for part in unknown]
    if wrong:
        raise InputError(*(_located(Path(path), configuration, location, what) for location, what in wrong))
    return product


def _cannot_build(bench: Bench, name: str, kind: PartType) -> str:
    """What the place must have where a sub-assembly is built; empty where it has that."""
    place = bench.places.get(kind.built_at)
    if place is None:
        return f"is in bench.places; legal: {', '.join(bench.places) or 'none yet'}"
    if place.known_by != "seen":
        return f"the camera sees (known_by: seen), to tell when {name} is built"
    missing = [part for part in (kind.made_of[0], name) if not place.takes(part)]
    return f"holds {', '.join(missing)}, too" if missing else ""
