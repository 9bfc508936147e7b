"""Kinematics of the arm with its tool: forward by Pinocchio, inverse by damped least squares from many postures.

Levenberg-Marquardt with the damping of Sugihara, Solvability-Unconcerned Inverse Kinematics, IEEE T-RO 2011: it grows
with the error. Every step is kept within the joints' limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio

from bracket_cell.skills.motion.postures import Postures, axis_of, slides, usual_posture
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.robot import SAME_RAD
from bracket_ground.interfaces.urdf import FLANGE

SAME_POSTURE_RAD = 0.05  # answers that differ by less are one
MOST_STEPS = 40
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a straight way between postures, at which the tool's tilt is looked at
TILTED_RAD = 0.75  # what the gripper holds may lean by so much on a way
SURELY = 1.1  # the farthest of the sampled postures is nearly the farthest of all
TRIED = 16  # postures from which an answer is looked for, beside the usual one

_TOLERANCE = 1e-7  # in [m] and [rad]: answers from two postures of one kind are the same
_DAMPING = 1e-9  # least; beside half the square of the error
_USUAL: dict[tuple[Postures, Pose], Array] = {}  # of the arms that were asked for
_LARGEST_STEP = 0.6  # of a joint in [rad] or [m], in which a linear model holds


class Kinematics:
    """Joint angles to the pose of the tool frame (TCP) and back, in the world's frame.

    Attributes:
        count: of the joints.
        limits_rad: (2, n) the least and the most of each joint.
        usual_rad: (n,) the posture that answers are kept near to.
    """

    def __init__(self, settings: MotionSettings | None = None) -> None:
        settings = settings or MotionSettings()
        robot = settings.robot
        self.limits_rad = robot.limits_rad
        self._flange_from_tool = Pose((0.0, 0.0, robot.gripper.tcp_from_flange_m))
        self._tool_from_flange = self._flange_from_tool.inverse()
        self.model = pinocchio.buildModelFromXML(robot.urdf_text)
        self.count: int = self.model.nq
        self._data = self.model.createData()
        self._flange = self.model.getFrameId(FLANGE)
        self._postures = Postures.of(robot.urdf_text, self.limits_rad)
        home: Array = np.array(robot.home_rad)
        self.usual_rad: Array = home if len(home) and self.within_limits(home) else self._usual()

    def forward(self, joints_rad: Array) -> Pose:
        """world_from_tool of joint angles (n,)."""
        return Pose.from_matrix(self._flange_placement(joints_rad).homogeneous) @ self._flange_from_tool

    def position_m(self, joints_rad: Array) -> Array:
        """Where the tool is (3,), in a third of the time."""
        flange = self._flange_placement(joints_rad)
        position: Array = flange.translation + self._flange_from_tool.position_m[2] * flange.rotation[:, 2]
        return position

    def inverse(self, world_from_tool: Pose, near_rad: Array | None = None) -> Array | None:
        """Joint angles (n,) that bring the tool there; None where the arm cannot reach.

        Args:
            near_rad: the answer is wrapped to the turns nearest to these joints, as far as the limits allow.
        """
        return next(self.answers(world_from_tool, near_rad), None)

    def answers(self, world_from_tool: Pose, near_rad: Array | None = None) -> Iterator[Array]:
        """Joint angles (n,) that bring the tool there.

        The usual posture comes first; others by whether the tool stays level on the straight way there, then by how
        far they are.
        """
        near = self.usual_rad if near_rad is None else np.asarray(near_rad, dtype=float)
        usual = self.solved(world_from_tool, self.turned_to(self.usual_rad, world_from_tool))
        found = [] if usual is None else [self.wrapped(usual, near)]
        yield from found
        for start in (self.turned_to(near, world_from_tool), near, *self.starts_near(world_from_tool, TRIED)):
            joints = self.solved(world_from_tool, start)
            if joints is not None:
                joints = self.wrapped(joints, near)
                if all(np.abs(joints - known).max() > SAME_POSTURE_RAD for known in found):
                    found.append(joints)
        others = [turned for joints in found for turned in self._other_turns(joints)]
        others += found[(usual is not None) :]
        yield from sorted(others, key=lambda joints: (self._tilts(near, joints), float(np.abs(joints - near).max())))

    def follow(self, world_from_tool: Pose, previous_rad: Array) -> Array | None:
        """Joint angles (n,) next to those of a neighbouring point on a path; None where the arm cannot reach."""
        return self.solved(world_from_tool, previous_rad)

    def solved(self, world_from_tool: Pose, start_rad: Array, steps: int = MOST_STEPS) -> Array | None:
        """The answer (n,) to which a posture leads in so many steps, within the limits; None where it leads to none."""
        target = pinocchio.SE3((world_from_tool @ self._tool_from_flange).matrix)
        model, data, flange = self.model, self._data, self._flange
        least, most = self.limits_rad
        joints: Array = np.clip(np.asarray(start_rad, dtype=float), least, most)
        unit = np.eye(6)
        for _ in range(steps):
            pinocchio.computeJointJacobians(model, data, joints)
            off = pinocchio.log6(pinocchio.updateFramePlacement(model, data, flange).actInv(target)).vector
            square = float(off @ off)
            if np.abs(off).max() < _TOLERANCE:
                return joints
            jacobian = pinocchio.getFrameJacobian(model, data, flange, pinocchio.LOCAL)
            damping = (0.5 * square + _DAMPING) * unit
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping, off)
            largest = float(np.abs(step).max())
            joints = np.clip(joints + step * min(1.0, _LARGEST_STEP / max(largest, 1e-12)), least, most)
        return None

    def wrapped(self, joints_rad: Array, near_rad: Array) -> Array:
        """The same pose with every joint turned by whole turns to lie nearest to `near_rad` within the limits."""
        turns = self._postures.turns
        least, most = self.limits_rad
        nearest = joints_rad + turns * np.round((near_rad - joints_rad) / (2 * math.pi)) * 2 * math.pi
        short, far = nearest < least - SAME_RAD, nearest > most + SAME_RAD
        answer: Array = nearest + turns * 2 * math.pi * (short.astype(float) - far)
        return np.where((answer < least - SAME_RAD) | (answer > most + SAME_RAD), joints_rad, answer)

    def within_limits(self, joints_rad: Array) -> bool:
        """Whether all joints (..., n) lie within the arm's limits."""
        least, most = self.limits_rad
        return bool(np.all((joints_rad >= least - SAME_RAD) & (joints_rad <= most + SAME_RAD)))

    def too_far(self, place_m: Array) -> bool:
        """Whether a place (3,) is farther away than the tool gets in any posture."""
        most_m = self._postures.reach_m + self._flange_from_tool.position_m[2]
        return not self._postures.led and float(np.linalg.norm(place_m - self._postures.origin)) > SURELY * most_m

    def starts_near(self, world_from_tool: Pose, count: int) -> list[Array]:
        """Sampled postures (n,) whose tool is nearest to a pose, turned towards it."""
        flange = (world_from_tool @ self._tool_from_flange).matrix
        return [self._turned_to(start, flange) for start in self._postures.near(flange, count)]

    def turned_to(self, start_rad: Array, world_from_tool: Pose) -> Array:
        """A posture (n,) turned towards a pose by its first and its last joint."""
        return self._turned_to(start_rad, (world_from_tool @ self._tool_from_flange).matrix)

    def heights_m(self, joints_rad: Array) -> Array:
        """(n - 1,) how high the joints are in the world, without the first."""
        pinocchio.forwardKinematics(self.model, self._data, np.asarray(joints_rad, dtype=float))
        return np.array([self._data.oMi[number].translation[2] for number in range(2, self.model.njoints)])

    def _usual(self) -> Array:
        key = (self._postures, self._flange_from_tool)
        if key not in _USUAL:
            _USUAL[key] = usual_posture(self, self._postures)
        return _USUAL[key]

    def _other_turns(self, joints_rad: Array) -> Iterator[Array]:
        """The same pose with a joint turned by a whole turn more, within the limits."""
        for number in np.flatnonzero(self._postures.turns):
            for turn in (-2 * math.pi, 2 * math.pi):
                turned = joints_rad.copy()
                turned[number] += turn
                if self.within_limits(turned):
                    yield turned

    def _tilts(self, start_rad: Array, goal_rad: Array) -> bool:
        """Whether the tool leaves the directions that it has at both ends of a straight way between."""
        axes = [
            self._flange_placement(start_rad + share * (goal_rad - start_rad)).rotation[:, 2].copy() for share in SHARES
        ]
        level = [max(float(axis @ axes[0]), float(axis @ axes[-1])) for axis in axes]
        return min(level) < math.cos(TILTED_RAD)

    def _turned_to(self, start_rad: Array, flange: Array) -> Array:
        """A posture whose first joints lead the flange towards a pose (4, 4), and whose last one takes its heading."""
        joints = self._postures.led_to(start_rad, np.array(self._flange_placement(start_rad).translation), flange)
        turn = self._flange_placement(joints).rotation.T @ flange[:3, :3]
        return self._postures.headed(joints, turn)

    def _flange_placement(self, joints_rad: Array) -> pinocchio.SE3:
        pinocchio.forwardKinematics(self.model, self._data, np.asarray(joints_rad, dtype=float))
        return pinocchio.updateFramePlacement(self.model, self._data, self._flange)


