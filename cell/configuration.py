"""The cell's configuration (config/cell.yaml): one model for the whole file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from cell.interfaces.bench import Bench, Calibration
from cell.interfaces.errors import InputError, Problem, SettingError
from cell.interfaces.files import shipped
from cell.interfaces.judgement import FaultTable
from cell.interfaces.model import Model
from cell.interfaces.planning import crops_file, weights_file
from cell.interfaces.product import Product
from cell.interfaces.quantity import Duration
from cell.interfaces.yaml_file import load_yaml, place_of
from learned.classical.settings import PerceptionSettings as ClassicalSettings
from learned.hands.mediapipe.files import ON_THE_BENCH, folder_in_use, model_folder, network_file
from learned.semantic.settings import NewGoals
from sim.look_range import look_range
from sim.person import load_person
from sim.settings import SimSettings
from skills.settings import CanSettings, MotionSettings, SignalSettings
from trees.guard import GuardSettings

DEFAULT_CONFIGURATION = shipped("config", "cell.yaml")
DEFAULT_FAULTS = shipped("config", "faults.yaml")
WEIGHTS = shipped("learned", "weights")
SHIFT_PART_S = 300.0  # the longest part of a shift's log, also where no bracket begins
SHIFT_LOG_MB = 4000.0  # parts of a shift's log that are kept where the configuration does not say how much
DEFAULT_TREE = shipped("trees", "ahead.xml")
LEARNED_KINDS = {"hands": "slim", "actions": "slim", "holes": "plate", "parts": "centre"}  # the trained defaults


class ControllerSettings(Model):
    """The control loop.

    Attributes:
        tick_hz: how often the controller observes, ticks the tree, acts and records.
        max_duration_s: the run ends by itself after this much clock time.
        stop_timeout_s: how long a controlled stop may take before the run ends all the same.
    """

    tick_hz: float = Field(default=25.0, ge=5, le=500)
    max_duration_s: Duration = 300.0
    stop_timeout_s: float = Field(default=2.0, gt=0, le=60)


class DetectorSettings(Model):
    """One of the detectors.

    Attributes:
        kind: which implementation answers; "classical" needs no weights.
        weights: file of weights, relative to this file; the shipped one of this kind by default.
    """

    kind: str
    weights: Path | None = None


class Perception(Model):
    """The detectors that read camera frames.

    Attributes:
        kind: all detectors at once: by rules about colours and outlines (classical), or trained (learned).
        hands: who finds the hand, where that is to be another kind: classical, slim, mediapipe.
        actions: who names what the hand does: classical, slim, paper.
        holes: who reads the holes: classical, plate.
        parts: who finds parts in the wrist camera's view: classical, centre.
        crops: network that tells the `paper` grasp planner what is around each part; beside that planner's weights
            where it is chosen.
        latency_s: in lock-step simulation, clock time from a frame to its answer; by default the p95 of the detectors'
            model cards, or 0.1 where one does not tell.
        classical: settings of that kind.
    """

    kind: Literal["classical", "learned"] = "learned"
    hands: DetectorSettings | None = None
    actions: DetectorSettings | None = None
    holes: DetectorSettings | None = None
    parts: DetectorSettings | None = None
    crops: Path | None = None
    latency_s: float | None = Field(default=None, ge=0, le=2)
    classical: ClassicalSettings = ClassicalSettings()

    def chosen(self, detector: str) -> DetectorSettings:
        """The settings of a detector, by its key: its own ones, or what `kind` says."""
        own: DetectorSettings | None = getattr(self, detector)
        return own or DetectorSettings(kind=LEARNED_KINDS[detector] if self.kind == "learned" else "classical")

    def weights(self, detector: str) -> Path:
        """The file of weights of a detector that is not classical."""
        settings = self.chosen(detector)
        if (detector, settings.kind) == ("hands", "mediapipe"):
            return settings.weights or network_file(model_folder(), "landmark", ON_THE_BENCH)
        return settings.weights or WEIGHTS / weights_file(detector, settings.kind)

    def networks(self, detector: str) -> dict[str, Path]:
        """Every file of weights that the answers of a detector hang on, by name; none for a classical one.

        The first is that of `weights`; others stand beside it.
        """
        kind = self.chosen(detector).kind
        beside = {"parts.crops": self.crops} if detector == "parts" and self.crops is not None else {}
        if kind == "classical":
            return beside
        main = self.weights(detector)
        if (detector, kind) == ("hands", "slim"):
            from learned.hands.slim import finder_file

            return {detector: main, f"{detector}.finder": finder_file(main)}
        if (detector, kind) == ("hands", "mediapipe"):
            folder = folder_in_use(main)
            landmark, palm = (network_file(folder, network, ON_THE_BENCH) for network in ("landmark", "palm"))
            return {detector: landmark, f"{detector}.palm": palm}
        if (detector, kind) == ("parts", "centre"):
            from learned.parts.detector import pose_file

            return {detector: main, f"{detector}.pose": pose_file(main), **beside}
        return {detector: main}

    @property
    def words(self) -> str:
        """For logs and summaries: `kind`, or each detector's where they are chosen one by one."""
        own = [f"{name} {settings.kind}" for name in LEARNED_KINDS if (settings := getattr(self, name)) is not None]
        return ", ".join((self.kind, *own))


