"""Kinematics of the arm with its tool: forward by Pinocchio, inverse by placo, elbow up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio
import placo

from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.robot import SAME_RAD

FLANGE = "tool0"
Posture = tuple[float, float]  # which way the shoulder leans, and the sign of wrist_2
USUAL: Posture = (1.0, -1.0)
OTHERS: tuple[Posture, ...] = ((-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))  # to the last two the tool turns over

# Elbow up, wrist_2 so that the tool points down; pan and wrist_3 are seeded from the target.
_SEED_RAD = np.array([0.0, -1.3, 1.9, -2.17, -math.pi / 2, 0.0])
_POSITION_TOLERANCE_M = 5e-5
_ANGLE_TOLERANCE_RAD = 5e-4
_MAX_ITERATIONS = 60
_REGULARISATION = 1e-6
_FIRST_JOINT = 7  # placo gives every robot a floating base, which comes first in its state


class Kinematics:
    """Joint angles to the pose of the tool frame (TCP) and back; the world frame is the arm's base.

    Attributes:
        limits_rad: (2, 6) the least and the most of each joint.
    """

    def __init__(self, settings: MotionSettings | None = None) -> None:
        settings = settings or MotionSettings()
        robot = settings.robot
        self.limits_rad = robot.limits_rad
        self._flange_from_tool = Pose((0.0, 0.0, robot.tool.tcp_from_flange_m))
        self._tool_from_flange = self._flange_from_tool.inverse()
        self.model = pinocchio.buildModelFromXML(robot.urdf_text)
        self._data = self.model.createData()
        self._flange = self.model.getFrameId(FLANGE)
        self._arm_offset_m = self._offset_m()
        self._robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, robot.urdf_text)
        self._solver = placo.KinematicsSolver(self._robot)
        self._solver.mask_fbase(True)
        self._solver.add_regularization_task(_REGULARISATION)
        self._task = self._solver.add_frame_task(FLANGE, np.eye(4))
        self._task.configure(FLANGE, "soft", 1.0, 1.0)

    def forward(self, joints_rad: Array) -> Pose:
        """world_from_tool of joint angles (6,)."""
        return Pose.from_matrix(self._flange_matrix(joints_rad)) @ self._flange_from_tool

    def position_m(self, joints_rad: Array) -> Array:
        """Where the tool is (3,), in a third of the time."""
        flange = self._flange_matrix(joints_rad)
        position: Array = flange[:3, 3] + self._flange_from_tool.position_m[2] * flange[:3, 2]
        return position

    def inverse(self, world_from_tool: Pose, near_rad: Array | None = None, posture: Posture = USUAL) -> Array | None:
        """Joint angles (6,) that bring the tool there, elbow up; None where the arm cannot reach.

        Args:
            near_rad: the answer is wrapped to the turns nearest to these joints, as far as the limits allow.
        """
        shoulder, wrist = posture
        target = (world_from_tool @ self._tool_from_flange).matrix
        joints = self._solve(target, self._seed(target, shoulder, wrist))
        if joints is None or joints[2] * shoulder < 0:
            return None
        return self._allowed(self.wrapped(joints, np.zeros(6) if near_rad is None else near_rad))

    def follow(self, world_from_tool: Pose, previous_rad: Array) -> Array | None:
        """Joint angles (6,) next to those of a neighbouring point on a path; None where the arm cannot reach."""
        target = (world_from_tool @ self._tool_from_flange).matrix
        joints = self._solve(target, previous_rad)
        return None if joints is None else self._allowed(joints)

    def wrapped(self, joints_rad: Array, near_rad: Array) -> Array:
        """The same pose with every joint turned by whole turns to lie nearest to `near_rad` within the limits.

        Of wrist_1 the tool's pitch counts, lift + elbow + wrist_1: from shoulder to shoulder the tool stays as it is.
        """
        near = np.array(near_rad, dtype=float)
        level = near[1:4].sum() - joints_rad[1:3].sum()
        least, most = self.limits_rad
        near[3] = np.clip(level, least[3], most[3])
        nearest = joints_rad + np.round((near - joints_rad) / (2 * math.pi)) * 2 * math.pi
        answer: Array = nearest + 2 * math.pi * ((nearest < least).astype(float) - (nearest > most))
        return answer

    def within_limits(self, joints_rad: Array) -> bool:
        """Whether all joints (..., 6) lie within the arm's limits."""
        least, most = self.limits_rad
        return bool(np.all((joints_rad >= least - SAME_RAD) & (joints_rad <= most + SAME_RAD)))

    def _allowed(self, joints_rad: Array) -> Array | None:
        return joints_rad if self.within_limits(joints_rad) else None

    def _offset_m(self) -> float:
        """How far the wrist's plane lies beside the base's axis (d4 of a UR), without the noise of its sum."""
        pinocchio.forwardKinematics(self.model, self._data, np.zeros(self.model.nq))
        wrist = self.model.getJointId("wrist_2_joint")
        return round(float(self._data.oMi[wrist].translation[1]), 6)

    def _flange_matrix(self, joints_rad: Array) -> Array:
        pinocchio.forwardKinematics(self.model, self._data, np.asarray(joints_rad, dtype=float))
        placement = pinocchio.updateFramePlacement(self.model, self._data, self._flange)
        matrix: Array = placement.homogeneous
        return matrix

    def _seed(self, target: Array, shoulder: float, wrist: float) -> Array:
        """Pan points the arm's plane at the target; wrist_3 takes up the heading that is left."""
        x, y = target[0, 3], target[1, 3]
        reach = max(math.hypot(x, y), self._arm_offset_m)
        pan, lift, elbow, first, second, _ = _SEED_RAD
        beside = math.asin(self._arm_offset_m / reach)
        if shoulder < 0:  # turned round, the arm leans back
            pan, lift, beside = math.pi, -math.pi - lift, -beside
        first = first if shoulder * wrist < 0 else first + math.pi
        seed = np.array([pan + math.atan2(y, x) - beside, lift, shoulder * elbow, first, -wrist * second, 0.0])
        turn = self._flange_matrix(seed)[:3, :3].T @ target[:3, :3]
        seed[5] = math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
        return self.wrapped(seed, np.zeros(6))

    def _solve(self, target: Array, seed_rad: Array) -> Array | None:
        robot = self._robot
        robot.state.q[_FIRST_JOINT:] = seed_rad
        self._task.T_world_frame = target
        for _ in range(_MAX_ITERATIONS):
            robot.update_kinematics()
            if _error(robot.get_T_world_frame(FLANGE), target):
                joints: Array = np.array(robot.state.q[_FIRST_JOINT:])
                return joints
            self._solver.solve(True)
        return None


