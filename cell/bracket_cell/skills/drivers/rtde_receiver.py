"""Keeps every sample that a Universal Robots controller sends by RTDE (protocol version 2), and connects again.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide". A package is its size (u16, with these three bytes),
its type (u8) and what belongs to the type, all big endian.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.pose import Array

PORT = 30004
FORMS = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I"}
OUTPUTS = (
    *("timestamp", "actual_q", "actual_qd", "target_moment", "robot_mode", "safety_mode", "runtime_state"),
    *("speed_scaling", "target_speed_fraction", "actual_TCP_force"),
)
ANSWER_S, AGAIN_S = 2.0, 0.2
HEAD_BYTES, LEAST_WAIT_S = 3, 0.001
KEPT = 4096
SHIFTED_S, SHIFTED_FOR_S = 0.05, 0.1  # samples that are so late for so long: the controller's clock lost time


@dataclass(frozen=True, eq=False)
class Sample:
    """What the controller told at one of its cycles.

    Attributes:
        time_s: of the run's clock.
        positions_rad, velocities_rad_s, moments_nm: (6,); moments as the controller reckons them.
        robot_mode: 7 where the arm can move.
        safety_mode: 1 and 2 where it may.
        runtime_state: 2 while a program runs.
        speed_share: what the pendant's slider leaves of all speeds.
        force_n: (3,) at the tool, in the controller's base frame, as it reckons it.
    """

    time_s: float
    positions_rad: Array
    velocities_rad_s: Array
    moments_nm: Array
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_share: float
    force_n: Array


class RtdeConnection:
    """One connection that tells outputs; close it.

    Attributes:
        version: of the controller: major, minor, bugfix, build.

    Raises:
        OSError: nobody is there, it hung up, or what it sends is no RTDE.
        DeviceFault: it does not know what is asked for.
    """

    def __init__(self, host: str, outputs: Sequence[str], rate_hz: float | None = None, limit_s: float = 2.0) -> None:
        self._limit_s, self._came = limit_s, b""
        self.socket = socket.create_connection((host, PORT), limit_s)
        try:
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            types = self._begun(host, outputs, rate_hz)
        except BaseException:
            self.close()
            raise
        self.widths = [int(FORMS[kind][:-1] or 1) for kind in types]
        self._form = struct.Struct(">" + "".join(FORMS[kind] for kind in types))

    def _begun(self, host: str, outputs: Sequence[str], rate_hz: float | None) -> list[str]:
        """The outputs' types, once it has begun to tell them."""
        if not _unpacked(struct.Struct(">?"), self.asked("V", struct.pack(">H", 2)))[0]:
            raise DeviceFault("arm", f"{host}: its RTDE is older than protocol version 2")
        self.version = _unpacked(struct.Struct(">4I"), self.asked("v", b""))
        rate = float((500 if self.version[0] >= 5 else 125) if rate_hz is None else rate_hz)
        answer = self.asked("O", struct.pack(">d", rate) + ",".join(outputs).encode())
        types = answer[1:].decode(errors="replace").split(",")
        if len(types) != len(outputs):
            raise ConnectionError(f"it answers {len(types)} types to {len(outputs)} outputs that were asked for")
        unknown = [name for name, kind in zip(outputs, types, strict=True) if kind not in FORMS]
        if unknown:
            raise DeviceFault("arm", f"{host}: its RTDE does not tell {', '.join(unknown)}")
        if not _unpacked(struct.Struct(">?"), self.asked("S", b""))[0]:
            raise ConnectionError("it does not begin to send what was asked for")
        return types

    def receive(self) -> tuple[float, ...]:
        """The next sample's values, one after the other; raises OSError."""
        return _unpacked(self._form, self._next("U")[1:])

    def close(self) -> None:
        """Hang up; who waits for a package wakes up."""
        with suppress(OSError):  # the other end hung up before
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()

    def asked(self, kind: str, body: bytes) -> bytes:
        """The answer to a package; raises OSError."""
        self.socket.sendall(struct.pack(">HB", len(body) + 3, ord(kind)) + body)
        return self._next(kind)

    def _next(self, wanted: str) -> bytes:
        """The next package of a kind, within the limit; text messages of the controller are passed over."""
        until_s = time.monotonic() + self._limit_s
        while time.monotonic() <= until_s:
            size, kind = struct.unpack(">HB", self._peeked(HEAD_BYTES, until_s))
            if size < HEAD_BYTES:
                raise ConnectionError(f"it sent a package of {size} bytes, the least is {HEAD_BYTES}")
            body, self._came = self._peeked(size, until_s)[HEAD_BYTES:], self._came[size:]
            if chr(kind) == wanted:
                return body
        raise TimeoutError(f"no package {wanted!r} came within {self._limit_s:g} s")

    def _peeked(self, count: int, until_s: float) -> bytes:
        """The next bytes, which stay where they are."""
        while len(self._came) < count:
            self.socket.settimeout(max(LEAST_WAIT_S, until_s - time.monotonic()))
            part = self.socket.recv(65536)
            if not part:
                raise ConnectionResetError("it hung up")
            self._came += part
        return self._came[:count]


