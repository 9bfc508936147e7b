"""Trained policies as ONNX files: what they see by name, in LeRobot's words, and what they want of the arm.

A file has inputs of these names, of as many numbers as stand here, and an output `action` of as many as the state:

    observation.state               six joints in [rad], then the opening of the fingers in [m]
    observation.environment_state   where the part is that the robot is after, (x, y, z) in the world in [m]

What `cell log export --to lerobot` writes has the same names.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnxruntime

from bracket_cell.learned.inference.onnx_model import LOAD_ERRORS
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import JOINTS
from bracket_ground.interfaces.observation import ArmState, GripperState
from bracket_ground.interfaces.pose import Array

STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"
OF_STATE = (*(f"{joint}_rad" for joint in JOINTS), "opening_m")
OF_ENVIRONMENT = ("part_x_m", "part_y_m", "part_z_m")
SIZES = {STATE: len(OF_STATE), ENVIRONMENT: len(OF_ENVIRONMENT)}


def observed(arm: ArmState, gripper: GripperState, part_m: Sequence[float]) -> dict[str, Array]:
    """What a policy sees, by name."""
    return {
        STATE: np.array([*arm.positions_rad, gripper.opening_m]),
        ENVIRONMENT: np.array(part_m, np.float64),
    }


class Policy:
    """A policy that was loaded.

    Attributes:
        sha256: of its file.
    """

    def __init__(self, path: Path) -> None:
        """Raises: ModelError: it cannot be read, or sees or answers something else."""
        try:
            content = path.read_bytes()
            self._session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
        except OSError as error:
            raise ModelError(f"{path}: cannot be read: {error.strerror or error}") from None
        except LOAD_ERRORS as error:
            raise ModelError(f"{path}: is no ONNX file that runs here: {str(error).splitlines()[0]}") from None
        self.sha256 = hashlib.sha256(content).hexdigest()
        self._inputs = {one.name: one.shape[-1] for one in self._session.get_inputs()}
        self._path = path
        for name, size in self._inputs.items():
            if SIZES.get(name) != size:
                legal = ", ".join(f"{known} of {count}" for known, count in SIZES.items())
                raise ModelError(f"{path}: wants {name!r} of {size} numbers; legal: {legal}")
        if ACTION not in {one.name for one in self._session.get_outputs()}:
            raise ModelError(f"{path}: has no output {ACTION!r}")

    def action(self, seen: Mapping[str, Array]) -> Array:
        """The joints (6,) that it wants next in [rad]; an opening of the fingers that follows them is left out.

        Raises:
            ModelError: it answers other than that many finite numbers.
        """
        fed = {name: np.asarray(seen[name], np.float32)[None] for name in self._inputs}
        [answer] = self._session.run([ACTION], fed)
        wanted = np.asarray(answer, np.float64).reshape(-1)
        if len(wanted) not in (len(JOINTS), len(OF_STATE)) or not np.isfinite(wanted).all():
            raise ModelError(
                f"{self._path}: answers {wanted.tolist()}; legal: {len(JOINTS)} or {len(OF_STATE)} numbers"
            )
        return wanted[: len(JOINTS)]
