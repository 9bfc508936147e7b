"""Fingers of a twin for tests: ideal, moved by a clock that waits for the driver, with a part between them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from bracket_ground.interfaces.clock import Clock

ACTIVATION_S = 0.2
STEP_S = 0.04
PATIENCE_S = 0.1  # of the wall, for an answer


class AnsweredClock:
    """A clock that goes on by steps, once the driver has heard of the step before or hears nothing.

    Attributes:
        answered: how many answers the driver had.
    """

    def __init__(self) -> None:
        self._time_s = 0.0
        self.answered: Callable[[], int] = lambda: 0

    def now_s(self) -> float:
        return self._time_s

    def sleep_until(self, time_s: float) -> None:
        while self._time_s < time_s - 1e-9:
            self._time_s += min(STEP_S, time_s - self._time_s)
            known, end_s = self.answered(), time.monotonic() + PATIENCE_S
            while self.answered() < known + 2 and time.monotonic() < end_s:
                time.sleep(0.0005)


class IdealFingers:
    """Implements `bracket_sim.twin.gripper.Fingers`.

    Attributes:
        part_m: width of the part between the fingers, None for none.
        fault: register gFLT.
        requests: as they came.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock, self._last_s = clock, clock.now_s()
        self.part_m: float | None = None
        self.fault = 0
        self.requests: list[Mapping[str, float]] = []
        self._request: Mapping[str, float] = {"rACT": 0, "rGTO": 0, "rPR": 85.0, "rSP": 20.0}
        self._opening_mm, self._active_s = 60.0, 0.0

    def write(self, request: Mapping[str, float]) -> Mapping[str, float]:
        self._go_on()
        if request["rACT"] and not self._request["rACT"]:
            self._active_s = self._clock.now_s() + ACTIVATION_S
        self._request = request
        self.requests.append(request)
        return request

    def registers(self) -> Mapping[str, float]:
        self._go_on()
        request = self._request
        return {
            "gACT": request["rACT"],
            "gGTO": request["rGTO"],
            "gSTA": (3 if self._active else 1) if request["rACT"] else 0,
            "gOBJ": self._object_status(),
            "gFLT": self.fault,
            "gPO": self._opening_mm,
            "gCU": 0.1,
        }

    @property
    def _active(self) -> bool:
        return bool(self._request["rACT"]) and self._clock.now_s() >= self._active_s

    @property
    def _stop_mm(self) -> float:
        goal = self._request["rPR"]
        if self.part_m is None or self._opening_mm < 1000 * self.part_m - 1e-6:
            return goal
        return max(goal, 1000 * self.part_m)

    def _go_on(self) -> None:
        now_s = self._clock.now_s()
        step = self._request["rSP"] * (now_s - self._last_s)
        self._last_s = now_s
        if self._active and self._request["rGTO"]:
            self._opening_mm += min(max(self._stop_mm - self._opening_mm, -step), step)

    def _object_status(self) -> int:
        if not (self._active and self._request["rGTO"]) or abs(self._opening_mm - self._stop_mm) > 1e-6:
            return 0
        return 3 if abs(self._stop_mm - self._request["rPR"]) < 1e-6 else 2
