"""The twin's cameras: each sends MJPEG by HTTP to whoever connects, and what a camera may do wrong."""

from __future__ import annotations

import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.frame import Frame
from bracket_sim.twin.cell import TwinCell

QUALITY = 95
BOUNDARY = "frame"
BUFFERED = 8  # frames that a camera with a buffer is behind
LATE_S = 0.080
GONE_S = 1.0  # for which a camera that is replugged is away
KEPT = 32
AGAIN = "; once more ends it"


def jpeg(image: NDArray[np.uint8]) -> bytes:
    """An image in RGB, coded."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


class ImageFaults:
    """What a camera shows in place of what it sees.

    Attributes:
        frozen, black: the same image again, or nothing.
    """

    def __init__(self) -> None:
        self.frozen = self.black = False
        self._kept: NDArray[np.uint8] | None = None

    def put(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image that is shown."""
        if self.black:
            return np.zeros_like(image)
        if not self.frozen or self._kept is None:
            self._kept = image
        return self._kept

    def offered(self, cell: TwinCell, role: str) -> None:
        """By `cell twin fault`."""

        def frozen() -> None:
            self.frozen = not self.frozen

        def black() -> None:
            self.black = not self.black

        cell.offer(f"{role}_frozen", f"camera {role} sends one image for ever{AGAIN}", frozen)
        cell.offer(f"{role}_black", f"camera {role} sends black images{AGAIN}", black)


class MjpegServer:
    """Sends the newest image to everybody who asks for any path.

    Attributes:
        banner: where it listens.
        port: likewise.
        faults: what it sends in place of the newest image.
        behind, late_s: how many images, or how long, it is behind.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        self._images: deque[bytes] = deque(maxlen=KEPT)
        self._new = threading.Condition()
        self._count = 0
        self._connections: list[socket.socket] = []
        self.faults = ImageFaults()
        self.behind, self.late_s, self._gone_until_s = 0, 0.0, 0.0
        try:
            self._server = ThreadingHTTPServer((host, port), _handler(self))
        except OSError as error:
            raise InputError(f"{host}:{port}: the twin cannot listen there: {error.strerror or error}") from None
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self.banner = f"{name}: MJPEG at http://{host}:{self.port}/"
        threading.Thread(target=self._server.serve_forever, args=(0.1,), name=name, daemon=True).start()

    def send(self, image: NDArray[np.uint8]) -> None:
        """The next image, in RGB."""
        coded = jpeg(self.faults.put(image))
        with self._new:
            self._images.append(coded)
            self._count += 1
            self._new.notify_all()

    def replug(self) -> None:
        """All connections end, and nobody is served for a while."""
        with self._new:
            self._gone_until_s = time.monotonic() + GONE_S
            for connection in self._connections:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
            self._connections.clear()

    def serve(self, connection: socket.socket, write: Callable[[bytes], object]) -> None:
        """Send images to one who asked, until the connection ends."""
        with self._new:
            if time.monotonic() < self._gone_until_s:
                return
            self._connections.append(connection)
        write(
            b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=" + BOUNDARY.encode() + b"\r\n\r\n"
        )
        seen = -1
        while True:
            with self._new:
                self._new.wait_for(lambda: self._count != seen and bool(self._images))  # noqa: B023
                seen = self._count
                image = self._images[-1 - min(self.behind, len(self._images) - 1)]
            time.sleep(self.late_s)
            head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
            write(head.encode() + image + b"\r\n")

    def close(self) -> None:
        """Nobody is served any more."""
        self.replug()
        self._server.shutdown()
        self._server.server_close()


def _handler(server: MjpegServer) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            with suppress(OSError):
                server.serve(self.connection, self.wfile.write)

        def log_message(self, *_: object) -> None:
            """Nothing is said."""

    return Handler


class Photographer:
    """Hands on what a camera of the twin sees; a thread waits for its images, so that the world goes on.

    Args:
        send: takes each frame once.
    """

    def __init__(self, cell: TwinCell, role: str, send: Callable[[Frame], None]) -> None:
        self._camera, self._send = getattr(cell.sim.devices, role), send
        self._period_s, self._due_s = 1.0 / getattr(cell.sim.world.bench, role).rate_hz, 0.0
        self._frame: Frame | None = None
        self._due, self._ended = threading.Event(), False
        self._thread = threading.Thread(target=self._photograph, name=f"images of {role}", daemon=True)
        self._thread.start()
        cell.each_period(self._look)

    def close(self) -> None:
        """Hand on nothing more."""
        self._ended = True
        self._due.set()
        self._thread.join()

    def _look(self, time_s: float) -> None:
        """After each control period: notice a new frame, and let a triggered camera run freely at its rate."""
        with suppress(DeviceFault):
            frame = self._camera.latest()
            if time_s >= self._due_s:
                self._due_s = time_s + self._period_s
                self._camera.trigger()
            if frame is not None and frame is not self._frame:
                self._frame = frame
                self._due.set()

    def _photograph(self) -> None:
        """Send each frame once: one that comes while the one before is being sent has set the event again."""
        sent: Frame | None = None
        while not self._ended:
            self._due.wait()
            self._due.clear()
            if (frame := self._frame) is not None and frame is not sent and not self._ended:
                sent = frame
                with suppress(DeviceFault):
                    self._send(frame)


class TwinCamera(MjpegServer):
    """A camera of the twin behind MJPEG."""

    def __init__(self, cell: TwinCell, role: str, host: str, port: int) -> None:
        super().__init__(f"camera {role}", host, port)
        self._photographer = Photographer(cell, role, lambda frame: self.send(frame.image))

    def close(self) -> None:
        """As in MjpegServer."""
        self._photographer.close()
        super().close()


def serve_stream(cell: TwinCell, role: str) -> TwinCamera:
    """A camera of the twin at the address that the configuration names, with its faults."""
    address = urlsplit(str(cell.settings[role]["url"]))
    if address.scheme != "http" or address.hostname is None:
        raise InputError(f"camera {role}: the twin serves http://HOST:PORT alone, not {address.geturl()}")
    camera = TwinCamera(cell, role, address.hostname, address.port or 80)

    camera.faults.offered(cell, role)

    def buffered() -> None:
        camera.behind = 0 if camera.behind else BUFFERED

    def late() -> None:
        camera.late_s = 0.0 if camera.late_s else LATE_S * cell.slower

    cell.offer(f"{role}_buffered", f"camera {role} is {BUFFERED} images behind{AGAIN}", buffered)
    cell.offer(f"{role}_late", f"camera {role} is {1e3 * LATE_S:.0f} ms late{AGAIN}", late)
    cell.offer(f"{role}_replugged", f"camera {role} is gone for {GONE_S:g} s", camera.replug)
    return camera
