"""Settings of the simulated cell: what a real bench would bring along by itself. Read without a simulator."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, model_validator

from bracket_ground.errors import SettingError
from bracket_ground.files.model import Disagreement, Model
from bracket_sim.scene.look_range import LookRange, NamedLook
from bracket_sim.scene.person import PERSONS, Person


class Hardware(Model):
    """What robot and cameras are like, beside what a camera's look says.

    Attributes:
        joint_noise_rad: standard deviation of a measured joint position.
        joint_speed_noise_rad_s: standard deviation of a measured joint speed.
        trailing_s: how far a joint is behind its set point, as time; at speed v the tracking error is v times this.
        command_latency_s: from a command to the arm's taking it up, in whole control periods.
        camera_latency_s: from the closing of the shutter to the frame in the controller's memory.
    """

    joint_noise_rad: float = Field(default=4e-5, ge=0, le=0.01)
    joint_speed_noise_rad_s: float = Field(default=1e-3, ge=0, le=0.01)
    trailing_s: float = Field(default=0.03, ge=0, le=0.1)
    command_latency_s: float = Field(default=0.008, ge=0, le=0.5)
    camera_latency_s: float = Field(default=0.05, ge=0, le=1)


HARDWARE = {
    "ideal": Hardware(
        joint_noise_rad=0, joint_speed_noise_rad_s=0, trailing_s=0, command_latency_s=0, camera_latency_s=0
    ),
    "ur10_usb": Hardware(),
}


def _named(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value not in HARDWARE:
        raise ValueError(f"no such hardware; legal: {', '.join(HARDWARE)}, or the values themselves")
    return HARDWARE[value]


NamedHardware = Annotated[Hardware, BeforeValidator(_named, json_schema_input_type=str | Hardware)]


class PhysicsSettings(Model):
    """Time steps of the simulation.

    Attributes:
        step_s: one physics step; a held part drifts by half a step of the arm's turning for each metre travelled.
        control_period_s: the arm's and the gripper's own cycle, a whole number of steps.
        sample_period_s: how often the arm measures its joints, a whole number of steps and a part of its cycle.
        sleep: what has come to rest is left out until it is touched; most of the physics is saved.
    """

    settle_s: ClassVar[float] = 0.3  # how long parts come to rest before the run begins
    step_s: float = Field(default=0.001, ge=0.0001, le=0.005)
    control_period_s: float = Field(default=0.008, ge=0.001, le=0.05)
    sample_period_s: float = Field(default=0.002, ge=0.0001, le=0.05)
    sleep: bool = True

    @model_validator(mode="after")
    def _periods_are_whole(self) -> PhysicsSettings:
        counts = self.sample_period_s / self.step_s, self.control_period_s / self.sample_period_s
        if any(abs(count - round(count)) > 1e-6 or round(count) < 1 for count in counts):
            raise ValueError(
                f"sample_period_s {self.sample_period_s:g} must be a whole number of steps of {self.step_s:g} s "
                f"and go into control_period_s {self.control_period_s:g} without a rest"
            )
        return self

    @property
    def steps_per_sample(self) -> int:
        return round(self.sample_period_s / self.step_s)

    @property
    def steps_per_period(self) -> int:
        return round(self.control_period_s / self.step_s)


class ClutterSettings(Model):
    """How parts stand and lie in the tray.

    Attributes:
        neighbour_share: probability that a part stands right beside another one.
        nearest_gap_m: least gap between the bodies of such neighbours.
        farthest_gap_m: largest gap between the bodies of such neighbours.
        lying_share: probability that a part lies on one of its other sides.
        stacked_share: probability that a part, the first one aside, is set down on one or two others and stays there.
        foreign_objects: how many objects of no type lie among the parts.
    """

    rim_margin_m: ClassVar[float] = 0.022  # least distance of a body from the tray's rim
    neighbour_share: float = Field(default=0.6, ge=0, le=1)
    nearest_gap_m: float = Field(default=0.004, gt=0, le=0.1)
    farthest_gap_m: float = Field(default=0.030, gt=0, le=0.2)
    lying_share: float = Field(default=0.0, ge=0, le=1)
    stacked_share: float = Field(default=0.0, ge=0, le=1)
    foreign_objects: int = Field(default=0, ge=0, le=5)

    @model_validator(mode="after")
    def _gaps_are_in_order(self) -> ClutterSettings:
        if self.nearest_gap_m > self.farthest_gap_m:
            what = f"nearest_gap_m {self.nearest_gap_m:g} is more than farthest_gap_m {self.farthest_gap_m:g}"
            raise Disagreement([(("nearest_gap_m",), what)])
        return self


class SimSignals(Model):
    """A simulated I/O module whose inputs follow its outputs.

    Attributes:
        channel, node_id: as the configuration's `signals` have them.
        wires: by bit of an input, the bit of the output that it follows.
        delay_s: how long after it.
    """

    channel: str = "signals"
    node_id: int = Field(default=32, ge=1, le=127)
    wires: dict[int, int] = Field(default_factory=dict)
    delay_s: float = Field(default=0.2, ge=0, le=60)


class SimSettings(Model):
    """The simulated cell.

    Attributes:
        overlap: frames and detectors in two processes beside the physics; the log is the same.
        physics: time steps.
        look: preset or file of looks, or a look file's content; each run's look is drawn from it by the seed.
        hardware: how well robot and cameras measure and obey: ideal, ur10_usb, or the values themselves.
        clutter: how parts stand in the tray.
        person: who stands at the bench.
        people: they take turns in a shift, a bracket each; the first one is `person`. None: always the same person.
        shift: the person goes on with the next bracket when one is finished.
        signals: an I/O module on the virtual bus; none by default.
    """

    overlap: bool = True
    physics: PhysicsSettings = PhysicsSettings()
    look: NamedLook = Field(default=LookRange(), json_schema_extra={"default": "nominal"})
    hardware: NamedHardware = Field(default=HARDWARE["ideal"], json_schema_extra={"default": "ideal"})
    clutter: ClutterSettings = ClutterSettings()
    person: Person = PERSONS["careful"]
    people: tuple[Person, ...] = ()
    shift: bool = False
    signals: SimSignals | None = None


def settings_of(simulation: Model) -> SimSettings:
    """The settings of a configuration as what they are.

    Raises:
        SettingError: they were read without this simulator.
    """
    if not isinstance(simulation, SimSettings):
        raise SettingError((("devices", "simulation"), "these are no settings of this simulator"))
    return simulation
