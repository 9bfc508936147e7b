"""A new MCAP file of what others hold: schemas and channels are registered once, whatever numbers they had there."""

from __future__ import annotations

from collections import Counter
from typing import Any

from mcap import records
from mcap.writer import CompressionType, Writer


class CopyingWriter:
    """Writes records of the `mcap` package, and messages of further topics.

    Args:
        stream: the new file.
        renumber: messages are counted anew in their channels, from 1, as in logs of this program.
    """

    def __init__(self, stream: Any, chunk_bytes: int, *, renumber: bool = False) -> None:
        self._writer = Writer(stream, chunk_bytes, CompressionType.ZSTD, enable_data_crcs=True)
        self.renumber = renumber
        self._schemas: dict[int, int] = {0: 0}  # schema 0 stands for none
        self._channels: dict[int, int] = {}
        self._topics: dict[str, int] = {}
        self._sequences: Counter[int] = Counter()

    def start(self, profile: str, library: str) -> None:
        """The file's head; before all else."""
        self._writer.start(profile, library)

    def take(self, record: Any) -> None:
        """One more record; of two schemas or channels with one number the first counts."""
        writer = self._writer
        if isinstance(record, records.Message):
            channel = self._channels[record.channel_id]
            self._add(channel, record.log_time, record.data, record.publish_time, record.sequence)
        elif isinstance(record, records.Header):
            self.start(record.profile, record.library)
        elif isinstance(record, records.Schema) and record.id not in self._schemas:
            self._schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, records.Channel) and record.id not in self._channels:
            schema = self._schemas.get(record.schema_id, 0)
            channel = writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
            self._channels[record.id] = self._topics[record.topic] = channel
        elif isinstance(record, records.Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, records.Metadata):
            writer.add_metadata(record.name, record.metadata)

    def attach(self, name: str, content: bytes) -> None:
        """A file of no certain kind."""
        self._writer.add_attachment(0, 0, name, "application/octet-stream", content)

    def note(self, name: str, values: dict[str, str]) -> None:
        """A metadata record."""
        self._writer.add_metadata(name, values)

    def channel(self, topic: str, encoding: str, name: str, schema_encoding: str, schema: bytes) -> None:
        """A topic for `message`, unless there is one."""
        if topic not in self._topics:
            schema_id = self._writer.register_schema(name, schema_encoding, schema)
            self._topics[topic] = self._writer.register_channel(topic, encoding, schema_id)

    def message(self, topic: str, time_ns: int, data: bytes) -> None:
        """A message of a topic that has a channel."""
        self._add(self._topics[topic], time_ns, data, time_ns, 0)

    def finish(self) -> None:
        """Index and end of the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _add(self, channel: int, time_ns: int, data: bytes, published_ns: int, sequence: int) -> None:
        if self.renumber:
            self._sequences[channel] += 1
            sequence = self._sequences[channel]
        self._writer.add_message(channel, time_ns, data, published_ns, sequence)
