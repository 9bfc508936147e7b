"""Keeps every sample that an arm's controller sends, in a thread of its own, and connects again where it hangs up."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from bracket_ground.errors import DeviceFault, words_of
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.observation import ArmMode
from bracket_ground.interfaces.pose import Array

AGAIN_S, NEWEST_S = 0.2, 2.0
KEPT = 4096
SHIFTED_S, SHIFTED_FOR_S = 0.05, 0.1  # samples that are so late for so long: the controller's clock lost time


@dataclass(frozen=True, eq=False)
class Sample:
    """What a controller told at one of its cycles, of n joints.

    Attributes:
        time_s: by the controller's clock, wherever that begins; of the run's clock once it was received.
        positions_rad, velocities_rad_s, moments_nm: (n,); moments as the controller reckons them.
        mode: why the arm must not move, or normal, or reduced.
        reason: the same in words; empty in the latter two.
        takes: its program takes set points; asked only once a link was made.
        speed_share: what its pendant leaves of all speeds.
        force_n: (3,) that pushes the tool, in the world.
    """

    time_s: float
    positions_rad: Array
    velocities_rad_s: Array
    moments_nm: Array
    mode: ArmMode = "normal"
    reason: str = ""
    takes: bool = True
    speed_share: float = 1.0
    force_n: Array = field(default_factory=lambda: np.zeros(3))


class Stamped(Protocol):
    """Something that a controller told at a time, by its own clock; a frozen dataclass."""

    @property
    def time_s(self) -> float: ...


Told = TypeVar("Told", bound=Stamped)
Told_co = TypeVar("Told_co", bound=Stamped, covariant=True)


class Connection(Protocol[Told_co]):
    """A connection on which a controller tells samples.

    Attributes:
        period_s: in which the controller wants set points.
    """

    period_s: float

    def receive(self) -> Told_co:
        """The next sample; raises OSError where none comes in time."""
        ...

    def close(self) -> None:
        """Hang up; who waits for a sample wakes up."""
        ...


class SampleReceiver(Generic[Told]):
    """Receives in a thread of its own; whatever a connection raises is trouble, and a reason to connect again.

    Attributes:
        period_s: of the controller.
        trouble: why nothing comes; empty while samples come.

    Args:
        at: where the controller is, for messages.
        device: whose faults these are.

    Raises:
        DeviceFault: the controller cannot be reached.
    """

    def __init__(
        self, connect: Callable[[], Connection[Told]], clock: Clock, at: str, slower: float = 1.0, device: str = "arm"
    ) -> None:
        self._device, self._at, self._connect = device, at, connect
        self._clock, self._limit_s = clock, NEWEST_S * slower
        self._late_s: float | None = None  # since when all samples have been late
        self._samples: deque[Told] = deque(maxlen=KEPT)
        self._newest: Told | None = None
        self._offset_s, self._stamp_s = float("inf"), 0.0
        self._ended, self._came = threading.Event(), threading.Condition()
        self.trouble = ""
        try:
            self._connection = connect()
        except OSError as error:
            raise DeviceFault(device, f"no controller answers at {at}: {words_of(error)}") from None
        self.period_s = self._connection.period_s
        self._thread = threading.Thread(target=self._run, name="samples of the arm", daemon=True)
        self._thread.start()

    @property
    def newest(self) -> Told:
        """The newest sample; raises DeviceFault where none ever came."""
        with self._came:
            if self._newest is None:
                self._came.wait_for(lambda: self._newest is not None, self._limit_s)
            if self._newest is None:
                raise DeviceFault(self._device, f"{self._at} tells nothing: {self.trouble or 'no sample came'}")
            return self._newest

    def taken(self) -> list[Told]:
        """All samples since the last call, in order."""
        samples = list[Told]()
        while self._samples:
            samples.append(self._samples.popleft())
        return samples

    def close(self) -> None:
        """Receive no more."""
        self._ended.set()
        self._connection.close()
        self._thread.join(self._limit_s)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._keep(self._connection.receive())
                self.trouble = ""
            except Exception as error:  # the outermost loop: a stranger's connection may raise anything
                self.trouble = words_of(error)
                self._connection.close()
                self._connect_again()

    def _connect_again(self) -> None:
        while not self._ended.wait(AGAIN_S / 10):
            try:
                self._connection = self._connect()
            except Exception as error:  # likewise
                self.trouble = words_of(error)
                self._ended.wait(AGAIN_S)
            else:
                return

    def _keep(self, sample: Told) -> None:
        time_s = self._time_s(sample.time_s)
        if self._newest is not None and time_s <= self._newest.time_s:
            return
        with self._came:
            self._newest = replace(sample, time_s=time_s)  # type: ignore[type-var]
            self._samples.append(self._newest)
            self._came.notify_all()

    def _time_s(self, timestamp_s: float) -> float:
        """The run's time of a sample: packages come late, never early, so the least delay is none."""
        now_s = self._clock.now_s()
        offset_s, restarted = now_s - timestamp_s, timestamp_s < self._stamp_s
        late = offset_s > self._offset_s + SHIFTED_S
        self._late_s = (now_s if self._late_s is None else self._late_s) if late else None
        shifted = self._late_s is not None and now_s - self._late_s > SHIFTED_FOR_S
        if offset_s < self._offset_s or restarted or shifted:
            self._offset_s, self._late_s = offset_s, None
        self._stamp_s = timestamp_s
        return timestamp_s + self._offset_s
