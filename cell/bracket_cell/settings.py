"""Settings of the cell's parts: the sections of config/cell.yaml that stand nowhere else."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from bracket_cell.kinds import DETECTORS, TRAINED_DEFAULTS, WEIGHTS, Files, KindSettings, files_of
from bracket_cell.learned.classical.settings import PerceptionSettings as ClassicalSettings
from bracket_cell.learned.semantic.settings import NewGoals
from bracket_cell.skills.drivers.settings import DdsSettings, Host
from bracket_ground.files.model import Model
from bracket_ground.files.units import Duration
from bracket_ground.files.words.catalogue import languages

Shown = Literal["ready", "running", "held", "question", "holding", "over", "watchdog"]
TOPIC_NAME = r"^[^+#/\x00]+$"  # an element of a topic: MQTT 3.1.1, 4.7


class ControllerSettings(Model):
    """The control loop.

    Attributes:
        tick_hz: how often the controller observes, ticks the tree, acts and records.
        max_duration_s: the run ends by itself after this time.
        stop_timeout_s: how long a controlled stop may take before the run ends anyway.
    """

    tick_hz: float = Field(default=25.0, ge=5, le=500)
    max_duration_s: Duration = 300.0
    stop_timeout_s: float = Field(default=2.0, gt=0, le=60)


class Perception(Model):
    """The detectors that read camera frames.

    Attributes:
        kind: all detectors at once: by rules about colours and outlines (classical), or trained (learned).
        hands: what finds the hand, if another kind than that: both, slim, mediapipe, classical, or your own (`cell docs
            drivers`), likewise below. With a real overhead camera both is the default, where MediaPipe was fetched.
        actions: what recognises the hand's action: classical, slim, paper.
        holes: what reads the holes: classical, plate, none (with `guard.holes: graph`).
        parts: what finds parts in the wrist camera's view: classical, centre, rcnn, or onnx: your YOLO or RT-DETR.
        folder: folder with the weights of trained detectors, as `cell train --all` fills it, relative to this file; the
            shipped ones by default.
        crops: network that tells the `paper` grasp planner what is around each part; beside that planner's weights
            where it is chosen.
        latency_s: in lock-step simulation, clock time from a frame to its answer; by default the p95 of the detectors'
            model cards, or 0.1 where one does not tell.
        classical: settings of that kind.
    """

    kind: Literal["classical", "learned"] = "learned"
    hands: KindSettings | None = None
    actions: KindSettings | None = None
    holes: KindSettings | None = None
    parts: KindSettings | None = None
    folder: Path | None = None
    crops: Path | None = None
    latency_s: float | None = Field(default=None, ge=0, le=2)
    classical: ClassicalSettings = ClassicalSettings()

    def chosen(self, detector: str) -> KindSettings:
        """The settings of a detector, by its key: its own ones, or what `kind` says."""
        own: KindSettings | None = getattr(self, detector)
        return own or KindSettings(kind=TRAINED_DEFAULTS[detector] if self.kind == "learned" else "classical")

    def with_detector(self, detector: str, kind: str, weights: Path | None = None) -> Perception:
        """The same with another detector; without weights, those that are configured for this kind."""
        own = self.chosen(detector)
        if own.kind != kind:
            own = KindSettings(kind=kind)
        return self.model_copy(update={detector: own.model_copy(update={"weights": weights or own.weights})})

    def weights(self, detector: str) -> Path:
        """The main file of weights of a detector that has such."""
        return next(iter(self.files(detector).values()))

    def files(self, detector: str) -> Files:
        """Every file that the answers of a detector depend on, by its name in logs; the main one first.

        Raises:
            SettingError: there is no such kind.
        """
        beside = {"parts.crops": self.crops} if detector == "parts" and self.crops is not None else {}
        return {**files_of(detector, self.chosen(detector), self.folder or WEIGHTS), **beside}

    @property
    def words(self) -> str:
        """For logs and summaries: `kind`, or each detector's where they are chosen one by one."""
        own = [f"{name} {settings.kind}" for name in DETECTORS if (settings := getattr(self, name)) is not None]
        return ", ".join((self.kind, *own))


