"""Physical quantities of configuration files, each with the range that makes sense at one bench."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field

Coordinate = Annotated[float, Field(ge=-10, le=10)]
"""Of a point at the bench, in [m]."""
Length = Annotated[float, Field(gt=0, le=2)]
"""Of a thing at the bench, in [m]."""
Side = Annotated[float, Field(ge=0.001, le=2)]
"""Of a part's body or a plate, in [m]; what is thinner is neither held nor seen."""
Gap = Annotated[float, Field(ge=0, le=1)]
"""Room between two things, in [m]."""
JointAngle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]
"""Of a joint, a whole turn each way at most, in [rad], of a linear axis in [m]; the robot's file has its range."""
Channel = Annotated[float, Field(ge=0, le=1)]
"""Of a colour."""
Duration = Annotated[float, Field(gt=0, le=86_400)]
"""In [s], one day at most."""

Point = tuple[Coordinate, Coordinate, Coordinate]
Joints = tuple[JointAngle, ...]
Rgb = tuple[Channel, Channel, Channel]


def _is_unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = math.sqrt(sum(value * value for value in quaternion))
    if not 0.999 < norm < 1.001:
        raise ValueError(f"must be a unit quaternion; its norm is {norm:.4g}")
    return quaternion


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_is_unit)]
"""(w, x, y, z), of norm 1."""
