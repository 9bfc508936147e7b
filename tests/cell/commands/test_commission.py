"""What a person does at a new cell: a folder, taught places, one motion, a drawing, the job above the bench."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_faults, load_product, weaknesses
from bracket_cell.runs.bench_view import BenchView
from bracket_cell.runs.commissioning import Teaching, fitted
from bracket_cell.runs.slow_motion import move_to
from bracket_cell.runs.stopping import measured
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.motion.settings import Stopping
from bracket_cell.wiring.devices import find_drivers, opened_alone
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import ArmMode, ArmState
from bracket_ground.interfaces.pose import Array, Pose
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.controller import UrWires
from bracket_sim.twin.gripper import ModbusTwin, Registers
from tests.cell.conftest import changed_configuration
from tests.sim.twin.rig import corrected, own_host, ur_wires

HOST = own_host(74)
CONFIGURATION = load_configuration()
PRODUCT, BENCH = load_product(CONFIGURATION), CONFIGURATION.bench


@pytest.fixture(scope="module")
def motion() -> MotionPlanner:
    return MotionPlanner(PRODUCT, BENCH, CONFIGURATION.motion)


def test_a_new_cell_is_a_commented_configuration_that_can_be_read(tmp_path: Path) -> None:
    folder = tmp_path / "ours"
    assert main(["new", "cell", str(folder), "--arm", "ur10e", "--gripper", "robotiq_modbus"]) == 0
    path = folder / "config" / "cell.yaml"
    configuration = load_configuration(path)
    assert configuration.robot.name == "ur10e"
    assert configuration.devices.simulated == ()
    assert set(find_drivers(configuration)) == {"arm", "gripper", "overhead", "wrist", "panel"}
    assert "# ls /dev/serial/by-id" in path.read_text()
    assert main(["new", "cell", str(folder), "--arm", "ur10e", "--gripper", "robotiq_modbus"]) == 2


@pytest.mark.parametrize(("cameras", "focals_px"), [("realsense", (613.0, 613.0)), ("v4l2", (706.7, 560.0))])
def test_cameras_of_a_new_cell_have_a_size_that_they_can_send(
    tmp_path: Path, cameras: str, focals_px: tuple[float, float]
) -> None:
    words = ["new", "cell", str(tmp_path), "--arm", "ur10", "--gripper", "can", "--cameras", cameras]
    assert main(words) == 0
    bench = load_configuration(tmp_path / "config" / "cell.yaml").bench
    setups = bench.overhead, bench.wrist
    assert {(setup.width_px, setup.height_px) for setup in setups} == {(640, 480)}
    assert tuple(setup.focal_px for setup in setups) == focals_px


def test_what_a_new_cell_cannot_have_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = {"--arm": "ur10", "--gripper": "can"}
    for option, value in (("--arm", "ur9"), ("--gripper", "glue"), ("--cameras", "eye")):
        words = [word for pair in {**given, option: value}.items() for word in pair]
        assert main(["new", "cell", str(tmp_path / "ours"), *words]) == 2
        assert f"{option} {value}: unknown; legal: " in capsys.readouterr().err


def pressed(monkeypatch: pytest.MonkeyPatch, times: int = 10) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n" * times))


@pytest.fixture
def real(tmp_path: Path) -> Path:
    """A configuration whose arm and gripper a twin has the wires of."""
    path = changed_configuration(tmp_path, "", "")
    text = path.read_text()
    begin, end = text.index("devices:"), text.index("log:")
    devices = {
        "arm": {"kind": "ur", "host": HOST},
        "gripper": {"kind": "robotiq_modbus", "port": str(tmp_path / "adapter"), "open_count": 0, "closed_count": 230},
        **{camera: {"kind": "stream", "url": "http://127.0.0.1:1/"} for camera in ("overhead", "wrist")},
        "panel": {"kind": "none"},
    }
    path.write_text(text[:begin] + yaml.safe_dump({"devices": devices}, sort_keys=False) + text[end:])
    return path


@pytest.fixture(scope="module")
def wires() -> Iterator[UrWires]:
    with ur_wires(HOST) as served:
        yield served


@pytest.fixture
def twin(wires: UrWires) -> TwinCell:
    return wires.controller.cell


def test_a_pose_that_the_arm_was_led_to_is_stored_beside_the_comments(
    twin: TwinCell, real: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressed(monkeypatch)
    before = real.read_text()
    assert main(["setup", "teach", "park", "--config", str(real)]) == 0
    after = real.read_text()
    with twin.lock:
        joints = twin.arm.measured.positions_rad
    off = np.array(load_configuration(real).bench.arm_park_rad) - joints
    assert off == pytest.approx(2 * np.pi * np.round(off / (2 * np.pi)), abs=1e-3)
    changed = [line for line in after.splitlines() if line not in before.splitlines()]
    assert len(changed) == 1
    assert changed[0].endswith("# tool down at (0.45, -0.50, 0.35), over the tray's far end, away from the person")


def test_the_gripper_s_ends_are_measured_and_stored(
    twin: TwinCell, real: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressed(monkeypatch)
    wires = ModbusTwin(
        Registers(twin.sim.gripper_node, twin.lock, twin.sim.gripper_node.gripper.stroke_m), real.parent / "adapter"
    )
    assert main(["setup", "teach", "gripper", "--config", str(real)]) == 0
    wires.close()
    gripper = load_configuration(real).devices.gripper
    assert (getattr(gripper, "open_count", 0), getattr(gripper, "closed_count", 0)) == (3, 228)


def test_the_arm_s_own_calibration_is_read_and_used(
    wires: UrWires, real: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as another:
        another.setattr(wires.controller, "model", corrected(wires.controller.model, 7))
        assert main(["setup", "teach", "robot", "--config", str(real)]) == 0
        assert "mm elsewhere in the pose look" in capsys.readouterr().err
        robot = load_configuration(real).robot
        assert robot.name == "ur10"
        assert robot.calibration is not None
        assert main(["setup", "teach", "robot", "--config", str(real)]) == 0
        assert load_configuration(real).robot == robot
    assert main(["setup", "teach", "robot", "--config", str(real)]) == 0
    told = load_configuration(real).robot.calibration
    assert told is not None
    assert told.a_m == (0, -0.612, -0.5723, 0, 0, 0)


def test_nothing_is_stored_unless_somebody_presses_enter(
    twin: TwinCell, real: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pressed(monkeypatch, times=0)
    before = real.read_text()
    assert main(["setup", "teach", "bracket", "--config", str(real)]) == 2
    assert "nobody pressed Enter" in capsys.readouterr().err
    assert real.read_text() == before
    assert twin.lost_s >= 0


def test_what_cannot_be_taught_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["setup", "teach", "o9"]) == 2
    assert "legal: park, look, bracket, tray, o1, o2, o3, gripper" in capsys.readouterr().err
    assert main(["setup", "teach", "gripper"]) == 2


def joints_at(motion: MotionPlanner, place_m: Array) -> Array:
    """Joints with which the fingertips touch a place from above."""
    beyond = motion.settings.robot.gripper.fingertip_beyond_tcp_m
    x, y, z = (float(value) for value in place_m)
    tool = Pose((x, y, z + beyond), (0.0, 1.0, 0.0, 0.0))
    joints = motion.kinematics.inverse(tool)
    assert joints is not None
    return joints


def touched(motion: MotionPlanner, name: str, places_m: Array) -> tuple[dict[tuple[str | int, ...], object], str]:
    teaching = Teaching(name, BENCH, PRODUCT, motion)
    assert len(teaching.prompts) == len(places_m)
    return teaching.values([joints_at(motion, place) for place in places_m])


def corners(moved: Pose) -> Array:
    holes = np.array(list(PRODUCT.bracket.holes_m.values()))
    low, high = holes.min(axis=0) - PRODUCT.bracket.margin_m, holes.max(axis=0) + PRODUCT.bracket.margin_m
    plate = np.array([[low[0], low[1], 0.0], [high[0], low[1], 0.0], [low[0], high[1], 0.0]])
    return moved.transform(plate)


def test_three_corners_tell_where_the_bracket_lies(motion: MotionPlanner) -> None:
    moved = Pose.from_yaw((0.70, 0.10, 0.040), 0.2)
    values, _ = touched(motion, "bracket", corners(moved))
    told = values["bench", "bracket"]
    assert isinstance(told, dict)
    assert told["position_m"] == pytest.approx([0.70, 0.10, 0.040], abs=1e-3)
    assert Pose(tuple(told["position_m"]), tuple(told["quaternion_wxyz"])).yaw_rad == pytest.approx(0.2, abs=5e-3)
    wrong = corners(moved)
    wrong[1, 0] += 0.02
    with pytest.raises(InputError, match="touch them again"):
        touched(motion, "bracket", wrong)


def test_four_corners_tell_where_the_tray_stands(motion: MotionPlanner) -> None:
    sides = np.array([(1, -1, 0), (1, 1, 0), (-1, -1, 0), (-1, 1, 0)])  # left is -y, far from the arm is +x
    places = np.array([0.55, -0.36, 0.01]) + sides * (0.15, 0.18, 0.0)
    values, _ = touched(motion, "tray", places)
    assert values["bench", "tray", "centre_m"] == pytest.approx([0.55, -0.36, 0.01], abs=1e-3)
    assert values["bench", "tray", "size_m"] == pytest.approx([0.30, 0.36], abs=1e-3)
    places[:, 1] += np.array([0.0, 0.0, 0.03, 0.03])
    with pytest.raises(InputError, match="degrees askew"):
        touched(motion, "tray", places)


def test_a_bin_is_touched_once_and_a_pose_takes_the_nearest_turn(motion: MotionPlanner) -> None:
    values, _ = touched(motion, "o1", np.array([[0.9, 0.3, 0.004]]))
    assert values["bench", "bins_m", "o1"] == pytest.approx([0.9, 0.3, 0.004], abs=1e-3)
    away = np.array(BENCH.arm_look_rad) - np.array([0, 0, 0, 0, 0, 2 * np.pi])
    stored, told = Teaching("look", BENCH, PRODUCT, motion).values([away])
    assert np.abs(np.array(stored["bench", "arm_look_rad"]) - np.array(BENCH.arm_park_rad)).max() <= np.pi + 0.4
    assert told


def test_a_fit_is_exact_where_points_are() -> None:
    wanted = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.3, 0.0]])
    pose = Pose.from_yaw((1.0, 2.0, 3.0), 1.1)
    found, off_m = fitted(wanted, pose.transform(wanted))
    assert off_m < 1e-12
    assert np.allclose(found.matrix, pose.matrix)


def test_a_tray_that_is_cut_off_is_told_and_drawn(
    motion: MotionPlanner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "bench.svg"
    assert main(["setup", "bench", "--out", str(out)]) == 0
    assert out.read_text().startswith("<svg")
    capsys.readouterr()
    tray = BENCH.tray.model_copy(update={"centre_m": (0.56, -0.60, 0.004)})
    bench = BENCH.model_copy(update={"tray": tray})
    view = BenchView(bench, PRODUCT, MotionPlanner(PRODUCT, bench, CONFIGURATION.motion))
    assert "left side" in view.problems[0]
    assert "of the tray is cut off" in view.problems[0]
    far = BENCH.model_copy(update={"bins_m": {**BENCH.bins_m, "o1": (1.9, 0.3, 0.0)}})
    assert "does not see bin o1" in BenchView(far, PRODUCT, motion).problems[0]


@pytest.mark.usefixtures("twin")
def test_a_pose_is_taught_where_none_is_found(
    real: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pressed(monkeypatch)
    lines = [line for line in real.read_text().splitlines(keepends=True) if "arm_park_rad" not in line]
    real.write_text("".join(lines).replace("[0.56, -0.38, 0.004]", "[0.56, -1.8, 0.004]"))
    with pytest.raises(InputError, match="arm_park_rad: the arm is free in no posture beside the tray"):
        load_configuration(real)
    assert main(["setup", "bench", "--config", str(real), "--out", str(real.parent / "bench.svg")]) == 1
    assert "arm_park_rad: the arm is free in no posture" in capsys.readouterr().err
    assert main(["setup", "teach", "park", "--config", str(real)]) == 0
    assert load_configuration(real).bench.arm_park_rad


@pytest.mark.long
def test_one_motion_after_enter(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pressed(monkeypatch)
    assert main(["setup", "move", "look", "--share", "1"]) == 0
    said = "".join(capsys.readouterr().err.split())
    assert "thenpressEnter" in said
    assert "thearmstandsatlook" in said
    assert main(["setup", "move", "there"]) == 2


class StoppingArm:
    """Stops by itself on its way."""

    def __init__(self, joints: Array) -> None:
        self._joints, self._followed = tuple(joints.tolist()), False

    def state(self) -> ArmState:
        mode: ArmMode = "protective_stop" if self._followed else "normal"
        return ArmState(0.0, self._joints, (0.0,) * 6, False, mode)

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        self._followed = True
        return trajectory

    def nothing(self, *_: object) -> None:
        pass

    stop = pace = acknowledge = samples = nothing


def test_an_arm_that_stopped_on_its_way_has_not_arrived(motion: MotionPlanner) -> None:
    devices: Any = SimpleNamespace(arm=StoppingArm(np.array(BENCH.arm_park_rad)), clock=ManualClock())
    with pytest.raises(DeviceFault, match="protective_stop"):
        move_to(devices, motion, np.array(BENCH.arm_look_rad))


@pytest.mark.slow
def test_a_dry_run_goes_above_parts_and_holes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pressed(monkeypatch)
    monkeypatch.setattr("bracket_cell.runs.commissioning.DRY_SHARE", 1.0)
    assert main(["setup", "move", "job"]) == 0
    said = capsys.readouterr().err
    for hole in PRODUCT.bracket.holes_m:
        assert f"above hole {hole}" in said
    assert "above part o" in said


def test_how_a_simulated_arm_stops_is_measured_and_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pressed(monkeypatch)
    path = changed_configuration(tmp_path, "", "")
    assert main(["setup", "teach", "stop", "--config", str(path)]) == 0, capsys.readouterr().err
    taught = load_configuration(path)
    found, separation = taught.motion.stopping, taught.motion.separation
    speeds = np.array(found.over_rad) / np.array(found.stops_s)
    assert len(found.reacts_s) == 6
    assert (np.array(found.stops_s) > np.array(found.reacts_s)).all()
    assert (speeds > 0.1).all()
    assert separation.reaction_s == pytest.approx(
        max(CONFIGURATION.motion.separation.reaction_s, 0.04 + max(found.reacts_s))
    )
    assert "wrist_3: reacts in" in capsys.readouterr().err


def test_how_the_arm_behind_wires_stops_is_measured(twin: TwinCell, real: Path) -> None:
    configuration = load_configuration(real)
    with opened_alone(configuration, PRODUCT, "arm") as (arm, clock):
        devices: Any = SimpleNamespace(arm=arm, clock=clock)
        planner = MotionPlanner(PRODUCT, configuration.bench, configuration.motion)
        found = measured(devices, planner, print)
    assert twin.lost_s >= 0
    assert len(found.brakes_rad_s2) == 6
    assert 0 < max(found.reacts_s) < 0.5


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"brakes_rad_s2": (1.0,) + (9.0,) * 5}, "shoulder_pan brakes with 1, less than"),
        ({"stops_s": (0.3,)}, "6 numbers"),
    ],
)
def test_an_arm_that_stops_worse_than_reckoned_with_is_weaker(changed: dict[str, Any], told: str) -> None:
    good = Stopping(reacts_s=(0.02,) * 6, stops_s=(0.3,) * 6, over_rad=(0.2,) * 6, brakes_rad_s2=(9.0,) * 6)
    robot = CONFIGURATION.robot
    assert good.weaker(robot.acceleration_rad_s2, robot.joints) == []
    assert told in good.model_copy(update=changed).weaker(robot.acceleration_rad_s2, robot.joints)[0]


def test_a_slower_reaction_than_that_of_separation_is_refused(tmp_path: Path) -> None:
    late = {"reacts_s": [0.2] * 6, "stops_s": [0.5] * 6, "over_rad": [0.3] * 6, "brakes_rad_s2": [9.0] * 6}
    path = changed_configuration(tmp_path, "", "")
    put = {"stopping": late, "separation": {"reaction_s": 0.1}}
    text = yaml.safe_load(path.read_text())
    text["motion"] = {**text.get("motion", {}), **put}
    path.write_text(yaml.safe_dump(text))
    configuration = load_configuration(path)
    assert "reaction_s 0.1 is less than 0.24" in weaknesses(configuration, load_faults(configuration))[0]