class SemanticPlannerSettings(KindSettings):
    """The planner that infers the goal.

    Attributes:
        kind: factored, bayes or another; auto is factored where its weights are of this product, else bayes.
        weights: file of weights, relative to this file; the shipped one of this kind by default.
        goals: file of finished goals, relative to this file; goals that the product does not list are learned
            from it, and every finished bracket is noted in it. Without, only the product's goals are known.
        new_goals: expectation of goals that the product file does not list.
        confusions: file with the action detector's confusions, from `cell train --only noise`, relative to this
            file; by default what the model card of a trained detector tells. Without any, every action is taken for any
            other alike.
    """

    goals: Path | None = None
    new_goals: NewGoals = NewGoals()
    confusions: Path | None = None


class GraspPlannerSettings(KindSettings):
    """The planner of grasps."""


class Planners(Model):
    """The planners of section 3.1 (semantic) and 3.2 (grasp) of the paper.

    Attributes:
        semantic: which product is being built, and what remains to be done: factored, paper or bayes.
        grasp: which part to take out of the tray and how: pairwise, paper or rule.
    """

    semantic: SemanticPlannerSettings
    grasp: GraspPlannerSettings


class ProductionSettings(Model):
    """What the book of production needs for the overall equipment effectiveness (ISO 22400-2).

    Attributes:
        ideal_cycle_s: ideal cycle time of a bracket, by variant; without, effectiveness is not known.
        planned_day_s: planned busy time of a day on which something ran; without, the time of its runs.
    """

    ideal_cycle_s: dict[str, Duration] = {}  # noqa: RUF012 - pydantic copies it
    planned_day_s: Duration | None = None


class PageSettings(Model):
    """The operator's page, and what the panel says.

    Attributes:
        language: of the words at the bench: en, de, or another that has a catalogue.
        certificate: PEM file with the certificate by which the page is served over TLS, relative to this file; needed
            where the page is open to other machines over a network that others use.
        key: PEM file with its private key, relative to this file.
        begin: who operates the page of `cell serve` begins runs there; without, in simulation alone.
    """

    begin: bool | None = None
    language: str = "en"
    certificate: Path | None = None
    key: Path | None = None

    @model_validator(mode="after")
    def _complete(self) -> PageSettings:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together")
        if self.language not in languages():
            raise ValueError(f"no language {self.language!r}; there are: {', '.join(languages())}")
        return self


class MqttSettings(Model):
    """A broker to which the numbers of runs are published by Sparkplug B 3.0; needs the extra mqtt.

    Attributes:
        host: its name or address.
        port: TCP port; 8883 is usual with certificates.
        group: Sparkplug's group.
        node: Sparkplug's edge node, one for each cell.
        every_s: what changed is published so often.
        user: name at the broker.
        password_file: file with the password, relative to this file.
        certificates: PEM file with the authorities that the broker's certificate is checked by, relative to this file;
            without it nothing is encrypted.
    """

    host: Host
    port: int = Field(default=1883, ge=1, le=65535)
    group: str = Field(default="plant", pattern=TOPIC_NAME)
    node: str = Field(default="cell", pattern=TOPIC_NAME)
    every_s: float = Field(default=1.0, ge=0.1, le=60.0)
    user: str | None = None
    password_file: Path | None = None
    certificates: Path | None = None

    @model_validator(mode="after")
    def _complete(self) -> MqttSettings:
        if self.password_file is not None and self.user is None:
            raise ValueError("a password needs a user")
        return self

    def beside(self, folder: Path) -> MqttSettings:
        """With files relative to a folder."""
        files = {"password_file": self.password_file, "certificates": self.certificates}
        return self.model_copy(update={name: folder / file for name, file in files.items() if file is not None})


