"""Faults of the twin in states of the work: does each run end as config/faults.yaml says?

    python -m tests.benchmarks.twin_faults --faults rtde_cut gripper_power --states down carry --out rows.jsonl

`--wire ros2` drives arm and gripper by topics of ROS 2, and an overhead camera that is lost when its topic is silent.
The robot alone fetches a part and puts it into its hole, as in `cell lab eval faults`; arm and gripper are driven
through their wires, hands, holes and parts come from the truth. Somebody mends what is wrong after 1.5 s and
acknowledges after 3 s. Rows that are in the file already are not run again.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rich.console import Console
from rich.table import Table

from bracket_cell.commands.run import SEARCHES_GARBAGE
from bracket_cell.configuration import Configuration, load_configuration, load_faults, load_product
from bracket_cell.learned.calibration.check import CalibrationCheck
from bracket_cell.plant.ros_arm import Ros2Arm
from bracket_cell.plant.ros_camera import Ros2Camera
from bracket_cell.plant.ros_gripper import Ros2Gripper
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.skills.drivers.robotiq import ModbusGripper, UrcapGripper
from bracket_cell.skills.drivers.settings import (
    RobotiqModbusSettings,
    RobotiqUrcapSettings,
    Ros2ArmSettings,
    Ros2CameraSettings,
    Ros2GripperSettings,
    UrSettings,
)
from bracket_cell.skills.drivers.ur import UrArm
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.watching.observer import Outcome, TickRecord
from bracket_cell.watching.work_state import STATES
from bracket_cell.wiring.services import load_planners
from bracket_ground.errors import CellError
from bracket_ground.files.model import Model
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.devices import Camera, Devices, Gripper
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_ground.interfaces.product import Product
from bracket_lab.evaluations.faults import HOLDING_STATES, TRIAL, hangs
from bracket_sim.cell import SimCell
from bracket_sim.faults.injection import Injection, attended
from bracket_sim.faults.named_faults import RECOVERS, STOPS
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.scene.settings import settings_of
from bracket_sim.scene.world import World
from bracket_sim.twin.arm import TwinArm
from bracket_sim.twin.cell import TwinCell
from tests.sim.twin.rig import own_host

PERIOD_S, LONGEST_S, MENDED_S = 0.008, 90.0, 1.5


@dataclass(frozen=True)
class Case:
    """What goes wrong, and how the run may end then.

    Attributes:
        begins, mends: names of the twin's faults.
        holding_ends: as `ends`, where a part is between the fingers.
    """

    begins: tuple[str, ...]
    ends: tuple[str, ...]
    mends: tuple[str, ...] = ()
    holding_ends: tuple[str, ...] = ()


CASES = {
    "protective_stop": Case(("protective_stop",), RECOVERS),
    "safeguard": Case(("safeguard",), RECOVERS, ("safeguard_closed",)),
    "emergency_stop": Case(("emergency_stop",), RECOVERS, ("emergency_released",)),
    "local": Case(("local",), RECOVERS, ("remote",)),
    "moved_by_hand": Case(("paused", "moved_by_hand", "played"), RECOVERS),
    "slider": Case(("slider",), RECOVERS, ("slider_full",)),
    "fieldbus": Case(("fieldbus",), RECOVERS, ("fieldbus_gone",)),
    "rtde_late": Case(("rtde_late",), RECOVERS),
    "rtde_silent": Case(("rtde_silent",), RECOVERS),
    "rtde_cut": Case(("rtde_cut",), RECOVERS),
    "controller_restarted": Case(("controller_restarted",), RECOVERS),
    "payload_wrong": Case(("payload_wrong",), RECOVERS, ("payload_right",)),
    "turned": Case(("turned",), STOPS),
    "reduced": Case(("reduced",), RECOVERS, ("reduced_over",)),
    "gripper_answers_lost": Case(("gripper_answers_lost",), RECOVERS),
    "gripper_crc": Case(("gripper_crc",), RECOVERS),
    "gripper_replugged": Case(("gripper_replugged",), RECOVERS),
    "gripper_unpowered": Case(("gripper_power_off",), STOPS),
    "gripper_power": Case(("gripper_power_off", "gripper_power_on"), RECOVERS, holding_ends=STOPS),
}
ANY_WIRE = ("protective_stop", "safeguard", "emergency_stop", "slider", "controller_restarted", "payload_wrong")
ROS_CASES = {name: CASES[name] for name in ANY_WIRE} | {
    "joints_late": Case(("joints_late",), RECOVERS),
    "joints_silent": Case(("joints_silent",), RECOVERS),
    "joints_cut": Case(("joints_cut",), RECOVERS),  # its driver is started again
    "gripper_silent": Case(("gripper_silent",), RECOVERS, ("gripper_silent",)),
    "overhead_lost": Case(("overhead_lost",), RECOVERS, ("overhead_lost",)),
    "overhead_gone": Case(("overhead_lost",), STOPS),
}


@dataclass(frozen=True)
class Row:
    """How one run ended."""

    fault: str
    state: str
    reached: bool
    holding: bool
    end: str
    expected: tuple[str, ...]
    as_promised: bool
    reason: str
    condition: str
    time_s: float


class WireFault(Injection):
    """A fault of the twin in one state, and who mends it."""

    def __init__(self, case: Case, state: str, twin: TwinCell) -> None:
        super().__init__("", state)
        self.holding = False
        self._case, self._twin, self._mended = case, twin, False

    def devices(self, devices: Devices) -> Devices:
        """With somebody who acknowledges."""
        return attended(devices)

    def reached(self, time_s: float) -> None:
        """The state has come."""
        self.began_s = time_s
        for name in self._case.begins:
            self._twin.fault(name)

    def tick(self, record: TickRecord) -> None:
        """Mend it after a while."""
        if self.began_s is None:
            self.holding = record.observation.gripper.holding
        super().tick(record)
        if self.began_s is not None and not self._mended and record.observation.time_s > self.began_s + MENDED_S:
            self._mended = True
            for name in self._case.mends:
                self._twin.fault(name)


@dataclass(frozen=True)
class Locked:
    """Implements `Camera` and `DetectorHost` in front of those of a world that goes on by itself."""

    twin: TwinCell
    camera: Camera
    answer: Callable[[Frame], Callable[[], BenchView | PartsView]]

    def trigger(self) -> None:
        with self.twin.lock:
            self.camera.trigger()

    def latest(self) -> Frame | None:
        with self.twin.lock:
            return self.camera.latest()

    def await_ready(self) -> None:
        """It is."""

    def begin(self, frame: Frame) -> Callable[[], BenchView | PartsView]:
        return self.answer(frame)  # of what was kept when the frame was taken


@dataclass(frozen=True)
class Published(Locked):
    """A camera whose frames count only while images come by its topic."""

    images: Ros2Camera

    def latest(self) -> Frame | None:
        self.images.latest()
        return super().latest()


class WorldTime(WallClock):
    """The twin's time."""

    def __init__(self, twin: TwinCell) -> None:
        super().__init__(twin.slower)
        self._start_s -= (twin.now_s() + twin.period_s) * twin.slower


