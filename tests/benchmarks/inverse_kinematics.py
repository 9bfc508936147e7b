"""Inverse kinematics beside a peer in one run: this cell's on Pinocchio, and placo's solver from the same starts.

Targets are the tool's poses at joints drawn at random from the arm's whole range, each answered from the posture that
the cell begins with. Prints the share that is answered within a tenth of a millimetre and of a milliradian, the median
time, and the ratio of times, as JSON.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio
import placo
from lxml import etree

from bracket_cell.skills.motion.kinematics import MOST_STEPS, Kinematics
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.robot import default_robot
from bracket_ground.interfaces.urdf import FLANGE

TOLERANCE = 1e-4  # [m] and [rad]
REGULARISATION = 1e-6  # by placo's own examples


class Placo:
    """placo's solver of an arm without its meshes."""

    def __init__(self, urdf_text: str, tool_from_flange: Pose) -> None:
        root = etree.fromstring(urdf_text.encode())
        for shape in root.xpath("//visual | //collision"):
            shape.getparent().remove(shape)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_bytes(etree.tostring(root))
            self._robot = placo.RobotWrapper(str(path))
        self._tool_from_flange, self._names = tool_from_flange, list(self._robot.joint_names())
        self._solver = self._robot.make_solver()
        self._solver.mask_fbase(True)
        self._task = self._solver.add_frame_task(FLANGE, np.eye(4))
        self._task.configure("flange", "soft", 1.0, 1.0)
        self._solver.add_regularization_task(REGULARISATION)

    def solved(self, world_from_tool: Pose, start_rad: Array) -> Array | None:
        """As `Kinematics.solved`."""
        target = (world_from_tool @ self._tool_from_flange).matrix
        self._task.T_world_frame = target
        for name, value in zip(self._names, start_rad.tolist(), strict=True):
            self._robot.set_joint(name, value)
        for _ in range(MOST_STEPS):
            self._robot.update_kinematics()
            if _off(self._robot.get_T_world_frame(FLANGE), target) < TOLERANCE:
                return np.array([self._robot.get_joint(name) for name in self._names])
            self._solver.solve(True)
        return None


def _off(reached: Array, wanted: Array) -> float:
    """How far a pose (4, 4) is off, the largest of [m] and [rad]."""
    return float(np.abs(pinocchio.log6(pinocchio.SE3(reached).actInv(pinocchio.SE3(wanted))).vector).max())


def measured(
    kinematics: Kinematics, solve: Callable[[Pose, Array], Array | None], targets: list[Pose]
) -> dict[str, float]:
    """The share of targets that are answered, and the median time [us]."""
    answered, times_s = 0, []
    for target in targets:
        start_rad = kinematics.turned_to(kinematics.usual_rad, target)
        begin_s = time.perf_counter()
        joints = solve(target, start_rad)
        times_s.append(time.perf_counter() - begin_s)
        answered += joints is not None and _off(kinematics.forward(joints).matrix, target.matrix) < 2 * TOLERANCE
    return {"answered": answered / len(targets), "median_us": 1e6 * statistics.median(times_s)}


def main() -> None:
    """Print both and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    kinematics, robot = Kinematics(), default_robot()
    least, most = kinematics.limits_rad
    flange = Pose((0.0, 0.0, robot.gripper.tcp_from_flange_m)).inverse()
    drawn = np.random.default_rng(options.seed).uniform(least, most, (options.poses, kinematics.count))
    targets = [kinematics.forward(joints) for joints in drawn]
    own, peer = (
        measured(kinematics, solve, targets) for solve in (kinematics.solved, Placo(robot.urdf_text, flange).solved)
    )
    ratio = own["median_us"] / peer["median_us"]
    print(json.dumps({"poses": options.poses, "pinocchio": own, "placo": peer, "times_of_placo": ratio}))


if __name__ == "__main__":
    main()