class PlannerSettings(Model):
    """A planner.

    Attributes:
        kind: which implementation answers.
        weights: file of weights, relative to this file; the shipped one of this kind by default.
    """

    kind: str
    weights: Path | None = None


class SemanticPlannerSettings(PlannerSettings):
    """The planner that infers the goal.

    Attributes:
        kind: factored, paper, bayes or and_or; auto is factored where its weights are of this product, else bayes.
        weights: file of weights, relative to this file; the shipped one of this kind by default.
        goals: file of goals that were finished, relative to this file; goals that the product does not list are learned
            from it, and every finished bracket is noted in it. Without, only the product's goals are known.
        new_goals: what is expected of goals that nobody listed.
        confusions: file of what the action detector takes for what, from `cell train noise` or `cell eval actions`,
            relative to this file; by default what the model card of a trained detector tells. Without any, every
            action is taken for any other alike.
    """

    goals: Path | None = None
    new_goals: NewGoals = NewGoals()
    confusions: Path | None = None


class Planners(Model):
    """The planners of section 3.1 (semantic) and 3.2 (grasp) of the paper.

    Attributes:
        semantic: which product is being built, and what remains to be done: factored, paper, bayes or and_or.
        grasp: which part to take out of the tray and how: pairwise, paper or rule.
    """

    semantic: SemanticPlannerSettings
    grasp: PlannerSettings


class DeviceSettings(Model):
    """Devices of the cell.

    Attributes:
        factory: dotted path `module:function` of what opens them.
        simulation: settings of the simulated cell, for `sim.cell:open_cell`.
    """

    factory: str = Field(default="sim.cell:open_cell", pattern=r"^[\w.]+:\w+$")
    simulation: SimSettings = SimSettings()


class LogSettings(Model):
    """The log of each run.

    Attributes:
        folder: where logs go without `--log`, relative to the working folder.
        camera_frames: write camera frames as JPEG.
        jpeg_quality: quality of those frames.
        buffer_mb: what may wait for a slow or full disk; images are dropped from half of it on, ticks beyond it.
        joint_samples: write the joints at the rate of the arm's own control.
        rotate_mb: begin a new part of the log when it has so many bytes; one file by default.
        rotate_s: begin a new part of the log after so long; one file by default.
        rotate_brackets: begin a new part of the log with every bracket of a shift.
        compress: make closed parts of a log smaller (zstd), in a process beside the run.
        keep_parts: keep only so many parts, the newest; all by default.
        keep_mb: keep only so many bytes of finished parts, the newest; all by default.
    """

    folder: Path = Path("runs")
    camera_frames: bool = True
    jpeg_quality: int = Field(default=80, ge=1, le=100)
    buffer_mb: float = Field(default=16.0, gt=0, le=1024)
    joint_samples: bool = True
    rotate_mb: float | None = Field(default=None, ge=0.001, le=1e6)
    rotate_s: float | None = Field(default=None, ge=0.1, le=86_400)
    rotate_brackets: bool = False
    compress: bool = True
    keep_parts: int | None = Field(default=None, ge=1)
    keep_mb: float | None = Field(default=None, gt=0, le=1e9)

    @model_validator(mode="after")
    def _only_parts_are_removed(self) -> LogSettings:
        if (self.keep_parts or self.keep_mb) and not (self.rotate_mb or self.rotate_s or self.rotate_brackets):
            raise ValueError(
                "keep_parts and keep_mb need rotate_mb, rotate_s or rotate_brackets: a log in one file is kept whole"
            )
        return self


class Configuration(Model):
    """Everything that a run needs to know beside its tree.

    Attributes:
        product: the product file, relative to this file.
        calibration: file of `cell calibrate`, relative to this file: it takes over what the bench says of the cameras.
        bench: where arm, bracket, tray and cameras stand. World frame: origin at the arm's base on the table top, x
            towards the person, z up.
        signals: an I/O module with digital signals; none by default.
        faults: what the supervisor does about each sign of trouble, relative to this file; none for the shipped table.
    """

    product: Path
    faults: Path | None = None
    calibration: Path | None = None
    bench: Bench
    controller: ControllerSettings = ControllerSettings()
    perception: Perception = Perception()
    planners: Planners
    guard: GuardSettings = GuardSettings()
    motion: MotionSettings = MotionSettings()
    gripper_can: CanSettings = CanSettings()
    signals: SignalSettings | None = None
    devices: DeviceSettings = DeviceSettings()
    log: LogSettings = LogSettings()


