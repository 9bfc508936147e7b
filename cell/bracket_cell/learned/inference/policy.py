"""Trained policies as ONNX files: what they see by name, in LeRobot's words, and what they want of the arm.

A file has inputs of these names, of as many numbers as stand here, and an output `action`:

    observation.state, state              the joints in [rad], then the opening of the fingers in [m]
    observation.environment_state, part   where the part is that the robot is after, (x, y, z) in the world in [m]
    target                                where the tool goes, (x, y, z)
    observation.images.overhead, .wrist   what a camera sees, (3, height, width) from 0 to 1, in the size that is wanted
    overhead, wrist                       the same, (height, width, 3) from 0 to 255

An action has as many numbers as the state, joints where the arm goes, or five: a step of the tool as in
`bracket_sim.gymnasium_env`. Several, (k, n), are followed one after the other before the policy is asked again. What
`cell log export --to lerobot` writes has the same names, and so has the environment for Gymnasium.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from bracket_cell.learned.inference.onnx_model import LOAD_ERRORS
from bracket_ground.errors import ModelError
from bracket_ground.files.files import regular
from bracket_ground.interfaces.observation import ArmState, GripperState
from bracket_ground.interfaces.pose import Array

IMAGES = "observation.images."
CAMERAS = ("overhead", "wrist")
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
        cameras: whose images it wants.
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
        inputs = {input_.name: input_.shape for input_ in self._session.get_inputs()}
        self._bytes = {input_.name for input_ in self._session.get_inputs() if input_.type == "tensor(uint8)"}
        self._images = {name: shape for name, shape in inputs.items() if name.removeprefix(IMAGES) in CAMERAS}
        self.cameras = tuple(dict.fromkeys(name.removeprefix(IMAGES) for name in self._images))
        self._inputs = {name: shape[-1] for name, shape in inputs.items() if name not in self._images}
        self._path, self._joints = path, joints
        for name, shape in self._images.items():
            if len(shape) != 4 or shape[1 if name.startswith(IMAGES) else 3] != 3:
                legal = "(1, 3, height, width)" if name.startswith(IMAGES) else "(1, height, width, 3)"
                raise ModelError(f"{path}: wants {name!r} of shape {shape}; legal: {legal}")
        sizes = {
            **dict.fromkeys((STATE, "state"), joints + 1),
            **dict.fromkeys((ENVIRONMENT, "part", "target"), len(OF_ENVIRONMENT)),
        }
        for name, size in self._inputs.items():
            if sizes.get(name) != size:
                legal = ", ".join(f"{known} of {count}" for known, count in sizes.items())
                legal += f", and images: {', '.join((*(IMAGES + camera for camera in CAMERAS), *CAMERAS))}"
                raise ModelError(f"{path}: wants {name!r} of {size} numbers; legal: {legal}")
        if ACTION not in {output.name for output in self._session.get_outputs()}:
            raise ModelError(f"{path}: has no output {ACTION!r}")

    def actions(self, seen: Mapping[str, Array], images: Mapping[str, NDArray[np.uint8]] | None = None) -> Array:
        """What it wants next, (k, n) joints in [rad] or (k, 4) steps; fingers that follow them are left out.

        Args:
            seen: as of `observed`.
            images: (height, width, 3) RGB by camera, of all its cameras.

        Raises:
            ModelError: it answers other than that many finite numbers.
        """
        fed = {name: np.asarray(seen[name], np.float32)[None] for name in self._inputs}
        fed |= {name: self._image(name, (images or {})[name.removeprefix(IMAGES)]) for name in self._images}
        try:
            [answer] = self._session.run([ACTION], fed)
        except (ValueError, *LOAD_ERRORS) as error:
            raise ModelError(f"{self._path}: {str(error).splitlines()[0]}") from None
        wanted = np.atleast_2d(np.asarray(answer, np.float64)[0] if np.size(answer) else answer)
        size, legal = wanted.shape[-1], (STEP_N, self._joints, self._joints + 1)
        if wanted.ndim != 2 or not len(wanted) or size not in legal or not np.isfinite(wanted).all():
            raise ModelError(f"{self._path}: answers {wanted.tolist()}; legal: rows of {legal} finite numbers")
        return wanted[:, : STEP_N - 1 if size == STEP_N else self._joints]

    def _image(self, name: str, image: NDArray[np.uint8]) -> NDArray[np.generic]:
        """An image as an input wants it, with one more axis before; sides that the file leaves open stay."""
        first = name.startswith(IMAGES)
        sides = self._images[name][2:] if first else self._images[name][1:3]
        height, width = (
            side if isinstance(side, int) else there for side, there in zip(sides, image.shape[:2], strict=True)
        )
        sized: NDArray[np.generic] = image
        if image.shape[:2] != (height, width):
            sized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        if not first:
            return sized.astype(np.uint8 if name in self._bytes else np.float32)[None]
        return np.ascontiguousarray(sized.transpose(2, 0, 1)[None]).astype(np.float32) / np.float32(255.0)
