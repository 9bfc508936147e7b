"""Trained policies as ONNX files: what they see by name, in LeRobot's words, and what they want of the arm.

A file has inputs of these names, of as many numbers as stand here, and an output `action`:

    observation.state, state              the joints in [rad], then the opening of the fingers in [m]
    observation.environment_state, part   where the part is that the robot is after, (x, y, z) in the world in [m]
    target                                where the tool goes, (x, y, z)

An action has as many numbers as the state, joints where the arm goes, or five: a step of the tool as in
`bracket_sim.gymnasium_env`. Several, (k, n), are followed one after the other before the policy is asked again. What
`cell log export --to lerobot` writes has the same names, and so has the environment for Gymnasium.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnxruntime

from bracket_cell.learned.inference.onnx_model import LOAD_ERRORS
from bracket_ground.errors import ModelError
from bracket_ground.files.files import regular
from bracket_ground.interfaces.observation import ArmState, GripperState
from bracket_ground.interfaces.pose import Array

STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"
OF_ENVIRONMENT = ("part_x_m", "part_y_m", "part_z_m")
STEP_N = 5


def of_state(joints: Sequence[str]) -> tuple[str, ...]:
    """What the numbers of a state are, for an arm with joints of these names."""
    return (*(f"{joint}_rad" for joint in joints), "opening_m")


def observed(
    arm: ArmState, gripper: GripperState, part_m: Sequence[float], target_m: Sequence[float]
) -> dict[str, Array]:
    """What a policy sees, by name."""
    state, part = np.array([*arm.positions_rad, gripper.opening_m]), np.array(part_m, np.float64)
    return {STATE: state, "state": state, ENVIRONMENT: part, "part": part, "target": np.array(target_m, np.float64)}


class Policy:
    """A policy that was loaded.

    Attributes:
        sha256: of its file.
    """

    def __init__(self, path: Path, joints: int) -> None:
        """For an arm of so many joints. Raises ModelError: it cannot be read, or sees or answers something else."""
        try:
            content = regular(path).read_bytes()
            self._session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
        except OSError as error:
            raise ModelError(f"{path}: cannot be read: {error.strerror or error}") from None
        except LOAD_ERRORS as error:
            raise ModelError(f"{path}: is no ONNX file that runs here: {str(error).splitlines()[0]}") from None
        self.sha256 = hashlib.sha256(content).hexdigest()
        self._inputs = {one.name: one.shape[-1] for one in self._session.get_inputs()}
        self._path, self._joints = path, joints
        sizes = {
            **dict.fromkeys((STATE, "state"), joints + 1),
            **dict.fromkeys((ENVIRONMENT, "part", "target"), len(OF_ENVIRONMENT)),
        }
        for name, size in self._inputs.items():
            if sizes.get(name) != size:
                legal = ", ".join(f"{known} of {count}" for known, count in sizes.items())
                raise ModelError(f"{path}: wants {name!r} of {size} numbers; legal: {legal}")
        if ACTION not in {one.name for one in self._session.get_outputs()}:
            raise ModelError(f"{path}: has no output {ACTION!r}")

    def actions(self, seen: Mapping[str, Array]) -> Array:
        """What it wants next, (k, n) joints in [rad] or (k, 4) steps; fingers that follow them are left out.

        Raises:
            ModelError: it answers other than that many finite numbers.
        """
        fed = {name: np.asarray(seen[name], np.float32)[None] for name in self._inputs}
        [answer] = self._session.run([ACTION], fed)
        wanted = np.atleast_2d(np.asarray(answer, np.float64)[0] if np.size(answer) else answer)
        size, legal = wanted.shape[-1], (STEP_N, self._joints, self._joints + 1)
        if wanted.ndim != 2 or not len(wanted) or size not in legal or not np.isfinite(wanted).all():
            raise ModelError(f"{self._path}: answers {wanted.tolist()}; legal: rows of {legal} finite numbers")
        return wanted[:, : STEP_N - 1 if size == STEP_N else self._joints]
