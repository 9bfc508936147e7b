"""A viewer's side: reads protobuf messages of a log by their own schemas, and follows a live server."""

from __future__ import annotations

import json
import re
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bracket_ground.interfaces.pose import Array, Pose

PROTOCOL = Subprotocol("foxglove.sdk.v1")
MESSAGE = struct.Struct("<BIQ")  # opcode, subscription, log time
MESSAGE_DATA = 1
UNKNOWN = re.compile(r"[Uu]nknown channel.*?(\d+)")


def decoded(path: Path) -> dict[str, list[Any]]:
    """Protobuf messages by topic, in order of time."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        factory = DecoderFactory()
        for schema, channel, message in make_reader(stream).iter_messages():
            if (decode := factory.decoder_for(channel.message_encoding, schema)) is not None:
                found[channel.topic].append(decode(message.data))
    return found


def topics(path: Path) -> dict[str, str]:
    """Schema's name by topic, of channels that hold a message."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {
        channel.topic: summary.schemas[channel.schema_id].name
        for channel in summary.channels.values()
        if counts.get(channel.id)
    }


def world_from(transforms: Mapping[str, Any], frame: str) -> Array:
    """Homogeneous matrix (4, 4) of a frame, from messages by child frame."""
    matrix = np.eye(4)
    while frame != "world":
        one = transforms[frame]
        t, q = one.translation, one.rotation
        matrix = Pose((t.x, t.y, t.z), (q.w, q.x, q.y, q.z)).matrix @ matrix
        frame = one.parent_frame_id
    return matrix


@contextmanager
def live_viewer(port: int) -> Iterator[LiveViewer]:
    """Connect to a live server."""
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], max_size=None) as websocket:
        yield LiveViewer(websocket)


class LiveViewer:
    """A client of a live server, as Foxglove is one."""

    def __init__(self, websocket: ClientConnection) -> None:
        self._websocket = websocket
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    def learn(self, *wanted: str) -> None:
        """Read advertisements until these topics are known."""
        while not set(wanted) <= self.channels.keys():
            self._take(json.loads(self._websocket.recv(timeout=60)))

    def subscribe(self, *wanted: str) -> None:
        """Ask for the messages of topics."""
        self._topics |= {len(self._topics) + number: topic for number, topic in enumerate(wanted)}
        asked = [{"id": i, "channelId": self.channels[t]["id"]} for i, t in self._topics.items() if t in wanted]
        self._websocket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def message(self, timeout_s: float = 0.02) -> tuple[str, int, bytes] | None:
        """(topic, log time in [ns], payload) of the next message; None where none comes in time."""
        try:
            while True:
                data = self._websocket.recv(timeout=timeout_s)
                if isinstance(data, str):
                    self._take(json.loads(data))
                elif data[0] == MESSAGE_DATA:
                    _, subscription, time_ns = MESSAGE.unpack_from(data)
                    return self._topics[subscription], time_ns, data[MESSAGE.size :]
        except TimeoutError:
            return None

    def _take(self, told: dict[str, Any]) -> None:
        if told["op"] == "status" and (unknown := UNKNOWN.search(told["message"])):
            # The server tells of a channel a moment before it takes subscriptions of it.
            self.subscribe(*(topic for topic, one in self.channels.items() if one["id"] == int(unknown[1])))
        if told["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in told["channels"]}
