"""An arm without physics: it follows paths, brakes and tells its state as a UR10 does, or disobeys as it is told to."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import ArmState
from bracket_ground.interfaces.pose import Array

CYCLE_S, TRAILS_CYCLES, LATENCY_CYCLES = 0.008, 4, 2
LIMITS_RAD_S2 = np.array([5.0, 5.0, 6.0, 8.0, 8.0, 8.0])
NOISE_RAD, NOISE_RAD_S = 4e-5, 1e-3


@dataclass
class PathArm:
    """Moves by whole cycles.

    Attributes:
        faster: times the share that it was told.
        heeds: it does as `pace` and `stop` say.
        tells_path: it knows how far along its path it is.
        drifts_rad_s: the base turns by itself.
    """

    positions_rad: Array
    faster: float = 1.0
    heeds: bool = True
    tells_path: bool = True
    drifts_rad_s: float = 0.0
    time_s: float = 0.0
    _path: JointTrajectory | None = None
    _place_s: float = 0.0
    _rate: float = 0.0
    _share: float = 1.0
    _stopping: bool = False
    _orders: deque[tuple[int, str, object]] = field(default_factory=deque)
    _cycle: int = 0
    _places: deque[tuple[float | None, Array]] = field(default_factory=lambda: deque(maxlen=TRAILS_CYCLES))
    _drift_rad: float = 0.0
    _rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def __post_init__(self) -> None:
        self._places.append((None, self.positions_rad.copy()))

    def order(self, what: str, value: object = None) -> None:
        """Send `follow`, `pace` or `stop`, which arrive a little later."""
        self._orders.append((self._cycle + LATENCY_CYCLES, what, value))

    def advance(self, until_s: float) -> None:
        """Let cycles pass."""
        while self.time_s < until_s - CYCLE_S / 2:
            while self._orders and self._orders[0][0] <= self._cycle:
                self._obey(*self._orders.popleft()[1:])
            self._step()
            self._cycle += 1
            self.time_s = self._cycle * CYCLE_S

    def _obey(self, what: str, value: object) -> None:
        if what == "follow":
            assert isinstance(value, JointTrajectory)
            self._path, self._place_s, self._stopping = value, 0.0, False
            self._rate = self._share
            self._places = deque([(0.0, joints) for _, joints in self._places], maxlen=TRAILS_CYCLES)
        elif what == "pace" and self.heeds:
            assert isinstance(value, float)
            self._share = value
        elif what == "stop" and self.heeds:
            self._stopping = True

    def _step(self) -> None:
        self._drift_rad += self.drifts_rad_s * CYCLE_S
        if self._path is not None:
            wanted = 0.0 if self._stopping else self._share
            before, here, after = self._path.along(self._place_s + CYCLE_S * np.array([-1.0, 0.0, 1.0]))
            speeds, bends = (after - before) / (2 * CYCLE_S), (after - 2 * here + before) / CYCLE_S**2
            fastest = np.maximum(np.abs(speeds), 1e-3)
            limits, along = LIMITS_RAD_S2 / fastest, bends * np.sign(speeds) * self._rate**2 / fastest
            slowest = 0.5 * limits.min()
            brake, hasten = max((limits + along).min(), slowest), max((limits - along).min(), slowest)
            self._rate += min(max(wanted - self._rate, -brake * CYCLE_S), hasten * CYCLE_S)
            self._place_s += self._rate * self.faster * CYCLE_S
            self.positions_rad = self._path.at(self._place_s)
            if self._place_s >= self._path.duration_s or (self._stopping and self._rate <= 0):
                self._path = None
        self._places.append((None if self._path is None else self._place_s, self.positions_rad.copy()))

    def state(self) -> ArmState:
        """Joints trail by some cycles, and so does the place on the path."""
        (place_s, joints), (_, following) = self._places[0], self._places[min(1, len(self._places) - 1)]
        on_way = any(what == "follow" for _, what, _ in self._orders)
        speeds = (following - joints) / CYCLE_S + NOISE_RAD_S * self._rng.normal(size=6)
        speeds[0] += self.drifts_rad_s
        told = joints + NOISE_RAD * self._rng.normal(size=6)
        told[0] += self._drift_rad
        moving = on_way or self._path is not None or place_s is not None
        path_s = 0.0 if on_way else place_s
        return ArmState(
            self.time_s,
            tuple(told.tolist()),
            tuple(speeds.tolist()),
            moving,
            path_s=path_s if moving and self.tells_path else None,
        )

    @property
    def true_rad(self) -> Array:
        """Where the joints really are."""
        joints = self._places[0][1].copy() if self._places else self.positions_rad.copy()
        joints[0] += self._drift_rad
        return joints
