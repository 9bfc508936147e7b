"""f_i of the paper: features of the crop around each detected part, which shows what stands in its way.

A crop is cut from the wrist image at a fixed scale, its rows along the part's x axis. With it goes from where each
pixel was seen, as bodies lean in the image away from the camera. A small network turns it into the embedding of the
detection (lab/bracket_lab/learned/grasp/paper.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.grasp.boxes import Boxes
from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetection, PartDetector
from bracket_ground.interfaces.pose import Array, Pose

CROP_PX, STEP_M = 48, 0.003  # 14 cm: the part with the room of fingers and palm
CHANNELS = 5  # colours, and how far the line of sight leans along the part's x and y axis
EMBEDDING = 32  # features of a crop
CROPS_KIND = "grasp.crops"
_FINER = 2  # times finer sampled, then averaged

Crops = NDArray[np.uint8]  # (n, CHANNELS, CROP_PX, CROP_PX), one for each detection
View = tuple[Boxes, tuple[PartDetection, ...]]  # what stands in the tray, and where it was detected
TrayCamera = Callable[[Sequence[View]], list[Crops]]  # images of views, cut to crops


def crops_of(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, parts: Sequence[PartDetection]
) -> Crops:
    """Crops of all detections; x of the part runs to the right."""
    found = [_crop(image, camera, world_from_camera, part.world_from_part) for part in parts]
    return np.array(found, np.uint8).reshape(-1, CHANNELS, CROP_PX, CROP_PX)


def _crop(image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, part: Pose) -> NDArray[np.uint8]:
    pixels = CROP_PX * _FINER
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (pixels - 1) / 2 * STEP_M / _FINER
    cos, sin = np.cos(part.yaw_rad), np.sin(part.yaw_rad)
    places: Array = np.column_stack([corners @ np.array([[cos, sin], [-sin, cos]]), np.zeros(4)])
    seen = camera.project(world_from_camera, places + np.array(part.position_m)).astype(np.float32)
    own = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (pixels - 1)).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    turn = cv2.getPerspectiveTransform(own, seen)
    fine = cv2.warpPerspective(image, turn, (pixels, pixels), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    crop = cv2.resize(fine, (CROP_PX, CROP_PX), interpolation=cv2.INTER_AREA)
    return np.concatenate([np.asarray(crop, np.uint8).transpose(2, 0, 1), _leaning(world_from_camera, part)])


def _leaning(world_from_camera: Pose, part: Pose) -> NDArray[np.uint8]:
    """(2, CROP_PX, CROP_PX): from each place to the camera, along the part's x and y axis, for each metre upwards.

    From -1 to 1 as bytes from 0 to 255.
    """
    eye = Pose.from_yaw(part.position_m, part.yaw_rad).inverse() @ world_from_camera
    place = (np.arange(CROP_PX) - (CROP_PX - 1) / 2) * STEP_M
    x, y, height = eye.position_m
    lean = np.stack(np.meshgrid((x - place) / height, (y - place) / height))
    return np.asarray(np.clip(np.round(127.5 * (1 + lean)), 0, 255), np.uint8)


def with_embeddings(parts: tuple[PartDetection, ...], crops: Crops, network: Network) -> tuple[PartDetection, ...]:
    """The detections with features of their crops."""
    if not parts:
        return parts
    found = network.run({"crops": crops})["embedding"]
    return tuple(
        replace(part, embedding=tuple(round(float(value), 4) for value in row))
        for part, row in zip(parts, found, strict=True)
    )


class CropReader:
    """A part detector whose detections have embeddings (PartDetector)."""

    def __init__(self, detector: PartDetector, bench: Bench, network: Network) -> None:
        self._detector, self._network = detector, network
        self._camera = bench.wrist.model

    @staticmethod
    def load(detector: PartDetector, bench: Bench, path: Path) -> CropReader:
        """Read the network.

        Raises:
            ModelError: the file is missing, damaged or of another kind.
        """
        return CropReader(detector, bench, load_crops(path))

    def detect(self, frame: Frame) -> tuple[PartDetection, ...]:
        """What the detector finds, each with features of its crop."""
        parts = self._detector.detect(frame)
        return with_embeddings(
            parts, crops_of(frame.image, self._camera, frame.world_from_camera, parts), self._network
        )


def load_crops(path: Path) -> OnnxModel:
    """The network that turns crops into embeddings.

    Raises:
        ModelError: the file is missing, damaged or of another kind.
    """
    model = OnnxModel.load(path, CROPS_KIND)
    try:
        answer = model.run({"crops": np.zeros((1, CHANNELS, CROP_PX, CROP_PX), np.uint8)})
    except ModelError as error:
        raise ModelError(
            f"{path}: was trained on crops of another version; train it again: `cell train --only grasp`"
        ) from error
    if answer["embedding"].shape != (1, EMBEDDING):
        raise ModelError(f"{path}: {answer['embedding'].shape[1]} features of a crop, not {EMBEDDING}")
    return model
