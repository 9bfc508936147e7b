"""Intrinsics of a camera: a lens, and the files of other programs that hold one (ROS camera_info, OpenCV FileStorage).

Both are YAML with nearly the same keys: `camera_info_manager` took them from OpenCV's calibration sample.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AliasChoices, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.yaml_file import load_yaml

BROWN = ("plumb_bob", "rational_polynomial")  # distortion models whose first five coefficients are Brown-Conrady's
BROWNS = 5
MATRIX, BENDS = "camera_matrix", "distortion_coefficients"


class Lens(Model):
    """How a camera sees.

    Attributes:
        focal_px: focal length along the image's rows, OpenCV's fx.
        focal_y_px: along its columns, fy; as `focal_px` where it is left out.
        principal_px: the principal point (cx, cy); the image's middle where it is left out.
        distortion_k1, distortion_k2, distortion_k3: radial distortion of the lens as OpenCV counts it (Brown-Conrady);
            0 for undistorted images.
        distortion_p1, distortion_p2: its tangential distortion.
    """

    focal_px: float = Field(ge=10, le=100_000)
    focal_y_px: float | None = Field(default=None, ge=10, le=100_000)
    principal_px: tuple[float, float] | None = None
    distortion_k1: float = Field(default=0.0, ge=-0.5, le=0.5)
    distortion_k2: float = Field(default=0.0, ge=-0.5, le=0.5)
    distortion_p1: float = Field(default=0.0, ge=-0.1, le=0.1)
    distortion_p2: float = Field(default=0.0, ge=-0.1, le=0.1)
    distortion_k3: float = Field(default=0.0, ge=-0.5, le=0.5)

    @staticmethod
    def opencv(matrix: Any, bends: Any) -> Lens:
        """From OpenCV's camera matrix (3, 3) and its coefficients k1, k2, p1, p2, k3.

        Raises:
            ValidationError: a value is beyond what lenses have.
        """
        (fx, _, cx), (_, fy, cy), _ = np.reshape(matrix, (3, 3)).tolist()
        k1, k2, p1, p2, k3 = (float(value) for value in (*np.ravel(bends), *[0.0] * BROWNS)[:BROWNS])
        radial = {"distortion_k1": k1, "distortion_k2": k2, "distortion_k3": k3}
        return Lens(focal_px=fx, focal_y_px=fy, principal_px=(cx, cy), distortion_p1=p1, distortion_p2=p2, **radial)


class _Numbers(Model):
    """A matrix; rows and columns follow from what it is."""

    model_config = ConfigDict(extra="ignore")
    data: tuple[float, ...] = Field(max_length=64)


def _of_list(value: Any) -> Any:
    return {"data": np.ravel(value).tolist() if _even(value) else value} if isinstance(value, list) else value


def _even(value: list[Any]) -> bool:
    """Whether these are numbers, or rows of as many each."""
    return len({len(row) if isinstance(row, list) else 0 for row in value}) == 1


_Matrix = Annotated[_Numbers, BeforeValidator(_of_list)]


class IntrinsicsFile(Model):
    """What is read of such a file.

    Attributes:
        image_width, image_height: of the images that it was made of; 0 where the file has no size.
        camera_matrix: K, nine numbers.
        distortion_model: as ROS names it.
        distortion_coefficients: of the lens; none for undistorted images.
        fisheye_model: whether OpenCV's fisheye model was fitted.
    """

    model_config = ConfigDict(extra="ignore")
    image_width: int = Field(default=0, ge=0, le=100_000, validation_alias=AliasChoices("image_width", "width"))
    image_height: int = Field(default=0, ge=0, le=100_000, validation_alias=AliasChoices("image_height", "height"))
    camera_matrix: _Matrix = Field(validation_alias=AliasChoices(MATRIX, "cameraMatrix", "K", "k"))
    distortion_model: str = BROWN[0]
    distortion_coefficients: _Matrix = Field(
        default=_Numbers(data=()), validation_alias=AliasChoices(BENDS, "dist_coeffs", "distCoeffs", "D", "d")
    )
    fisheye_model: bool = False

    @model_validator(mode="after")
    def _is_a_lens(self) -> IntrinsicsFile:
        matrix, bends = self.camera_matrix.data, self.distortion_coefficients.data
        problems: list[tuple[Location, str]] = []
        if len(matrix) != 9 or matrix[6:] != (0, 0, 1) or matrix[1] != 0 or matrix[3] != 0:
            problems.append(((MATRIX,), "must be fx, 0, cx, 0, fy, cy, 0, 0, 1"))
        if self.fisheye_model or (self.distortion_model not in BROWN and any(bends)):
            what = f"a lens of the model {'fisheye' if self.fisheye_model else self.distortion_model!r} is not known"
            problems.append((("distortion_model",), f"{what}; legal: {', '.join(BROWN)}, or undistorted images"))
        if any(bends[BROWNS:]):
            problems.append(((BENDS,), "only k1, k2, p1, p2, k3 are known, and one behind them is not 0"))
        if not problems:
            problems = self._beyond()
        if problems:
            raise Disagreement(problems)
        return self

    @property
    def lens(self) -> Lens:
        return Lens.opencv(self.camera_matrix.data, self.distortion_coefficients.data)

    def _beyond(self) -> list[tuple[Location, str]]:
        """Values that no lens has."""
        try:
            _ = self.lens
        except ValidationError as error:
            found = [
                (str(typed_dict_type["loc"][0]), typed_dict_type["msg"], typed_dict_type["input"])
                for typed_dict_type in error.errors()
            ]
            where = {name: BENDS if name.startswith("distortion") else MATRIX for name, _, _ in found}
            return [((where[name],), f"{name}: {what[:1].lower()}{what[1:]}, not {got}") for name, what, got in found]
        return []


def with_intrinsics(camera: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A camera's keys with what the file has that its `intrinsics` names; the key itself is empty then.

    Raises:
        Disagreement: keys of the lens stand beside it, or the file is of images of another size.
        InputError: with every problem of the file.
    """
    path = folder / camera["intrinsics"]
    if twice := [name for name in Lens.model_fields if name in camera]:
        raise Disagreement([((name,), f"is in {path}, too: leave out one of them") for name in twice])
    read = load_yaml(path, IntrinsicsFile)
    sizes = {"width_px": read.image_width, "height_px": read.image_height}
    known = {name: size for name, size in sizes.items() if size}
    what = "{} is of images of {} x {} px: calibrate it at the size that is used"
    if other := [name for name, size in known.items() if camera.get(name, size) != size]:
        raise Disagreement([((name,), what.format(path, *sizes.values())) for name in other])
    return {**known, **camera, **read.lens.model_dump(), "intrinsics": None}