def load_configuration(path: Path | str = DEFAULT_CONFIGURATION) -> Configuration:
    """Read a configuration; paths in it become absolute.

    Raises:
        InputError: with every problem of the file.
    """
    path = Path(path)
    read = load_yaml(path, Configuration)
    folder = path.parent.resolve()
    planners = {
        name: planner.model_copy(update={"weights": _weights(name, planner, folder)} | _beside(planner, folder))
        for name, planner in read.planners
    }
    detectors = {
        name: own.model_copy(update={"weights": folder / own.weights})
        for name in LEARNED_KINDS
        if (own := getattr(read.perception, name)) is not None and own.weights is not None
    }
    perception: dict[str, object] = {**detectors, "crops": _crops(read, planners["grasp"].weights, folder)}
    faults = DEFAULT_FAULTS if read.faults is None else folder / read.faults
    log = read.log.model_copy(update={"folder": Path.cwd() / read.log.folder})
    database = read.gripper_can.database
    gripper = read.gripper_can.model_copy(update={"database": database and folder / database})
    calibration = read.calibration and folder / read.calibration
    bench = read.bench if calibration is None else read.bench.calibrated(load_yaml(calibration, Calibration))
    return read.model_copy(
        update={
            "product": folder / read.product,
            "calibration": calibration,
            "bench": bench,
            "faults": faults,
            "perception": read.perception.model_copy(update=perception),
            "planners": read.planners.model_copy(update=planners),
            "gripper_can": gripper,
            "log": log,
        }
    )


def simulated(configuration: Configuration, look: str | None = None, person: str | None = None) -> Configuration:
    """The same cell with another look or person in its simulation; None leaves the configured one.

    Args:
        look: a preset, one section of it as in "hard:light", or a look file.
        person: a person's name or file; several with commas between take turns in a shift, a bracket each.

    Raises:
        InputError: there is no such look or person, or the file is wrong.
    """
    changes: dict[str, object] = {}
    if look is not None:
        changes["look"] = look_range(look)
    if person is not None:
        people = tuple(load_person(one.strip()) for one in person.split(","))
        changes |= {"person": people[0], "people": people if len(people) > 1 else ()}
    simulation = configuration.devices.simulation.model_copy(update=changes)
    devices = configuration.devices.model_copy(update={"simulation": simulation})
    return configuration.model_copy(update={"devices": devices})


def detected_by(configuration: Configuration, kind: str | None) -> Configuration:
    """The same cell with all detectors of one kind, classical or learned; None leaves the configured ones."""
    if kind is None:
        return configuration
    chosen = {"kind": kind, **dict.fromkeys(LEARNED_KINDS)}
    return configuration.model_copy(update={"perception": configuration.perception.model_copy(update=chosen)})


def for_shift(configuration: Configuration, brackets: int) -> Configuration:
    """The same cell for many brackets in a row: more time, a part of the log for each, and a person who goes on.

    Args:
        brackets: how many; 0 for until the run is stopped.
    """
    simulation = configuration.devices.simulation.model_copy(update={"shift": True})
    longest_s = configuration.controller.max_duration_s * brackets if brackets else math.inf
    log = configuration.log
    if log.rotate_mb is None and log.rotate_s is None:
        log = log.model_copy(update={"rotate_brackets": True, "rotate_s": SHIFT_PART_S})
    if log.keep_mb is None and log.keep_parts is None:
        log = log.model_copy(update={"keep_mb": SHIFT_LOG_MB})
    return configuration.model_copy(
        update={
            "devices": configuration.devices.model_copy(update={"simulation": simulation}),
            "controller": configuration.controller.model_copy(update={"max_duration_s": longest_s}),
            "log": log,
        }
    )


def _beside(planner: PlannerSettings, folder: Path) -> dict[str, Path]:
    """Files of a semantic planner that stand beside the configuration."""
    if not isinstance(planner, SemanticPlannerSettings):
        return {}
    files = {"goals": planner.goals, "confusions": planner.confusions}
    return {name: folder / file for name, file in files.items() if file is not None}


def _crops(read: Configuration, grasp: Path, folder: Path) -> Path | None:
    """The network that the grasp planner wants beside the part detector."""
    if read.perception.crops is not None:
        return folder / read.perception.crops
    return crops_file(grasp) if read.planners.grasp.kind == "paper" else None


def _weights(name: str, planner: PlannerSettings, folder: Path) -> Path:
    return WEIGHTS / weights_file(name, planner.kind) if planner.weights is None else folder / planner.weights


def load_faults(configuration: Configuration) -> FaultTable:
    """Read the table of faults that a configuration names.

    Raises:
        InputError: with every problem of the file.
    """
    return load_yaml(configuration.faults or DEFAULT_FAULTS, FaultTable)


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


def _located(path: Path, configuration: Configuration, location: tuple[str, ...], what: str) -> Problem:
    if location[0] == "product":
        return Problem(place_of(configuration.product, location[1:]), what)
    return Problem(place_of(path, location), what)


def load_product(configuration: Configuration, path: Path | str = DEFAULT_CONFIGURATION) -> Product:
    """Read the product that a configuration names and check that the bench serves it.

    Args:
        path: the configuration's file, for messages.

    Raises:
        InputError: with every problem of the product file, or of the bench that has no bin for a part type.
    """
    product = load_yaml(configuration.product, Product)
    bins = configuration.bench.bins_m
    missing = [part for part in product.parts if part not in bins]
    if missing:
        place = place_of(Path(path), ("bench", "bins_m"))
        raise InputError(*(Problem(place, f"no bin for part type {part!r} of {product.name!r}") for part in missing))
    return product
