"""What a controller of Universal Robots tells by RTDE (protocol version 2).

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide". A package is its size (u16, with these three bytes),
its type (u8) and what belongs to the type, all big endian.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from bracket_ground.errors import DeviceFault

PORT = 30004
FORMS = {"DOUBLE": "d", "VECTOR6D": "6d", "VECTOR3D": "3d", "INT32": "i", "UINT32": "I",
         "UINT64": "Q", "UINT8": "B", "BOOL": "?"}  # fmt: skip
POLYSCOPE_X = 10  # major version from which there is no dashboard
HEAD_BYTES, LEAST_WAIT_S = 3, 0.001


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
        if self.version[0] >= POLYSCOPE_X:
            text = ".".join(map(str, self.version[:3]))
            raise DeviceFault(
                "arm", f"{host} has PolyScope X ({text}): without a dashboard nothing brings its arm back"
            )
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

    def values(self) -> tuple[float, ...]:
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