def _unpacked(form: struct.Struct, body: bytes) -> tuple[Any, ...]:
    """Values of a package's body; raises ConnectionError for one of another size."""
    if len(body) != form.size:
        raise ConnectionError(f"it sent {len(body)} bytes of data where {form.size} belong")
    return form.unpack(body)


class RtdeReceiver:
    """Receives in a thread of its own.

    Attributes:
        version: of the controller.
        trouble: why nothing comes; empty while samples come.

    Raises:
        DeviceFault: the controller cannot be reached.
    """

    def __init__(self, host: str, clock: Clock, slower: float = 1.0) -> None:
        self._host, self._clock, self._limit_s = host, clock, ANSWER_S * slower
        self._late_s: float | None = None  # since when all samples have been late
        self._samples: deque[Sample] = deque(maxlen=KEPT)
        self._newest: Sample | None = None
        self._offset_s, self._stamp_s = float("inf"), 0.0
        self._ended, self._came = threading.Event(), threading.Condition()
        self.trouble = ""
        try:
            self._connection = RtdeConnection(host, OUTPUTS, None, self._limit_s)
        except OSError as error:
            raise DeviceFault("arm", f"no controller answers at {host}:{PORT}: {error}") from None
        self.version = self._connection.version
        self._thread = threading.Thread(target=self._run, name="RTDE", daemon=True)
        self._thread.start()

    @property
    def newest(self) -> Sample:
        """The newest sample; raises DeviceFault where none ever came."""
        with self._came:
            if self._newest is None:
                self._came.wait_for(lambda: self._newest is not None, self._limit_s)
            if self._newest is None:
                raise DeviceFault("arm", f"{self._host} tells nothing: {self.trouble or 'no sample came'}")
            return self._newest

    def taken(self) -> list[Sample]:
        """All samples since the last call, in order."""
        samples = list[Sample]()
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
            except OSError as error:
                self.trouble = str(error) or type(error).__name__
                self._connection.close()
                self._connect_again()

    def _connect_again(self) -> None:
        while not self._ended.wait(AGAIN_S / 10):
            try:
                self._connection = RtdeConnection(self._host, OUTPUTS, None, self._limit_s)
            except (OSError, DeviceFault) as error:
                self.trouble = str(error)
                self._ended.wait(AGAIN_S)
            else:
                return

    def _keep(self, values: tuple[float, ...]) -> None:
        time_s = self._time_s(values[0])
        if self._newest is not None and time_s <= self._newest.time_s:
            return
        joints = np.array(values[1:19]).reshape(3, 6)
        mode, safety, runtime, scaling, fraction = values[19:24]
        share = min(max(scaling, 0.0), 1.0) * min(max(fraction, 0.0), 1.0)
        with self._came:
            modes = int(mode), int(safety), int(runtime)
            self._newest = Sample(time_s, joints[0], joints[1], joints[2], *modes, share, np.array(values[24:27]))
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
