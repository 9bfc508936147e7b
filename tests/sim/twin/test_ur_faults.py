"""What goes wrong with an arm of Universal Robots is told in the right mode, and ends when a person has mended it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur import UrArm
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.contracts.arm import Bench, off_rad
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.observation import ArmMode, ArmState
from tests.sim.twin.rig import Twin, running_twin

TWINS = {"ur10": 61, "ur10e": 62}  # an e-series has local control
MOVED_RAD = 0.02


@pytest.fixture(scope="module", params=["ur10", pytest.param("ur10e", marks=pytest.mark.slow)])
def twin(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Twin]:
    with running_twin(tmp_path_factory.mktemp("twin"), TWINS[request.param], request.param) as running:
        yield running


@pytest.fixture
def ur(twin: Twin) -> Iterator[Bench]:
    arm = opened(twin)
    yield arm
    arm.arm.close()  # type: ignore[attr-defined]
    twin.fault("mended")


def opened(twin: Twin) -> Bench:
    configuration, clock = load_configuration(), WallClock(twin.slower)
    arm = UrArm(UrSettings(host=twin.host), clock, load_product(configuration), configuration.robot)
    return Bench(arm, clock, lambda: None)


@pytest.mark.long
@pytest.mark.parametrize(
    ("begins", "mode", "mends"),
    [
        (["emergency_stop"], "emergency_stop", ["emergency_released"]),
        (["local"], "not_controlled", ["remote"]),
        (["paused", "moved_by_hand", "played"], "not_controlled", []),
        (["controller_restarted"], "not_controlled", []),
    ],
    ids=lambda value: value[0] if isinstance(value, list) and value else None,
)
def test_a_person_brings_it_back(ur: Bench, twin: Twin, begins: list[str], mode: ArmMode, mends: list[str]) -> None:
    ur.half_way()
    for name in begins:
        twin.fault(name)
        ur.tick()
    ur.until(lambda state: state.mode == mode)
    bring_back(ur, twin, mode, mends)


@pytest.mark.long
def test_a_connection_that_is_cut_is_mended_in_time_or_by_a_person(ur: Bench, twin: Twin) -> None:
    path = ur.half_way()
    twin.fault("rtde_cut")
    if ur.until(lambda state: state.mode == "not_controlled" or not state.moving)[-1].mode == "not_controlled":
        bring_back(ur, twin, "not_controlled", [])
    else:  # the client connected again before anybody missed it
        assert np.abs(ur.at_rad - path.at(path.duration_s)).max() < 0.006


def bring_back(ur: Bench, twin: Twin, mode: ArmMode, mends: list[str]) -> None:
    """An arm that stopped stays where it is, until a person has mended what is wrong and said so."""
    assert ur.arm.state().reason
    ur.stand()
    here = ur.at_rad
    for _ in range(10):  # nothing goes on by itself
        state = ur.tick()
    assert (state.mode, state.moving) == (mode, False)
    assert np.abs(ur.at_rad - here).max() < MOVED_RAD
    for name in mends:
        twin.fault(name)
    ur.arm.acknowledge()
    ur.until(lambda state: state.mode == "normal", 20.0)
    assert np.abs(ur.at_rad - here).max() < MOVED_RAD
    path = ur.arm.follow(ur.way(0.3))
    ur.rest()
    assert np.abs(ur.at_rad - path.at(path.duration_s)).max() < 0.006


@pytest.mark.long
def test_an_acknowledgement_that_comes_too_early_says_what_to_do(ur: Bench, twin: Twin) -> None:
    twin.fault("emergency_stop")
    ur.until(lambda state: state.mode == "emergency_stop")
    ur.arm.acknowledge()
    ur.until(lambda state: "still pressed" in state.reason)
    twin.fault("emergency_released")
    ur.arm.acknowledge()
    ur.until(lambda state: state.mode == "normal", 20.0)


@pytest.mark.long
def test_a_safeguard_that_closed_lets_the_arm_go_on_along_its_path_once_somebody_said_so(ur: Bench, twin: Twin) -> None:
    path = ur.half_way()
    twin.fault("safeguard")
    ur.until(lambda state: state.mode == "safeguard_stop")
    ur.stand()
    stands = ur.tick()
    assert stands.path_s is not None
    assert np.abs(np.array(stands.positions_rad) - path.at(stands.path_s)).max() < 0.006
    ur.arm.acknowledge()  # still open: it does not count
    twin.fault("safeguard_closed")
    ur.until(lambda state: state.mode == "safeguard_closed")
    here = ur.at_rad
    for _ in range(50):  # somebody may be inside
        waits = ur.tick()
    assert (waits.mode, waits.moving) == ("safeguard_closed", True)
    assert np.abs(ur.at_rad - here).max() < MOVED_RAD
    ur.arm.acknowledge()
    states = ur.until(lambda state: state.mode == "normal" and not state.moving, 20.0)
    assert all(state.moving for state in states[:-1])
    assert np.abs(ur.at_rad - path.at(path.duration_s)).max() < 0.006


@pytest.mark.long
def test_the_slider_slows_the_arm_down_on_its_path(ur: Bench, twin: Twin) -> None:
    path = ur.arm.follow(ur.way())
    twin.fault("slider")
    states = ur.until(lambda state: not state.moving, 15.0)
    twin.fault("slider_full")
    fastest = max(np.abs(state.velocities_rad_s).max() for state in states[10:])
    assert fastest < 0.5 * np.abs(np.diff(path.positions_rad, axis=0) / np.diff(path.times_s)[:, None]).max()
    assert max(off_rad(path, np.array(state.positions_rad)) for state in states) < 0.01


@pytest.mark.long
def test_reduced_mode_slows_the_arm_down_before_the_controller_stops_it(ur: Bench, twin: Twin) -> None:
    path = ur.half_way()
    twin.fault("reduced")
    states = ur.until(lambda state: not state.moving, 20.0)
    twin.fault("reduced_over")
    assert {state.mode for state in states} <= {"normal", "reduced"}
    assert states[-1].mode == "reduced"
    fastest = max(tool_m_s(state) for state in states[12:])
    assert 0.1 < fastest < 0.25
    assert np.abs(ur.at_rad - path.at(path.duration_s)).max() < 0.006


def tool_m_s(state: ArmState) -> float:
    """How fast the tool is."""
    kinematics, step_s = Kinematics(), 1e-4
    joints, speeds = np.array(state.positions_rad), np.array(state.velocities_rad_s)
    way = kinematics.position_m(joints + speeds * step_s) - kinematics.position_m(joints)
    return float(np.linalg.norm(way)) / step_s


def test_samples_that_come_late_are_old_and_none_is_lost(ur: Bench, twin: Twin) -> None:
    ur.arm.samples()
    twin.fault("rtde_late")
    ages = []
    for _ in range(12):
        state = ur.tick()
        ages.append(ur.clock.now_s() - state.time_s)
    samples = ur.arm.samples()
    assert max(ages) > 0.06
    assert samples is not None
    assert np.diff(samples.times_s).max() < 0.03


def test_an_arm_that_tells_nothing_has_an_old_state_with_a_reason_until_it_tells_again(ur: Bench, twin: Twin) -> None:
    twin.fault("rtde_silent")
    old = ur.until(lambda state: ur.clock.now_s() - state.time_s > 1.0, 3.0)
    assert all(state.reason for state in old[-10:])
    ur.until(lambda state: ur.clock.now_s() - state.time_s < 0.1, 3.0)


def test_a_fieldbus_on_the_lower_registers_leaves_the_upper_ones(twin: Twin) -> None:
    twin.fault("fieldbus")
    bench = opened(twin)
    try:
        path = bench.arm.follow(bench.way(0.3))
        bench.rest()
        assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006
    finally:
        bench.arm.close()  # type: ignore[attr-defined]
        twin.fault("fieldbus_gone")


@pytest.mark.long
def test_a_payload_that_is_wrong_stops_the_arm(ur: Bench, twin: Twin) -> None:
    twin.fault("payload_wrong")
    ur.arm.follow(ur.way())
    ur.until(lambda state: state.mode == "protective_stop")
    twin.fault("payload_right")
    ur.arm.acknowledge()
    ur.until(lambda state: state.mode == "normal", 20.0)


def test_a_process_that_streams_no_more_is_known_and_another_takes_over(ur: Bench) -> None:
    ur.half_way()
    stream = ur.arm._stream  # type: ignore[attr-defined]
    stream.child.close()
    ur.until(lambda state: state.mode == "not_controlled")
    ur.stand()
    ur.arm.acknowledge()
    ur.until(lambda state: state.mode == "normal", 20.0)