class LinkPlaces:
    """An arm whose joints follow one another, with bodies that are fixed to them.

    Args:
        joints: of each body's placement: the joint that carries it.
        placements: joint_from_body of each.
    """

    def __init__(self, model: pinocchio.Model, joints: Sequence[int], placements: Sequence[pinocchio.SE3]) -> None:
        self._moves = [_move(model, number) for number in range(1, model.njoints)]
        self._slides = np.array([slides(model, number) for number in range(1, model.njoints)])
        self._joints = np.array(joints) - 1
        self._placements = np.array([placement.homogeneous for placement in placements])

    def at(self, joints_rad: Array) -> Array:
        """world_from_body (K, L, 4, 4) of L bodies, from joints (K, n)."""
        cosines, sines = np.cos(joints_rad)[..., None, None], np.sin(joints_rad)[..., None, None]
        if self._slides.any():
            sines = np.where(self._slides[:, None, None], joints_rad[..., None, None], sines)
        carried, place = np.empty((len(joints_rad), len(self._moves), 4, 4)), None
        for number, (still, sine, cosine) in enumerate(self._moves):
            moved = still + sine * sines[:, number] + cosine * cosines[:, number]
            place = moved if place is None else place @ moved
            carried[:, number] = place
        placed: Array = carried[:, self._joints] @ self._placements
        return placed


def _move(model: pinocchio.Model, number: int) -> tuple[Array, Array, Array]:
    """How a joint moves: the sum of the first, the second times its sine and the third times its cosine.

    Rodrigues' formula, after the placement of the joint on the one before it; of a sliding joint the second counts
    times how far it is.
    """
    assert model.parents[number] == number - 1
    axis, before = axis_of(model, number), model.jointPlacements[number].homogeneous
    if slides(model, number):
        along = np.zeros((4, 4))
        along[:3, 3] = axis[:3]
        return before, before @ along, np.zeros((4, 4))
    x, y, z = axis[3:]
    cross = np.zeros((4, 4))
    cross[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    square = cross @ cross
    return before @ (np.eye(4) + square), before @ cross, before @ -square
