"""Configurations of logs are read in today's form, whatever form they were written in."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import yaml

from bracket_cell.configuration import DEFAULT_CONFIGURATION, Configuration, load_configuration
from bracket_cell.device_settings import OwnDevice
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.logged_tree import logged_motion, upgrade, write_files
from bracket_cell.skills.drivers.settings import CanSettings, SignalSettings
from bracket_ground.errors import LogError
from bracket_ground.interfaces.robot import default_robot


def as_recorded(folder: Path, code: Mapping[str, bytes] | None = None, **changes: object) -> Configuration:
    """The shipped configuration with other keys, as a log of before has it: without its neighbours but the product."""
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text()) | changes
    shutil.copy(DEFAULT_CONFIGURATION.parent / "products.yaml", folder / "products.yaml")
    (folder / "configuration.yaml").write_text(yaml.safe_dump({key: value for key, value in data.items() if value}))
    upgrade(cast(Log, SimpleNamespace(attachments=code or {})), folder)
    return load_configuration(folder / "configuration.yaml")


def test_the_form_before_devices_had_roles(tmp_path: Path) -> None:
    read = as_recorded(
        tmp_path,
        robot=None,
        gripper_can={"interface": "socketcan", "channel": "can0", "bitrate": 250000},
        signals={"inputs": {"ready": 3}},
        devices={"factory": "lab:open_cell", "simulation": {"look": "looks/gone.yaml"}},
        motion={"speed_limits_rad_s": [1.047] * 6, "tcp_from_tool0_m": 0.2, "grip_force_n": 50, "servo_lag_s": 0.1},
    )
    assert read.devices.gripper == CanSettings(interface="socketcan", channel="can0", bitrate=250_000)
    assert read.devices.signals == SignalSettings(inputs={"ready": 3})
    assert read.motion.speed_limits_rad_s == (1.047,) * 6
    assert read.motion.acceleration_limits_rad_s2 == default_robot().acceleration_rad_s2
    assert (read.robot.gripper.tcp_from_flange_m, read.motion.grip_force_n) == (0.2, 50)


def test_keys_that_no_file_sets_any_more_are_left_out(tmp_path: Path) -> None:
    planners = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())["planners"]
    planners["semantic"]["new_goals"] = {"none_probability": 0.1, "discount": 0.2}
    read = as_recorded(
        tmp_path,
        devices={"gripper": {"kind": "can", "start_up_s": 3.0}},
        perception={"kind": "learned", "classical": {"skin_rgb": [0.5, 0.4, 0.3], "still_m": 0.01}},
        log={"buffer_mb": 8.0, "jpeg_quality": 70},
        motion={"contact_lag_m": 0.003, "grip_force_n": 50, "separation": {"assumed_height_m": 0.2, "people": 2}},
        planners=planners,
    )
    assert (read.devices.gripper, read.log.jpeg_quality) == (CanSettings(), 70)
    assert read.perception.classical.skin_rgb == (0.5, 0.4, 0.3)
    assert read.planners.semantic.new_goals.none_probability == 0.1
    assert (read.motion.grip_force_n, read.motion.separation.people, read.motion.contact_lag_m) == (50, 2, 0.002)


def test_drivers_that_are_not_here_and_files_that_were_beside_it_are_not_needed(tmp_path: Path) -> None:
    own = {"kind": "their_lab:Arm", "host": "192.0.2.10"}
    read = as_recorded(tmp_path, devices={"arm": own, "simulation": "sim.yaml"})
    assert isinstance(read.devices.arm, OwnDevice)
    assert read.robot == default_robot()


def test_the_robot_of_the_run_is_the_one_that_was_recorded(tmp_path: Path) -> None:
    robot = default_robot().model_copy(update={"name": "mine"})
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot.model_dump(mode="json")))
    assert as_recorded(tmp_path, robot="robots/mine.yaml").robot.name == "mine"


def test_nodes_that_a_log_names_count_where_they_are_its_own_and_nothing_is_written_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, log = tmp_path / "here", tmp_path / "log"
    for folder in (here / "mine", log):
        folder.mkdir(parents=True)
    monkeypatch.chdir(here)
    (here / "mine" / "own.py").write_text("OWN = 1\n")
    (here / "mine" / "other.py").write_text("OTHER = 1\n")
    named: dict[str, Any] = {"nodes": ["nodes", "mine"], "devices": {"simulation": "sim.yaml"}}
    assert as_recorded(log, **named).nodes == ()
    assert as_recorded(log, {"nodes/own.py": b"OWN = 1\n"}, **named).nodes == (str(here / "mine" / "own.py"),)
    assert [path.name for path in here.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    "files",
    [
        {"configuration.yaml": b"devices: 3"},
        {"configuration.yaml": b"motion: [1]"},
        {"configuration.yaml": b"nodes: 7"},
        {"configuration.yaml": b"motion: {}", "robot.yaml": b"\xff"},
    ],
)
def test_a_configuration_that_is_none_is_one_clear_error(files: dict[str, bytes], tmp_path: Path) -> None:
    log = Log(tmp_path / "log.mcap", files, {}, {}, (), ())
    with pytest.raises(LogError, match="its configuration does not hold what it should"):
        write_files(log, files, tmp_path)


def test_the_tool_of_a_log_is_moved_by_its_own_arm(tmp_path: Path) -> None:
    log = read_log(Path("tests/cases/assembly-g2-seed3.mcap"))
    robot = yaml.safe_load(log.attachments["robot.yaml"]) | {"name": "mine", "speed_rad_s": [1.0] * 6}
    attachments = {**log.attachments, "robot.yaml": yaml.safe_dump(robot).encode()}
    motion = logged_motion(cast(Log, SimpleNamespace(path=tmp_path, attachments=attachments)))
    assert (motion.robot.name, motion.speed_limits_rad_s) == ("mine", (1.0,) * 6)
