"""Which share of its speed a path may have under the limits of a controller's safety configuration.

A controller that sees a limit broken stops the arm; a driver that knows the limits slows down on the path before.
"""

from __future__ import annotations

import numpy as np
import pinocchio

from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import MotionLimits, RobotModel
from bracket_ground.interfaces.urdf import FLANGE

STEP_S = 0.02
AHEAD_S = 1.0  # of the path, in which an arm slows down for what comes
KEPT = 0.9  # of a limit: joints swing about their set points


class SpeedLimits:
    """The arm and what its controller limits, by the mode that it tells; momentum with the heaviest part."""

    def __init__(self, robot: RobotModel) -> None:
        self._limits = {"normal": robot.safety.normal, "reduced": robot.safety.reduced}
        self._model = pinocchio.buildModelFromXML(robot.urdf_text)
        self._data, self._flange = self._model.createData(), self._model.getFrameId(FLANGE)
        self._elbow = (self._model.nq + 1) // 2
        self._tool_m, self._tool_kg = robot.gripper.tcp_from_flange_m, robot.gripper.loaded_kg

    def shares(self, path: JointTrajectory) -> dict[str, Array]:
        """Of a path's own speed, the most (m,) at each of its steps, by mode."""
        marks_s: Array = np.arange(path.duration_s // STEP_S + 2, dtype=np.float64) * STEP_S
        joints = path.along(marks_s)
        speeds = np.gradient(joints, STEP_S, axis=0) if len(joints) > 1 else np.zeros_like(joints)
        moved = np.array([self._moved(at, speed) for at, speed in zip(joints, speeds, strict=True)])
        return {mode: _shares(limits, np.abs(speeds), moved) for mode, limits in self._limits.items()}

    def _moved(self, joints: Array, speeds: Array) -> Array:
        """(3,) speeds of tool and elbow, momentum."""
        pinocchio.computeCentroidalMomentum(self._model, self._data, joints, speeds)
        flange = pinocchio.getFrameVelocity(
            self._model, self._data, self._flange, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        axis = pinocchio.updateFramePlacement(self._model, self._data, self._flange).rotation[:, 2]
        tool = flange.linear + np.cross(flange.angular, axis * self._tool_m)
        elbow, momentum = self._data.v[self._elbow].linear, self._data.hg.linear + self._tool_kg * tool
        return np.array([np.linalg.norm(moved) for moved in (tool, elbow, momentum)])


def share_at(shares: Array, path_s: float) -> float:
    """The least share on the way ahead of a place on the path."""
    first = min(int(path_s / STEP_S), len(shares) - 1)
    return float(shares[first : first + round(AHEAD_S / STEP_S)].min())


def _shares(limits: MotionLimits, speeds: Array, moved: Array) -> Array:
    most = [limits.tool_m_s, limits.elbow_m_s, limits.momentum_kg_m_s]
    asked = np.hstack([speeds, moved])
    allowed = np.array([*(limits.joint_rad_s or [None] * speeds.shape[1]), *most], dtype=float)
    allowed = KEPT * np.where(np.isnan(allowed), np.inf, allowed)
    found: Array = np.minimum(1.0, (allowed / np.maximum(asked, 1e-9)).min(axis=1))
    return found
