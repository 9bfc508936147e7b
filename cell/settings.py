"""Settings of the cell's parts: the sections of config/cell.yaml that stand nowhere else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    ValidationInfo,
    model_validator,
)

from cell.files.files import shipped
from cell.files.model import Model
from cell.files.units import Duration
from cell.files.yaml_file import load_yaml
from cell.interfaces.devices import ROLES
from cell.interfaces.planning import weights_file
from learned.classical.settings import PerceptionSettings as ClassicalSettings
from learned.hands.mediapipe.hands import ON_THE_BENCH, folder_in_use, model_folder, network_file
from learned.semantic.settings import NewGoals
from sim.scene.settings import SimSettings
from skills.drivers.settings import CanSettings, SignalSettings

WEIGHTS = shipped("learned", "weights")
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
        folder: folder with the weights of trained detectors, as `cell train --all` fills it, relative to this file; the
            shipped ones by default.
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
    folder: Path | None = None
    crops: Path | None = None
    latency_s: float | None = Field(default=None, ge=0, le=2)
    classical: ClassicalSettings = ClassicalSettings()

    def chosen(self, detector: str) -> DetectorSettings:
        """The settings of a detector, by its key: its own ones, or what `kind` says."""
        own: DetectorSettings | None = getattr(self, detector)
        return own or DetectorSettings(kind=LEARNED_KINDS[detector] if self.kind == "learned" else "classical")

    def with_detector(self, detector: str, kind: str, weights: Path | None = None) -> Perception:
        """The same with another detector; without weights, those that are configured for this kind."""
        own = self.chosen(detector)
        file = weights or (own.weights if own.kind == kind else None)
        return self.model_copy(update={detector: DetectorSettings(kind=kind, weights=file)})

    def weights(self, detector: str) -> Path:
        """The file of weights of a detector that is not classical."""
        settings = self.chosen(detector)
        if (detector, settings.kind) == ("hands", "mediapipe"):
            return settings.weights or network_file(model_folder(), "landmark", ON_THE_BENCH)
        return settings.weights or (self.folder or WEIGHTS) / weights_file(detector, settings.kind)

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
            from learned.hands.model import finder_file, refiner_file

            return {detector: main, f"{detector}.finder": finder_file(main), f"{detector}.refiner": refiner_file(main)}
        if (detector, kind) == ("hands", "mediapipe"):
            folder = folder_in_use(main)
            landmark, palm = (network_file(folder, network, ON_THE_BENCH) for network in ("landmark", "palm"))
            return {detector: landmark, f"{detector}.palm": palm}
        if (detector, kind) == ("parts", "centre"):
            from learned.parts.model import pose_file

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
        confusions: file of what the action detector takes for what, from `cell train --only noise`, relative to this
            file; by default what the model card of a trained detector tells. Without any, every action is taken for any
            other alike.
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


class SimulatedDevice(Model):
    """The simulator's device of this role.

    Attributes:
        kind: the simulator.
    """

    kind: Literal["simulated"] = "simulated"


class NoPanel(Model):
    """Nobody is shown anything at the bench.

    Attributes:
        kind: no panel.
    """

    kind: Literal["none"] = "none"


class OwnDevice(Model):
    """A device whose driver is not ours; that driver's own settings stand next to `kind`.

    Attributes:
        kind: MODULE:CLASS, a module in the folder of this file or in the working folder, or installed; or a name of
            the entry points `cell.devices`.
    """

    model_config = ConfigDict(extra="allow")
    kind: str = Field(pattern=r"^[\w.-]+(:\w+)?$", json_schema_extra={"not": {"enum": ["simulated", "can", "none"]}})
    _folder: Path = PrivateAttr(Path())

    def model_post_init(self, context: Any) -> None:
        """Keep where the file stands."""
        self._folder = Path((context or {}).get("folder", ".")).resolve()

    @property
    def folder(self) -> Path:
        """Where the file stands that names the driver."""
        return self._folder

    @property
    def settings(self) -> dict[str, Any]:
        """What stands next to `kind`, as it was read."""
        return dict(self.model_extra or {})

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of digital inputs, where it is a module with signals that has such a setting."""
        return tuple(self.settings.get("inputs", ()))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of digital outputs, likewise."""
        return tuple(self.settings.get("outputs", ()))


def _kind(*known: str) -> Discriminator:
    """Tells the models of a role apart."""

    def named(value: Any) -> str:
        kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
        return kind if kind in known else "own"

    return Discriminator(named)


Simulated = Annotated[SimulatedDevice, Tag("simulated")]
Own = Annotated[OwnDevice, Tag("own")]
AnyDevice = Annotated[Simulated | Own, _kind("simulated")]
GripperDevice = Annotated[Simulated | Annotated[CanSettings, Tag("can")] | Own, _kind("simulated", "can")]
PanelDevice = Annotated[Simulated | Annotated[NoPanel, Tag("none")] | Own, _kind("simulated", "none")]
SignalsDevice = Annotated[Annotated[SignalSettings, Tag("can")] | Own, _kind("can")]


def _from_file(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, Mapping):
        raise ValueError(
            "the simulator's settings are a file of their own: move these keys to sim.yaml next to this file, "
            "and write simulation: sim.yaml"
        )
    if not isinstance(value, str):
        return value
    path = Path((info.context or {}).get("folder", ".")) / value
    if not path.is_file():
        raise ValueError("there is no such file")
    return load_yaml(path, SimSettings)


SimulationFile = Annotated[SimSettings, BeforeValidator(_from_file, json_schema_input_type=Path)]


class DeviceSettings(Model):
    """Devices of the cell, by role: each has a kind, and next to it the settings of that kind (docs/drivers.md).

    Attributes:
        arm: simulated, or a driver of one's own.
        gripper: simulated, can, or a driver of one's own.
        overhead: the camera over the bench: simulated, or a driver of one's own.
        wrist: the camera at the gripper: simulated, or a driver of one's own.
        panel: what the person at the bench sees: simulated, none, or a driver of one's own.
        signals: an I/O module with digital signals: can, or a driver of one's own; none by default.
        simulation: file with the simulator's settings, relative to this file; by default ideal hardware and a careful
            person.
    """

    moved: ClassVar[Mapping[str, str]] = {
        "factory": "each device has its own driver now: arm: {kind: MODULE:CLASS, ...}, gripper: ... (docs/drivers.md)"
    }
    arm: AnyDevice = SimulatedDevice()
    gripper: GripperDevice = SimulatedDevice()
    overhead: AnyDevice = SimulatedDevice()
    wrist: AnyDevice = SimulatedDevice()
    panel: PanelDevice = SimulatedDevice()
    signals: SignalsDevice | None = None
    simulation: SimulationFile = Field(default=SimSettings(), json_schema_extra={"default": None})

    @property
    def simulated(self) -> tuple[str, ...]:
        """Roles that are the simulator's; it is opened where there is one."""
        return tuple(role for role in ROLES if isinstance(getattr(self, role), SimulatedDevice))

    @property
    def gripper_bus(self) -> tuple[str, str]:
        """Interface and channel on which a simulated gripper listens."""
        gripper = self.gripper if isinstance(self.gripper, CanSettings) else CanSettings()
        return gripper.interface, gripper.channel

    @property
    def virtual_channels(self) -> tuple[str, ...]:
        """CAN buses that exist within a process alone."""
        ends = [self.gripper_bus]
        if isinstance(self.signals, SignalSettings):
            ends.append((self.signals.interface, self.signals.channel))
        return tuple(dict.fromkeys(channel for interface, channel in ends if interface == "virtual"))

    def on_channel(self, channel: str) -> DeviceSettings:
        """The same with the gripper on another bus, so that several cells may be in one process."""
        if not isinstance(self.gripper, CanSettings):
            return self
        return self.model_copy(update={"gripper": self.gripper.model_copy(update={"channel": channel})})


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
