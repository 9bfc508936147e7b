"""Which part the gripper holds, told by how far apart its fingers are: for a controller that begins with one in it."""

from __future__ import annotations

from cell.interfaces.product import PartType, Product
from skills.grasp_pose import fingertips_m
from skills.grip import Grip
from skills.settings import MotionSettings

GIVES_WAY_M = 0.001  # fingers that hold stand so much closer than the part is wide (measured: 0.3 to 1.7 mm)
TOLERANCE_M = 0.0025
APART_M = 0.001  # two types that fit nearly as well cannot be told apart


def held_type(product: Product, opening_m: float, settings: MotionSettings) -> str | None:
    """The only type that leaves the fingers so far apart; None where there is none, or more than one."""
    misfits = sorted(
        (min(abs(_held_m(kind, grip, settings) - opening_m) for grip in Grip), name)
        for name, kind in product.parts.items()
    )
    (best_m, name), rest = misfits[0], misfits[1:]
    if best_m > TOLERANCE_M or (rest and rest[0][0] - best_m < APART_M):
        return None
    return name


def _held_m(kind: PartType, grip: Grip, settings: MotionSettings) -> float:
    return grip.held_m(kind, fingertips_m(kind, grip, settings)) - GIVES_WAY_M
