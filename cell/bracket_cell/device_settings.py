"""Settings of the devices, by role and kind; the simulator's are a file of their own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, SerializeAsAny, Tag, ValidationInfo

from bracket_cell.plugins import Chosen
from bracket_cell.simulator import NoSimulation, installed
from bracket_cell.skills.drivers.settings import (
    ArmKind,
    CameraKind,
    CanSettings,
    GripperKind,
    Ros2PanelSettings,
    SignalKind,
    SignalSettings,
    kinds_of,
)
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.devices import ROLES

KINDS: Mapping[str, tuple[str, ...]] = {
    "arm": ("simulated", *kinds_of(ArmKind)),
    "gripper": ("simulated", "none", *kinds_of(GripperKind)),
    "overhead": ("simulated", *kinds_of(CameraKind)),
    "wrist": ("simulated", *kinds_of(CameraKind)),
    "panel": ("simulated", "page", "none", "ros2"),
    "signals": kinds_of(SignalKind),
}  # of the project, by role
_OURS: list[Any] = sorted({kind for kinds in KINDS.values() for kind in kinds})


class SimulatedDevice(Model):
    """The simulator's device of this role.

    Attributes:
        kind: the simulator.
    """

    kind: Literal["simulated"] = "simulated"


class NoGripper(Model):
    """The arm has no gripper: its file says `nothing: true`.

    Attributes:
        kind: no gripper.
    """

    kind: Literal["none"] = "none"


class NoPanel(Model):
    """The person at the bench is shown nothing.

    Attributes:
        kind: no panel.
    """

    kind: Literal["none"] = "none"


class PagePanel(Model):
    """The operator's page is what the person at the bench sees, answers on and acknowledges by: as with `--page`.

    Attributes:
        kind: the page.
        at: port of this machine, or HOST:PORT that others can open.
    """

    kind: Literal["page"] = "page"
    at: str = "8780"


class OwnDevice(Chosen):
    """A device with a driver of your own; the driver's settings stand next to `kind`.

    Attributes:
        kind: MODULE:CLASS, a module in the folder of this file or in the working folder, or installed; or a name of
            the entry points `cell.devices`.
    """

    kind: str = Field(pattern=r"^[\w.-]+(:\w+)?$", json_schema_extra={"not": {"enum": _OURS}})

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of digital inputs, where it is a module with signals that has such a setting."""
        return tuple(self.settings.get("inputs", ()))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of digital outputs, likewise."""
        return tuple(self.settings.get("outputs", ()))


def _kind(role: str) -> Discriminator:
    """Tells the models of a role apart."""

    def named(value: Any) -> str:
        kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
        return kind if kind in KINDS[role] else "own"

    return Discriminator(named)


Simulated = Annotated[SimulatedDevice, Tag("simulated")]
Own = Annotated[OwnDevice, Tag("own")]
ArmDevice = Annotated[Simulated | ArmKind | Own, _kind("arm")]
CameraDevice = Annotated[Simulated | CameraKind | Own, _kind("overhead")]
GripperDevice = Annotated[Simulated | Annotated[NoGripper, Tag("none")] | GripperKind | Own, _kind("gripper")]
PanelDevice = Annotated[
    Simulated
    | Annotated[PagePanel, Tag("page")]
    | Annotated[NoPanel, Tag("none")]
    | Annotated[Ros2PanelSettings, Tag("ros2")]
    | Own,
    _kind("panel"),
]
SignalsDevice = Annotated[SignalKind | Own, _kind("signals")]


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
        raise ValueError(f"should be a file in {path.parent}")
    found = installed()
    return NoSimulation() if found is None else load_yaml(path, found.Settings)  # a run says that it is missing


def _simulation() -> Model:
    found = installed()
    return NoSimulation() if found is None else found.Settings()


SimulationFile = Annotated[SerializeAsAny[Model], BeforeValidator(_from_file, json_schema_input_type=Path)]


class DeviceSettings(Model):
    """Devices of the cell, by role: each has a kind, and next to it the settings of that kind (`cell docs drivers`).

    Attributes:
        arm: simulated, a driver of the project, or your own.
        gripper: likewise.
        overhead: the camera over the bench, likewise.
        wrist: the camera at the gripper, likewise.
        panel: what the person at the bench sees: simulated, page, none, ros2, or your own driver.
        signals: digital signals: of an I/O module (can), a PLC (modbus), an arm (ur), or your own; none by default.
        simulation: file with the simulator's settings, relative to this file; by default ideal hardware and a careful
            person.
    """

    moved: ClassVar[Mapping[str, str]] = {
        "factory": "each device has its own driver now: arm: {kind: MODULE:CLASS, ...}, ...; see `cell docs drivers`"
    }
    arm: ArmDevice = SimulatedDevice()
    gripper: GripperDevice = SimulatedDevice()
    overhead: CameraDevice = SimulatedDevice()
    wrist: CameraDevice = SimulatedDevice()
    panel: PanelDevice = SimulatedDevice()
    signals: SignalsDevice | None = None
    simulation: SimulationFile = Field(default_factory=_simulation, json_schema_extra={"default": None})

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

    def beside(self, folder: Path) -> DeviceSettings:
        """The same with the files that drivers of the project name relative to a folder."""
        changed = {}
        for role in ROLES:
            device = getattr(self, role)
            if device is not None and not isinstance(device, OwnDevice):
                paths = {name: folder / value for name, value in device if isinstance(value, Path)}
                changed[role] = device.model_copy(update=paths)
        return self.model_copy(update=changed)

    def on_channel(self, channel: str) -> DeviceSettings:
        """The same with the gripper on another bus, so that several cells may be in one process."""
        if not isinstance(self.gripper, CanSettings):
            return self
        return self.model_copy(update={"gripper": self.gripper.model_copy(update={"channel": channel})})
