"""Simulated cameras: they expose on time or when triggered; somebody else makes the image of an exposure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.frame import Frame
from bracket_sim.rendering.photographer import Exposure
from bracket_sim.rendering.studio import ScenePoses, visible_poses
from bracket_sim.scene.look import NOMINAL, Camera
from bracket_sim.scene.world import World

SLACK_S = 1e-6


@dataclass(frozen=True)
class Delivery:
    """How frames come from the sensor to who reads them; `rng` belongs to this camera alone.

    Attributes:
        latency_s: from the closing of the shutter to the driver's copy of the frame.
    """

    look: Camera
    latency_s: float
    rng: np.random.Generator


class SimCamera:
    """Implements `Camera`; free-running at its rate, or one frame for each trigger.

    The shutter of frame k of a free-running camera closes at the first control period at or after k / rate, that of a
    triggered one an exposure after the next control period.

    Attributes:
        watch: called with each exposure that is not lost; nothing by default.
    """

    def __init__(
        self,
        name: str,
        setup: CameraSetup,
        world: World,
        take: Callable[[Exposure], Frame | None],
        delivery: Delivery | None = None,
    ) -> None:
        """A camera of a world.

        Args:
            take: makes frames; may return before the image is ready, return none, and raise DeviceFault.
            delivery: by default every frame comes at once.
        """
        self.watch: Callable[[Exposure], object] = lambda _: None
        self._name, self._setup = name, setup
        self._world, self._take = world, take
        self._delivery = delivery or Delivery(NOMINAL.camera, 0.0, np.random.default_rng(0))
        self._sequence = 0
        self._triggered = False
        self._closes_s: float | None = None if setup.triggered else 0.0
        self._moments: list[ScenePoses] = []
        self._coming: list[tuple[float, Frame]] = []
        self._frame: Frame | None = None
        self._fault: DeviceFault | None = None

    def trigger(self) -> None:
        """Expose at the next control period; ignored by a free-running camera."""
        self._triggered = self._setup.triggered

    def latest(self) -> Frame | None:
        """The newest frame; raises DeviceFault while no more can be made."""
        if self._fault is not None:
            raise self._fault
        return self._frame

    def observe(self, time_s: float, /) -> None:
        """Keep the shutter open where a frame is due, and hand over the frames that have come."""
        exposure_s = self._delivery.look.exposure_s
        if self._triggered and self._closes_s is None:
            self._triggered, self._closes_s = False, time_s + exposure_s
        if self._closes_s is not None and time_s >= self._closes_s - exposure_s - SLACK_S:
            self._world.pose_hand()
            self._moments.append(visible_poses(self._world.data))
            if time_s >= self._closes_s - SLACK_S:
                self._expose(time_s)
        self._hand_over(time_s)

    def _expose(self, time_s: float) -> None:
        moments, self._moments = tuple(self._moments), []
        exposure = Exposure(self._name, self._sequence, time_s, self._world.camera_pose(self._name), moments)
        self._sequence += 1
        self._closes_s = None if self._setup.triggered else self._sequence / self._setup.rate_hz
        look, rng = self._delivery.look, self._delivery.rng
        dropped, late = rng.random() < look.dropped_share, rng.random() < look.late_share
        if dropped:
            return
        self.watch(exposure)
        try:
            frame, self._fault = self._take(exposure), None
        except DeviceFault as fault:  # time goes on without the camera; who asks for a frame is told
            self._fault = fault
            return
        if frame is not None:
            self._coming.append((time_s + self._delivery.latency_s + late * look.late_s, frame))

    def _hand_over(self, time_s: float) -> None:
        """The newest of what has come; a frame that one has overtaken is lost."""
        come = [frame for due_s, frame in self._coming if time_s >= due_s - SLACK_S]
        self._coming = [(due_s, frame) for due_s, frame in self._coming if time_s < due_s - SLACK_S]
        for frame in come:
            if self._frame is None or frame.sequence > self._frame.sequence:
                self._frame = frame
