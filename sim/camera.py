"""Simulated cameras: they expose on time or when triggered; somebody else makes the image of an exposure."""

from __future__ import annotations

from collections.abc import Callable

from cell.interfaces.bench import CameraSetup
from cell.interfaces.errors import DeviceFault
from cell.interfaces.perception import Frame
from sim.photographer import Exposure
from sim.studio import visible_poses
from sim.world import World

SLACK_S = 1e-6


class SimCamera:
    """Implements `Camera`; free-running at its rate, or one frame for each trigger.

    A frame k of a free-running camera is exposed at the first control period at or after k / rate.
    """

    def __init__(self, name: str, setup: CameraSetup, world: World, take: Callable[[Exposure], Frame]) -> None:
        """A camera of a world.

        Args:
            take: makes frames; may return before the image is ready, and raise DeviceFault.
        """
        self._name, self._setup = name, setup
        self._world, self._take = world, take
        self._sequence = 0
        self._triggered = False
        self._frame: Frame | None = None
        self._fault: DeviceFault | None = None

    def trigger(self) -> None:
        """Expose at the next control period; ignored by a free-running camera."""
        self._triggered = self._setup.triggered

    def latest(self) -> Frame | None:
        """The newest frame; raises DeviceFault once no more can be made."""
        if self._fault is not None:
            raise self._fault
        return self._frame

    def observe(self, time_s: float, /) -> None:
        """Expose where a frame is due."""
        due = self._triggered if self._setup.triggered else time_s >= self._sequence / self._setup.rate_hz - SLACK_S
        if due and self._fault is None:
            self._triggered = False
            self._expose(time_s)

    def _expose(self, time_s: float) -> None:
        poses, mount = visible_poses(self._world.data), self._world.camera_pose(self._name)
        try:
            self._frame = self._take(Exposure(self._name, self._sequence, time_s, mount, poses))
        except DeviceFault as fault:  # time goes on without the camera; who asks for a frame is told
            self._fault = fault
        self._sequence += 1