@contextmanager
def opened(wire: str, slower: float) -> Iterator[tuple[TwinCell, Callable[[WireFault], Outcome]]]:
    """The twin of a cell with nobody at it, and what runs the tree of trials through its wires."""
    configuration = load_configuration()
    controller = configuration.controller.model_copy(update={"max_duration_s": LONGEST_S})
    configuration = configuration.model_copy(update={"controller": controller})
    product, host = load_product(configuration), own_host(2)
    with ExitStack() as stack:
        # There are no images to judge, and who searches them for the plate holds up the twin, which is in this process.
        stack.enter_context(patch.object(CalibrationCheck, "judge", return_value=""))
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        settings = _settings(wire, host, Path(folder))
        arms: list[TwinArm] = []

        def made(world: World) -> TwinArm:
            arms.append(TwinArm(world))
            return arms[0]

        physics = settings_of(configuration.devices.simulation).physics.model_copy(
            update={"control_period_s": PERIOD_S}
        )
        simulation = settings_of(configuration.devices.simulation).model_copy(update={"physics": physics})
        goal = sorted(product.goals)[0]
        sim = SimCell(
            product, configuration.bench, simulation, "virtual", "twin", 0, goal, worker=False, rendered=False, arm=made
        )  # fmt: skip
        plain = {role: setting.model_dump() for role, setting in settings.items()}
        twin = TwinCell(sim, arms[0], plain, "ur10", PERIOD_S, slower)
        stack.callback(twin.close)
        twin.serve()
        clock = WorldTime(twin)
        arm = _arm(settings["arm"], clock, product, configuration)
        stack.callback(arm.close)
        gripper = _gripper(settings["gripper"], clock, configuration)
        stack.callback(gripper.close)
        beside = without_pixels(sim, configuration, product)
        assert beside.host is not None
        overhead, wrist = (Locked(twin, camera, beside.host.begin) for camera in (beside.overhead, beside.wrist))
        devices = replace(beside, clock=clock, arm=arm, gripper=gripper, host=overhead, overhead=overhead, wrist=wrist)
        if isinstance(camera := settings.get("overhead"), Ros2CameraSettings):
            images = Ros2Camera(camera, clock, configuration.bench, "overhead")
            stack.callback(images.close)
            overhead = Published(twin, overhead.camera, overhead.answer, images)
            devices = replace(devices, host=overhead, overhead=overhead)
        yield twin, lambda fault: _run(configuration, product, devices, fault)


