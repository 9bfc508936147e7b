"""The twin's arm stops by itself as its maker's does: set points that jump, and the general limits of the safety."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.robot import MotionLimits
from bracket_sim.scene.world import World, build_world
from bracket_sim.twin.arm import TwinArm
from bracket_sim.twin.rtde import INPUTS, OUTPUTS, output_of

DT_S = 0.008
TURN = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture
def world() -> World:
    configuration = load_configuration()
    world = build_world(load_product(configuration), configuration.bench, ())
    world.set_arm(np.array(configuration.robot.home_rad))
    return world


def driven(world: World, arm: TwinArm, periods: int) -> Iterator[int]:
    """Let the arm go on; ends where it stops by itself."""
    for number in range(periods):
        yield number
        arm.update(number * DT_S, DT_S)
        world.step_period()
        arm.observe((number + 1) * DT_S)
        if arm.held_back:
            return


def served(world: World, arm: TwinArm, speed_rad_s: float, jump_rad: float = 0.0) -> str:
    """Set points of the base that speed up by 3 rad/s2 and then jump; why the arm stopped."""
    goal, speed = arm.measured.positions_rad.copy(), 0.0
    for number in driven(world, arm, 150):
        speed = min(speed_rad_s, speed + 3.0 * DT_S)
        goal = goal + TURN * (speed * DT_S + (jump_rad if number == 100 else 0.0))
        arm.servo(goal, 0.03)
    return arm.held_back


def test_set_points_of_a_smooth_path_are_followed(world: World) -> None:
    assert served(world, TwinArm(world), 1.2) == ""


@pytest.mark.parametrize("jump_rad", [0.09, -0.09])
def test_set_points_that_jump_stop_the_arm(world: World, jump_rad: float) -> None:
    assert served(world, TwinArm(world), 0.2, jump_rad).startswith("set points jump: a joint would speed up by")


def test_the_slider_is_no_jump(world: World) -> None:
    arm = TwinArm(world)
    goal = arm.measured.positions_rad.copy()
    for number in driven(world, arm, 100):
        arm.scale = 0.3 if number == 60 else arm.scale
        goal = goal + TURN * 0.01 * min(1.0, number / 50) * arm.scale
        arm.servo(goal, 0.03)
    assert arm.held_back == ""


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (MotionLimits(tool_m_s=0.25), "the tool moves at 0."),
        (MotionLimits(elbow_m_s=0.1), "the elbow moves at 0."),
        (MotionLimits(momentum_kg_m_s=3.0), "the arm's momentum is "),
        (MotionLimits(joint_rad_s=(0.4, 2, 2, 2, 2, 2)), "shoulder_pan_joint moves at 0."),
    ],
)
def test_a_general_limit_stops_the_arm(world: World, limits: MotionLimits, said: str) -> None:
    arm = TwinArm(world)
    arm.limits = limits
    assert served(world, arm, 0.8).startswith(said)


def test_motions_that_the_controller_plans_are_as_fast_as_its_joints(world: World) -> None:
    arm, fastest = TwinArm(world), [0.0]
    most = world.robot.speed_rad_s[0]
    goal = arm.measured.positions_rad + 2.0 * TURN
    for number in driven(world, arm, 400):
        if number == 0:
            arm.speed(2.9 * TURN, 40.0)
        elif number == 60:
            arm.move([(goal, 3.1, 8.0)])
        fastest.append(float(np.abs(arm.driven_rad_s).max()))
    assert arm.held_back == ""
    assert fastest[50] == pytest.approx(most)
    assert max(fastest) <= most + 1e-9


def trailed(world: World, lookahead_s: float, gain: float) -> tuple[float, float]:
    """How far joints trail set points that go at 0.2 rad/s [s], and how far they shoot over where these stand [rad]."""
    arm = TwinArm(world)
    goal, ahead_rad = arm.measured.positions_rad.copy(), list[float]()
    for number in driven(world, arm, 300):
        goal = goal + TURN * 0.2 * DT_S * (number < 200)
        ahead_rad.append(float((goal - arm.measured.targets_rad)[0]))
        arm.servo(goal, lookahead_s, gain)
    assert arm.held_back == ""
    return ahead_rad[199] / 0.2, -min(ahead_rad)


@pytest.mark.parametrize(("lookahead_s", "gain"), [(0.03, 2000), (0.1, 300), (0.2, 2000)])
def test_joints_trail_their_set_points_by_the_lookahead(world: World, lookahead_s: float, gain: float) -> None:
    trails_s, over = trailed(world, lookahead_s, gain)
    assert trails_s == pytest.approx(lookahead_s + DT_S, abs=DT_S)
    assert over < 0.001


def test_a_low_gain_with_a_short_lookahead_shoots_over(world: World) -> None:
    """As the maker warns: a high lookahead prevents overshoot."""
    assert trailed(world, 0.03, 300)[1] > 0.004


def test_speeds_are_those_of_the_joint_that_turns(world: World) -> None:
    arm = TwinArm(world)
    assert served(world, arm, 0.5) == ""
    seen, reach_m = arm.measured, np.hypot(*world.tool_pose().position_m[:2])
    assert np.linalg.norm(seen.tool_m_s[:3]) == pytest.approx(0.5 * reach_m, rel=0.02)
    assert seen.tool_m_s[5] == pytest.approx(0.5, rel=0.02)
    assert np.linalg.norm(seen.elbow_m_s) == pytest.approx(0.5 * np.hypot(*seen.elbow_m[:2]), rel=0.02)


GUIDE = """timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current
actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose
target_TCP_speed actual_digital_input_bits joint_temperatures actual_execution_time robot_mode joint_mode safety_mode
safety_status actual_tool_accelerometer speed_scaling target_speed_fraction actual_momentum actual_main_voltage
actual_robot_voltage actual_robot_current actual_joint_voltage actual_digital_output_bits runtime_state elbow_position
elbow_velocity robot_status_bits safety_status_bits analog_io_types standard_analog_input0 standard_analog_input1
standard_analog_output0 standard_analog_output1 io_current euromap67_input_bits euromap67_output_bits
euromap67_24V_voltage euromap67_24V_current tool_mode tool_analog_input_types tool_analog_input0 tool_analog_input1
tool_output_voltage tool_output_current tool_temperature tcp_force_scalar output_bit_registers0_to_31
output_bit_registers32_to_63 output_bit_register_64 output_int_register_0 output_double_register_0
input_bit_registers0_to_31 input_bit_registers32_to_63 input_bit_register_64 input_int_register_0
input_double_register_0 tool_output_mode tool_digital_output0_mode tool_digital_output1_mode payload payload_cog
payload_inertia script_control_line ft_raw_wrench joint_position_deviation_ratio collision_detection_ratio
time_scale_source"""


def test_every_output_of_the_makers_guide_is_there() -> None:
    assert [name for name in GUIDE.split() if output_of(name) is None] == []
    assert not set(OUTPUTS) & (set(INPUTS) - {"input_bit_registers0_to_31", "input_bit_registers32_to_63"})
