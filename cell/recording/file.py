"""One MCAP file that takes what the channels of a context say: a whole log, or one part of a rotated log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import foxglove
from foxglove.mcap import MCAPWriteOptions

from cell.recording.sink import LogSink

CHUNK_BYTES = 64 * 1024  # and a chunk ends with every tick, so that a killed process loses none


@dataclass(frozen=True)
class Heading:
    """What a log says about its run before the first tick.

    Attributes:
        metadata: seed, versions, hashes of weights and the like, as text by name.
        attachments: (media type, content) by name: tree, configuration, product.
    """

    metadata: Mapping[str, str] = field(default_factory=dict)
    attachments: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)


class LogFile:
    """A file behind a bounded buffer; takes every message of its context from its opening to its end.

    Chunks are not compressed: that would cost a tick more than all else, and images, most of a log, are already.

    Attributes:
        sink: what waits for the disk, and how the disk is.
    """

    def __init__(self, path: Path, context: foxglove.Context, heading: Heading) -> None:
        """Open the file and write what every file begins with.

        Raises:
            OSError: it cannot be opened.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.sink = LogSink(path)
        options = MCAPWriteOptions(compression=None, chunk_size=CHUNK_BYTES, compression_threads=0, profile="cell")
        self._writer = foxglove.open_mcap(self.sink, context=context, writer_options=options)
        for name, (media_type, content) in heading.attachments.items():
            self._writer.attach(log_time=0, create_time=0, name=name, media_type=media_type, data=content)
        self.note("run", heading.metadata)

    @property
    def path(self) -> Path:
        return self.sink.path

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.write_metadata(name, dict(values))

    def flush(self) -> None:
        """End the chunk and hand it to the sink's thread."""
        self._writer.flush()
        self.sink.hand_over()

    def close(self) -> None:
        """Write the index and wait for the disk."""
        self._writer.close()
        self.sink.close()

    def retire(self) -> None:
        """Write the index, and let the sink's thread end by itself once the disk has taken everything."""
        self._writer.close()
        self.sink.retire()