def _settings(wire: str, host: str, folder: Path) -> dict[str, Model]:
    """Of the devices, by role."""
    if wire == "ros2":
        where: dict[str, Any] = {"domain": 1 + os.getpid() % 200}
        nodes = where | {"middleware": "cyclonedds"}
        camera = Ros2CameraSettings(**where, topic="/overhead/image_raw/compressed")
        return {"arm": Ros2ArmSettings(**nodes), "gripper": Ros2GripperSettings(**nodes), "overhead": camera}
    modbus = RobotiqModbusSettings(port=str(folder / "adapter"))
    return {"arm": UrSettings(host=host), "gripper": modbus if wire == "modbus" else RobotiqUrcapSettings(host=host)}


def _arm(settings: Model, clock: WallClock, product: Product, configuration: Configuration) -> Ros2Arm | UrArm:
    made = Ros2Arm if isinstance(settings, Ros2ArmSettings) else UrArm
    return made(settings, clock, product, configuration.robot)  # type: ignore[arg-type]


def _gripper(settings: Model, clock: WallClock, configuration: Configuration) -> Gripper:
    if isinstance(settings, Ros2GripperSettings):
        return Ros2Gripper(settings, clock, configuration.robot)
    if isinstance(settings, RobotiqModbusSettings):
        return ModbusGripper(settings, clock)
    assert isinstance(settings, RobotiqUrcapSettings)
    return UrcapGripper(settings, clock)


def _run(configuration: Configuration, product: Product, devices: Devices, fault: WireFault) -> Outcome:
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    tree = load_tree(TRIAL, node_registry(product))
    files = Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration))
    return run_controller(files, devices, motion, injection=fault)


def tried(name: str, state: str, wire: str, slower: float) -> Row:
    """One run with one fault."""
    case = (ROS_CASES if wire == "ros2" else CASES)[name]
    with opened(wire, slower) as (twin, run):
        fault = WireFault(case, state, twin)
        try:
            outcome = run(fault)
            told: tuple[str, str, str, float] = outcome.end, outcome.reason, outcome.condition, outcome.sim_time_s
        except CellError as error:
            told = "raised", str(error), "", 0.0
        with twin.lock:
            placed = any(
                placement.seated and placement.by == "robot" for placement in twin.sim.score.placements().values()
            )
            kept = told[0] == "finished" or not fault.holding or state not in HOLDING_STATES or hangs(twin.sim)
    ends = case.holding_ends if case.holding_ends and fault.holding else case.ends
    reached = fault.began_s is not None
    promised = reached and told[0] in ends and kept and (placed or told[0] != "finished")
    return Row(name, state, reached, fault.holding, told[0], ends, promised, told[1], told[2], round(told[3], 1))


def table(rows: Sequence[Row]) -> Table:
    """Faults by states: how each run ended, with a mark where that was not promised."""
    states = [state for state in STATES if any(row.state == state for row in rows)]
    right = sum(row.as_promised for row in rows)
    shown = Table("fault", *states, title=f"{right} of {len(rows)} ended as promised")
    found = {(row.fault, row.state): f"{'' if row.as_promised else '! '}{row.end}" for row in rows}
    for name in dict.fromkeys(row.fault for row in rows):
        shown.add_row(name, *(found.get((name, state), "") for state in states))
    return shown


def main() -> None:
    """Run what is asked for, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", nargs="*", choices=CASES | ROS_CASES)
    parser.add_argument("--states", nargs="*", choices=STATES, default=["above", "down", "grasp", "carry", "release"])
    parser.add_argument("--wire", choices=("modbus", "urcap", "ros2"), default="modbus")
    parser.add_argument("--slower", type=float, default=4.0)
    parser.add_argument("--out", type=Path, required=True, help="a line of JSON for each run")
    asked = parser.parse_args()
    rows = [Row(**json.loads(line)) for line in asked.out.read_text().splitlines()] if asked.out.exists() else []
    done = {(row.fault, row.state) for row in rows}
    gc.freeze()  # a search of garbage holds up the twin, which is in this process
    gc.set_threshold(SEARCHES_GARBAGE)
    for name in asked.faults or (ROS_CASES if asked.wire == "ros2" else CASES):
        for state in asked.states:
            if (name, state) not in done:
                rows.append(tried(name, state, asked.wire, asked.slower))
                with asked.out.open("a") as stream:
                    stream.write(json.dumps(asdict(rows[-1])) + "\n")
    Console().print(table(rows))


if __name__ == "__main__":
    main()
