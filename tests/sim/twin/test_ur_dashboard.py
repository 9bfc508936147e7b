"""The dashboard answers as its software's version has its commands; without one the driver says so at once."""

from __future__ import annotations

import contextlib
import gc
import socket
import threading
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.drivers import ur_dashboard, ur_examined
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur import UrArm
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import WallClock
from bracket_sim.twin.controller import Controller, RobotMode, UrWires
from bracket_sim.twin.ur_dashboard import COMMANDS, answered
from bracket_sim.twin.ur_model import MODELS, model_of
from tests.sim.twin.rig import own_host, ur_wires

HOST = own_host(63)
UNKNOWN = "could not understand: "
OLDEST, CB3 = (3, 0, 16471, 0), (3, 15, 8, 0)
E_OLDEST, E_SERIES, X = (5, 0, 0, 0), (5, 12, 2, 0), (10, 7, 0, 0)


@pytest.fixture(scope="module")
def wires() -> Iterator[UrWires]:
    with ur_wires(HOST) as served:
        yield served


@pytest.fixture
def controller(wires: UrWires) -> Iterator[Controller]:
    yield wires.controller
    wires.controller.mend()


def of(controller: Controller, version: tuple[int, int, int, int]) -> Controller:
    """The controller with software of this version."""
    controller.model = replace(MODELS["ur10" if version[0] < 5 else "ur10e"], version=version)
    return controller


@pytest.mark.parametrize(
    ("asked", "knows", "not_yet"),
    [
        ("is in remote control", [E_SERIES], [OLDEST, CB3, E_OLDEST]),
        ("safetystatus", [E_SERIES], [OLDEST, CB3, E_OLDEST]),
        ("get operational mode", [E_SERIES], [CB3, E_OLDEST]),
        ("get robot model", [CB3, E_SERIES], [OLDEST, E_OLDEST]),
        ("version", [E_OLDEST, E_SERIES], [OLDEST, CB3]),
        ("safetymode", [OLDEST, CB3, E_OLDEST, E_SERIES], []),
        ("robotmode", [OLDEST, CB3, E_OLDEST, E_SERIES], []),
        ("unlock protective stop", [CB3, E_OLDEST], [OLDEST]),
    ],
)
def test_a_command_is_there_from_its_version_on(
    controller: Controller, asked: str, knows: list[tuple[int, int, int, int]], not_yet: list[tuple[int, int, int, int]]
) -> None:
    assert [answered(of(controller, version), asked).startswith(UNKNOWN) for version in knows] == [False] * len(knows)
    assert [answered(of(controller, version), asked) for version in not_yet] == [f"{UNKNOWN}'{asked}'"] * len(not_yet)


def test_what_the_maker_s_client_asks_is_answered(controller: Controller) -> None:
    told = {asked: answered(of(controller, E_SERIES), asked) for asked in ("version", "popup hello", "load a b.urp")}
    assert told == {"version": "5.12.2.0", "popup hello": "showing popup", "load a b.urp": "File not found: a b.urp"}
    assert answered(controller, "dance").startswith(UNKNOWN)
    assert answered(controller, "playing").startswith(UNKNOWN)


def test_play_says_that_there_is_nothing_to_play(controller: Controller) -> None:
    assert answered(controller, "play") == "Failed to execute: play"


def test_local_control_refuses_what_acts_and_answers_what_is_asked(controller: Controller) -> None:
    of(controller, E_SERIES).remote = False
    refused = {asked for asked in COMMANDS if answered(controller, asked).startswith("Command is not allowed")}
    assert {"power on", "play", "unlock protective stop", "load"} <= refused
    assert not refused & {"robotmode", "safetymode", "is in remote control", "popup"}


def test_what_the_dashboard_does_not_know_is_told_at_once(controller: Controller) -> None:
    of(controller, OLDEST).protective_stop()
    began_s = time.monotonic()
    with pytest.raises(DeviceFault, match="answers to 'unlock protective stop': could not understand"):
        ur_dashboard.bring_back(HOST, 1.0)
    assert time.monotonic() - began_s < 5.0


@pytest.mark.parametrize("version", [CB3, E_OLDEST, E_SERIES])
def test_an_arm_without_power_is_brought_back_by_any_version(
    controller: Controller, version: tuple[int, int, int, int]
) -> None:
    of(controller, version).power_off()
    ur_dashboard.bring_back(HOST, 1.0)
    assert controller.robot_mode is RobotMode.RUNNING


def test_polyscope_x_is_told_at_once_and_by_the_doctor(controller: Controller) -> None:
    of(controller, X)
    configuration, began_s = load_configuration(), time.monotonic()
    robot, settings = configuration.robot, UrSettings(host=HOST)
    with pytest.raises(
        DeviceFault, match=r"has PolyScope X \(10.7.0\): without a dashboard nothing brings its arm back"
    ):
        UrArm(settings, WallClock(), load_product(configuration), robot)
    assert time.monotonic() - began_s < 5.0
    (check,) = ur_examined.examine(settings, configuration.bench, robot, Kinematics().forward)
    assert "PolyScope X" in check.remedy


@pytest.mark.parametrize("name", MODELS)
def test_each_model_stretches_as_far_as_its_lengths(name: str) -> None:
    rows = MODELS[name].rows
    pose = MODELS[name].tool_pose(np.zeros(6), np.zeros(6))
    assert pose[0] == pytest.approx(rows.a_m[1] + rows.a_m[2])
    assert pose[1] == pytest.approx(-rows.d_m[3] - rows.d_m[5])
    assert pose[2] == pytest.approx(rows.d_m[0] - rows.d_m[4])


def test_an_arm_of_another_maker_has_no_such_controller() -> None:
    with pytest.raises(InputError, match="a twin of 'gofa': no such controller; legal names of a robot: ur3, ur5"):
        model_of("gofa")
    assert model_of("UR5e") is MODELS["ur5e"]


def test_a_dashboard_that_hangs_up_at_once_leaves_no_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        monkeypatch.setattr(ur_dashboard, "PORT", server.getsockname()[1])
        threading.Thread(target=lambda: server.accept()[0].close()).start()
        with warnings.catch_warnings():
            warnings.simplefilter("error", ResourceWarning)
            with pytest.raises(DeviceFault, match="hung up"):
                ur_dashboard.Dashboard("127.0.0.1")
            gc.collect()


@pytest.mark.parametrize("sends", ["a drop at a time", "all at once"])
def test_another_server_whose_line_does_not_end_is_told_in_time(monkeypatch: pytest.MonkeyPatch, sends: str) -> None:
    host = own_host(64)
    monkeypatch.setattr(ur_dashboard, "ANSWER_S", 0.4)

    def serve(server: socket.socket) -> None:
        connection, _ = server.accept()
        with connection, contextlib.suppress(OSError):
            for _ in range(60):
                connection.sendall(b"x" if "drop" in sends else b"x" * 1000)
                time.sleep(0.1 if "drop" in sends else 0.0)

    with socket.create_server((host, ur_dashboard.PORT)) as server:
        threading.Thread(target=serve, args=(server,), daemon=True).start()
        begun_s = time.monotonic()
        with pytest.raises(DeviceFault, match=f"the dashboard at {host} does not"):
            ur_dashboard.Dashboard(host)
    assert time.monotonic() - begun_s < 3.0, "it would have waited as long as something came"
