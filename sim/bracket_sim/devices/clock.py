"""The simulator's clock: sleeping is what advances the world, in lock-step with all its devices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from bracket_sim.scene.world import World

SLACK_S = 1e-6  # a deadline this close after a control period is that period


class Actor(Protocol):
    """Something that acts once in every control period."""

    def update(self, time_s: float, dt_s: float) -> None:
        """Act at `time_s`; the next call comes `dt_s` later."""
        ...


class Observer(Protocol):
    """Something that looks at the world after every control period."""

    def observe(self, time_s: float, /) -> None:
        """Look at the world as it is at `time_s`."""
        ...


class SimClock:
    """Time since the run began, in whole control periods.

    Args:
        actors: set their controls before physics advances, in this order.
        observers: look at the world after it has advanced, and once at the beginning.
        samplers: look at it within control periods, too, as often as the arm measures its joints.
    """

    def __init__(
        self, world: World, actors: Sequence[Actor], observers: Sequence[Observer], samplers: Sequence[Observer] = ()
    ) -> None:
        self._world = world
        self._actors, self._observers, self._samplers = actors, observers, samplers
        self._period_s = world.physics.control_period_s
        self._sample_s = world.physics.sample_period_s
        self._samples = round(self._period_s / self._sample_s)
        self._periods = 0
        self._observe()

    def now_s(self) -> float:
        """Simulated seconds since the run began."""
        return self._periods * self._period_s

    def sleep_until(self, time_s: float) -> None:
        """Advance to the first control period at or after `time_s`."""
        last = math.ceil((time_s - SLACK_S) / self._period_s)
        while self._periods < last:
            for actor in self._actors:
                actor.update(self.now_s(), self._period_s)
            self._step()
            self._periods += 1
            self._observe()

    def _step(self) -> None:
        if not self._samplers:
            self._world.step_period()
            return
        for number in range(self._samples):
            self._world.step_sample()
            for sampler in self._samplers:
                sampler.observe(self.now_s() + (number + 1) * self._sample_s)

    def _observe(self) -> None:
        for observer in self._observers:
            observer.observe(self.now_s())