class BitSettings(Model):
    """What the cell says and is told by digital signals, by their names in `devices.signals`.

    Attributes:
        shows: output for each of these: ready (`cell serve` waits for a run), running (the arm may move), held,
            question (somebody must answer), holding (a part is between the fingers), over (the run has ended), watchdog
            (changes each second).
        orders: input for each of these, which orders when it becomes true: acknowledge, pause, resume, finish (end the
            shift after this bracket), stop.
        begin: input that begins a run of `cell serve` when it becomes true; empty for none.
        recipe: inputs that are a number together, the lowest digit first: 1 for the first goal of the product file; 0
            says nothing.
    """

    shows: dict[Shown, str] = Field(default_factory=dict)
    orders: dict[Literal["acknowledge", "pause", "resume", "finish", "stop"], str] = Field(default_factory=dict)
    begin: str = ""
    recipe: tuple[str, ...] = ()


class Ros2Settings(DdsSettings):
    """Topics of ROS 2 that others look at the cell by: joint states, transforms, diagnostics, markers, words.

    Attributes:
        namespace: before names that no convention has: /cell/hands, /cell/scene/bench, /cell/robot, /cell/guidance.
    """

    namespace: str = Field(default="cell", pattern=r"^[A-Za-z_]\w*$")


class OpcuaSettings(Model):
    """A server of OPC UA that `cell serve` keeps beside the page; needs the extra opcua.

    Attributes:
        at: PORT or HOST:PORT where it listens.
        trusted: folder with certificates (X.509) of clients that may order, relative to this file; a client is named
            as its file is. Others may only read.
    """

    at: str = "127.0.0.1:4840"
    trusted: Path | None = None

    def beside(self, folder: Path) -> OpcuaSettings:
        """With files relative to a folder."""
        return self if self.trusted is None else self.model_copy(update={"trusted": folder / self.trusted})


class PlantSettings(Model):
    """The plant that a cell stands in.

    Attributes:
        ros2: topics of ROS 2; none by default.
        mqtt: the broker that is told of runs; none by default.
        opcua: the server that plants read and order by; none by default.
        bits: digital signals to and from a PLC.
    """

    ros2: Ros2Settings | None = None
    mqtt: MqttSettings | None = None
    opcua: OpcuaSettings | None = None
    bits: BitSettings = BitSettings()

    def beside(self, folder: Path) -> PlantSettings:
        """With files relative to a folder."""
        files = {"mqtt": self.mqtt, "opcua": self.opcua}
        return self.model_copy(update={name: file and file.beside(folder) for name, file in files.items()})


class LogSettings(Model):
    """The log of each run.

    Attributes:
        folder: where logs are written without `--log`, relative to the working folder.
        camera_frames: write camera frames as JPEG.
        jpeg_quality: quality of those frames.
        joint_samples: write the joints at the rate of the arm's own control.
        rotate_mb: begin a new part of the log at this size; one file by default.
        rotate_s: begin a new part of the log after this time; one file by default.
        rotate_brackets: begin a new part of the log with every bracket of a shift.
        compress: make closed parts of a log smaller (zstd), in a process beside the run.
        keep_parts: keep only this many parts, the newest; all by default.
        keep_mb: keep only this much of finished parts, the newest; all by default.
        site, bench: names of this place and of this bench, for tables of runs of many.
    """

    buffer_mb: ClassVar[float] = 16.0  # that wait for a slow disk; images are dropped from half of it on, then ticks
    folder: Path = Path("runs")
    camera_frames: bool = True
    jpeg_quality: int = Field(default=80, ge=1, le=100)
    joint_samples: bool = True
    rotate_mb: float | None = Field(default=None, ge=0.001, le=1e6)
    rotate_s: float | None = Field(default=None, ge=0.1, le=86_400)
    rotate_brackets: bool = False
    compress: bool = True
    keep_parts: int | None = Field(default=None, ge=1)
    keep_mb: float | None = Field(default=None, gt=0, le=1e9)
    site: str = ""
    bench: str = ""

    @model_validator(mode="after")
    def _only_parts_are_removed(self) -> LogSettings:
        if (self.keep_parts or self.keep_mb) and not (self.rotate_mb or self.rotate_s or self.rotate_brackets):
            raise ValueError(
                "keep_parts and keep_mb need rotate_mb, rotate_s or rotate_brackets: a log in one file is kept whole"
            )
        return self
