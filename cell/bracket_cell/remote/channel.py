"""Messages between two processes: data of declared types, within a limit of size, waited for within a limit of time.

A message is MessagePack with its length before it. Nothing that comes runs code: msgspec makes declared types of it or
refuses it. Arrays are (type, shape, bytes), CAN frames are tuples.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from typing import Any, Generic, TypeVar, get_origin

import can
import msgspec
import numpy as np

from bracket_ground.errors import CellError, DeviceFault, InputError, LogError, ModelError, SettingError

Heard = TypeVar("Heard")
LENGTH = struct.Struct("<I")
MOST_BYTES = 64 << 20
CHUNK_BYTES = 1 << 20


class Message(msgspec.Struct, frozen=True, tag=True):
    """Something that is said; its class tells what."""


class Failure(Message, frozen=True):
    """An error that crosses to another process, of one of our own types.

    Attributes:
        kind: name of its class.
        places: of a SettingError.
    """

    kind: str
    words: str
    device: str = ""
    places: tuple[tuple[tuple[str | int, ...], str], ...] = ()

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """What is said of an error."""
        if isinstance(error, DeviceFault):
            return cls("DeviceFault", error.reason, error.device)
        if isinstance(error, SettingError):
            return cls("SettingError", str(error), places=error.places)
        known = isinstance(error, CellError)
        return cls(type(error).__name__, str(error) if known else f"{type(error).__name__}: {error}")

    def error(self, device: str = "") -> CellError:
        """The error again; one that is none of ours is a fault of a device."""
        if self.kind == "SettingError":
            return SettingError(*self.places)
        if self.kind in (InputError.__name__, ModelError.__name__, LogError.__name__):
            return InputError(self.words)
        return DeviceFault(self.device or device, self.words)


class Channel(Generic[Heard]):
    """One end of a connection; close it.

    A message that is not whole within its limit leaves the channel useless: close it then.

    Args:
        heard: type of what comes, a union of messages.
        most_bytes: of a message that comes.
    """

    def __init__(self, connection: socket.socket, heard: Any, most_bytes: int = MOST_BYTES) -> None:
        connection.setblocking(False)
        self._socket, self._most_bytes = connection, most_bytes
        self._decoder = msgspec.msgpack.Decoder(heard, dec_hook=_decoded)
        self._came = bytearray()

    def hearing(self, heard: Any, most_bytes: int = MOST_BYTES) -> Channel[Any]:
        """The same connection, on which something else is heard from now on."""
        other: Channel[Any] = Channel(self._socket, heard, most_bytes)
        other._came = self._came
        return other

    def fileno(self) -> int:
        """For `select`; -1 once it is closed."""
        return self._socket.fileno()

    def send(self, message: Message, limit_s: float) -> None:
        """Send it.

        Raises:
            TimeoutError: the other end does not read.
            EOFError: the other end is gone.
        """
        data = bytearray(LENGTH.size)
        ENCODER.encode_into(message, data, LENGTH.size)
        LENGTH.pack_into(data, 0, len(data) - LENGTH.size)
        left, until_s = memoryview(data), time.monotonic() + limit_s
        while left:
            try:
                left = left[self._socket.send(left) :]
            except BlockingIOError:
                self._await(select.POLLOUT, until_s)
            except OSError as error:
                raise EOFError(error.strerror or str(error)) from None

    def receive(self, limit_s: float) -> Heard:
        """The next message.

        Raises:
            TimeoutError: none came.
            EOFError: the other end is gone, or says what is no message.
        """
        until_s = time.monotonic() + limit_s
        while (message := self.taken()) is None:
            self._await(select.POLLIN, until_s)
        return message

    def taken(self) -> Heard | None:
        """The next message where it is here, else None; never waits.

        Raises:
            EOFError: as `receive`.
        """
        while (message := self._whole()) is None:
            try:
                part = self._socket.recv(CHUNK_BYTES)
            except BlockingIOError:
                return None
            except OSError as error:
                raise EOFError(error.strerror or str(error)) from None
            if not part:
                raise EOFError("it hung up")
            self._came += part
        return message

    def close(self) -> None:
        """Hang up; harmless when repeated."""
        self._socket.close()

    def _whole(self) -> Heard | None:
        if len(self._came) < LENGTH.size:
            return None
        (size,) = LENGTH.unpack_from(self._came)
        if size > self._most_bytes:
            raise EOFError(f"a message of {size} bytes, at most {self._most_bytes} are taken")
        end = LENGTH.size + size
        if len(self._came) < end:
            return None
        with memoryview(self._came) as came:
            try:
                message = self._decoder.decode(came[LENGTH.size : end])
            except (msgspec.MsgspecError, ValueError, RecursionError, MemoryError) as error:
                raise EOFError(f"no message of this version: {error}") from None
        del self._came[:end]
        return message  # type: ignore[no-any-return]

    def _await(self, event: int, until_s: float) -> None:
        poll = select.poll()
        poll.register(self._socket.fileno(), event)
        if not poll.poll(1e3 * max(0.0, until_s - time.monotonic())):
            raise TimeoutError


def _encoded(value: Any) -> object:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, np.ascontiguousarray(value).data.cast("B") if value.size else b""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, can.Message):
        flags = (value.is_extended_id, value.is_remote_frame, value.is_error_frame, value.is_fd)
        return value.arbitration_id, bytes(value.data), value.dlc, flags
    if isinstance(value, str):  # a message that other languages know, in English
        return str(value)
    raise NotImplementedError(f"{type(value).__name__} is nothing that is said to another process")


def _decoded(kind: Any, value: Any) -> object:
    if kind is object:
        return value
    if kind is can.Message:
        number, data, length, (extended, remote, error, wide) = value
        return can.Message(
            arbitration_id=number,
            data=data,
            dlc=length,
            is_extended_id=extended,
            is_remote_frame=remote,
            is_error_frame=error,
            is_fd=wide,
            check=True,
        )
    if get_origin(kind) is np.ndarray:
        form, shape, data = value
        if np.dtype(form).kind not in "biuf":
            raise ValueError(f"an array of {form}")
        return np.frombuffer(data, form).reshape(shape)
    raise NotImplementedError(f"{kind} is nothing that comes from another process")


ENCODER = msgspec.msgpack.Encoder(enc_hook=_encoded)
