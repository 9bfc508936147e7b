"""How far the robot really is from the person, and how far it should be: an oracle from the simulator's truth.

It knows the protective distance of ISO/TS 15066 with a constant speed of the hand, and nothing that the cell works out.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array
from bracket_sim.cell import SimCell
from bracket_sim.scene import palette

DRIVEN_M_S = 0.05  # a slower arm stands
FAST_M_S, BESIDE_M = 0.35, 0.10  # the reduced speed with what its reckoning is off by; a hand's length
HANDS_M_S = (1.6, 2.0)  # v_h: ISO 13855 for somebody who walks, and for a hand within 0.5 m
REACTS_S = 0.25  # T_r: until a frame is exposed and answered, a tick, and the arm's own cycle
BRAKES_M_S2 = 1.6  # of the arm's point, from the reduced speed: T_s and S_s


class TrueDistance:
    """Distance and protective distance of the robot's and the person's shapes, in the simulator's world."""

    def __init__(self, cell: SimCell) -> None:
        self._cell, self._model, self._data = cell, cell.world.model, cell.world.data
        touch = list(zip(self._model.geom_contype, self._model.geom_conaffinity, strict=True))
        self._skin = self._of(touch, palette.SKIN_TOUCH)
        self._robot = np.concatenate([self._of(touch, one) for one in (palette.ROBOT_TOUCH, palette.HAND_ONLY_TOUCH)])

    def breached(self) -> tuple[bool, ...]:
        """For each of HANDS_M_S, whether a link is nearer than S_p = v_h (T_r + T_s) + v_r T_r + S_s and moves."""
        found = np.zeros(len(HANDS_M_S), dtype=bool)
        if not np.abs(self._cell.arm.driven_rad_s).max() > 0:
            return tuple(found)
        for geom in self._robot:
            speed_m_s = self._speed_m_s(int(geom))
            if speed_m_s > DRIVEN_M_S:
                found |= self._nearest_m(int(geom), float(protective_m(speed_m_s).max())) < protective_m(speed_m_s)
        return tuple(bool(one) for one in found)

    def too_fast(self) -> str:
        """That a link is faster beside the person than an arm may be that is slow before a hand arrives, in words."""
        for geom in self._robot:
            speed_m_s = self._speed_m_s(int(geom))
            near_m = self._nearest_m(int(geom), BESIDE_M) if speed_m_s > FAST_M_S else BESIDE_M
            if near_m < BESIDE_M:
                return f"the arm moves at {speed_m_s:.2f} m/s, {near_m:.2f} m from a person"
        return ""

    def _of(self, touch: list[tuple[int, int]], wanted: tuple[int, int]) -> NDArray[np.intp]:
        return np.array([geom for geom, one in enumerate(touch) if tuple(map(int, one)) == wanted], dtype=np.intp)

    def _speed_m_s(self, geom: int) -> float:
        """Of the shape's fastest point, at most: driven by the arm's servos."""
        model, driven = self._model, self._cell.arm.driven_rad_s
        moves, turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        body, arm = int(model.geom_bodyid[geom]), self._cell.world.arm_qvel
        mujoco.mj_jac(model, self._data, moves, turns, self._data.geom_xpos[geom], body)
        spin = float(np.linalg.norm(turns[:, arm] @ driven)) * float(model.geom_rbound[geom])
        return float(np.linalg.norm(moves[:, arm] @ driven)) + spin

    def _nearest_m(self, geom: int, most_m: float) -> float:
        """From a shape of the robot to the person; `most_m` where it is farther."""
        near_m, ends = most_m, np.zeros(6)
        centres, bounds = self._data.geom_xpos, self._model.geom_rbound
        apart = np.linalg.norm(centres[self._skin] - centres[geom], axis=1) - bounds[self._skin] - bounds[geom]
        for other in self._skin[apart < near_m]:
            near_m = min(near_m, mujoco.mj_geomDistance(self._model, self._data, geom, int(other), near_m, ends))
        return near_m


def protective_m(arm_m_s: float) -> Array:
    """S_p of ISO/TS 15066 for each of HANDS_M_S; positions are exact here, so C, Z_d and Z_r are 0."""
    stops_s = arm_m_s / BRAKES_M_S2
    hands_m = np.array(HANDS_M_S) * (REACTS_S + stops_s)
    return hands_m + arm_m_s * (REACTS_S + stops_s / 2)
