"""The channels of the log, live over a WebSocket on this machine, for Foxglove, Lichtblick and the like.

The server lives in threads of its own and drops what a slow viewer does not take; the cell never waits for it. A gate
stands before it, so that a web page that happens to be open on this machine cannot read camera and log.
"""

from __future__ import annotations

import logging
from queue import Empty, SimpleQueue

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from bracket_cell.recording.scene import SceneLog
from bracket_cell.viewing.gate import Gate, hidden_address, listen
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.errors import InputError

DEFAULT_PORT = 8765  # where viewers look first
ORIGINS = ("https://app.foxglove.dev",)  # the viewer that is a web site
BACKLOG = 256  # messages that wait for one viewer; the oldest are dropped

logging.getLogger("foxglove.websocket").setLevel(logging.CRITICAL)  # of every caller that is no viewer a line


class LiveServer(Observer):
    """An observer that serves what a recorder writes.

    Attributes:
        port: where it listens.
    """

    def __init__(self, context: foxglove.Context, scene: SceneLog | None, port: int = DEFAULT_PORT) -> None:
        """Begin to serve.

        Args:
            context: of the recorder's channels.
            scene: says again to new viewers what stands still and is written once.
            port: 0 for any that is free.

        Raises:
            InputError: the port is taken.
        """
        self._scene = scene
        self._newcomers = _Newcomers()
        try:
            listening = listen(port)
        except OSError as error:
            raise InputError(
                f"port {port} cannot be used: {error.strerror}; choose another: --open live=PORT"
            ) from None
        behind = hidden_address()
        self._server = foxglove.start_server(
            name="cell",
            host=behind,
            port=0,
            capabilities=[Capability.Time],
            server_listener=self._newcomers,
            context=context,
            message_backlog_size=BACKLOG,
        )
        self._gate = Gate(listening, (behind, self._server.port), ORIGINS)
        self.port = self._gate.port

    def tick(self, record: TickRecord) -> None:
        stamp_ns = round(record.observation.time_s * 1e9)
        self._server.broadcast_time(stamp_ns)
        topics = self._newcomers.take()
        if topics and self._scene is not None:
            self._scene.repeat(topics, stamp_ns)

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - viewers see the connection end
        self.abandon()

    def abandon(self) -> None:
        """Stop serving; harmless when repeated."""
        self._gate.close()
        self._server.stop()


class _Newcomers(ServerListener):
    """Remembers what was subscribed to since the last tick; called from the server's threads."""

    def __init__(self) -> None:
        self._topics: SimpleQueue[str] = SimpleQueue()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002 - all get the same
        self._topics.put(channel.topic)

    def take(self) -> set[str]:
        """Topics that somebody subscribed to."""
        found = set()
        while True:
            try:
                found.add(self._topics.get_nowait())
            except Empty:
                return found
