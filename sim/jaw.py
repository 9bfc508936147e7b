"""The motor of the simulated gripper: moves the fingers' set point at a speed and presses with a force."""

from __future__ import annotations

from cell.interfaces.observation import ObjectStatus
from sim.robot import FORCE_LIMIT_N, GRIP_DAMPING_NS_M, GRIP_STIFFNESS_N_M, STROKE_M
from sim.world import World

AT_POSITION_M = 0.0012
STILL_M_S = 0.003
SLIPPING_M_S = 0.015  # a grip is lost when the fingers move this fast again
STILL_PERIODS = 4
PRESSING_SHARE = 0.9  # of the requested force, where contact begins
IDLE_CURRENT_A = 0.03
FULL_CURRENT_A = 1.0


class Jaw:
    """A set point that runs towards a target opening, at most `force / stiffness` ahead of the fingers."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._set_point_m = self._target_m = self._last_m = world.opening_m
        self._speed_m_s, self._force_n = 0.1, FORCE_LIMIT_N
        self._still_periods = 0
        self._gripping = False

    def go(self, opening_m: float, speed_m_s: float, force_n: float) -> None:
        """Start a motion."""
        self._target_m = min(max(opening_m, 0.0), STROKE_M)
        self._speed_m_s, self._force_n = speed_m_s, force_n
        self._still_periods, self._gripping = 0, False

    def stop(self) -> None:
        """Stop where the fingers are; what they hold they go on holding."""
        if not self._gripping:
            self._target_m = self._set_point_m = self._world.opening_m

    def update(self, dt_s: float) -> None:
        """Move the set point by one control period."""
        opening = self._world.opening_m
        speed = abs(opening - self._last_m) / dt_s
        self._last_m = opening
        # The servo's damping eats force while the fingers move; only the rest presses.
        lead = (self._force_n + GRIP_DAMPING_NS_M * speed) / GRIP_STIFFNESS_N_M
        step = self._speed_m_s * dt_s
        moved = self._set_point_m + min(max(self._target_m - self._set_point_m, -step), step)
        self._set_point_m = min(max(moved, opening - lead), opening + lead)
        self._world.drive_opening(self._set_point_m)
        self._still_periods = self._still_periods + 1 if speed < STILL_M_S else 0
        pressing = self.force_n >= PRESSING_SHARE * self._force_n and self._still_periods >= STILL_PERIODS
        self._gripping = pressing or (self._gripping and speed < SLIPPING_M_S)

    @property
    def opening_m(self) -> float:
        """Distance between the pads."""
        return self._world.opening_m

    @property
    def force_n(self) -> float:
        """What the motor presses with."""
        return GRIP_STIFFNESS_N_M * abs(self._world.opening_m - self._set_point_m)

    @property
    def status(self) -> ObjectStatus:
        """Register gOBJ."""
        if abs(self._world.opening_m - self._target_m) < AT_POSITION_M:
            return ObjectStatus.AT_POSITION
        if not self._gripping:
            return ObjectStatus.MOVING
        closing = self._target_m < self._world.opening_m
        return ObjectStatus.CONTACT_CLOSING if closing else ObjectStatus.CONTACT_OPENING

    @property
    def current_a(self) -> float:
        """Motor current."""
        return IDLE_CURRENT_A + (FULL_CURRENT_A - IDLE_CURRENT_A) * min(1.0, self.force_n / FORCE_LIMIT_N)