def _error(actual: Array, target: Array) -> bool:
    """Whether two poses (4, 4) agree within the tolerances."""
    offset = actual[:3, 3] - target[:3, 3]
    if offset @ offset > _POSITION_TOLERANCE_M**2:
        return False
    # ||R1 - R2||_F^2 = 8 sin^2(angle / 2), about 2 angle^2
    difference = (actual[:3, :3] - target[:3, :3]).ravel()
    return bool(difference @ difference < 2 * _ANGLE_TOLERANCE_RAD**2)


class LinkPlaces:
    """An arm whose joints follow one another, with bodies that are fixed to them.

    Args:
        joints: of each body's placement: the joint that carries it.
        placements: joint_from_body of each.
    """

    def __init__(self, model: pinocchio.Model, joints: Sequence[int], placements: Sequence[pinocchio.SE3]) -> None:
        self._turns = [_turn(model, number) for number in range(1, model.njoints)]
        self._joints = np.array(joints) - 1
        self._placements = np.array([one.homogeneous for one in placements])

    def at(self, joints_rad: Array) -> Array:
        """world_from_body (K, L, 4, 4) of L bodies, from joints (K, n)."""
        cosines, sines = np.cos(joints_rad)[..., None, None], np.sin(joints_rad)[..., None, None]
        carried, place = np.empty((len(joints_rad), len(self._turns), 4, 4)), None
        for number, (still, sine, cosine) in enumerate(self._turns):
            turned = still + sine * sines[:, number] + cosine * cosines[:, number]
            place = turned if place is None else place @ turned
            carried[:, number] = place
        placed: Array = carried[:, self._joints] @ self._placements
        return placed


def _turn(model: pinocchio.Model, number: int) -> tuple[Array, Array, Array]:
    """What turns with a joint: the sum of the first, the second times its sine and the third times its cosine.

    Rodrigues' formula, after the placement of the joint on the one before it.
    """
    assert model.parents[number] == number - 1
    data = model.joints[number].createData()
    model.joints[number].calc(data, np.zeros(model.nq))
    x, y, z = np.asarray(data.S)[3:].ravel()
    cross = np.zeros((4, 4))
    cross[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    before, square = model.jointPlacements[number].homogeneous, cross @ cross
    return before @ (np.eye(4) + square), before @ cross, before @ -square
